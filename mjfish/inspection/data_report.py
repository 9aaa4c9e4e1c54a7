"""What is in a dataset before anything is fitted to it: its runs, the findings, and the causes that it cannot show."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mjfish.data import Dataset, Trial, load_dataset
from mjfish.data.looking import for_looking
from mjfish.effects import Causes, catalogue, of_fish
from mjfish.frames import CHANNELS
from mjfish.inspection.before_fit import inspect
from mjfish.inspection.finding import EVERYTHING
from mjfish.inspection.result import Inspection
from mjfish.result import Result

#: Of the JSON.
SCHEMA = 1


@dataclass(frozen=True, repr=False)
class DataReport(Result):
    """What a dataset has, and what it can show.

    Attributes:
        dataset: that was read.
        inspection: the findings of `mjfish.inspect`.
        undetectable: causes that these runs cannot show, whatever their size, with the reason. A diagnosis may find
            more: those that the free coefficients hide.
        causes: names of all causes that were asked for.
    """

    dataset: Dataset
    inspection: Inspection
    undetectable: Mapping[str, str]
    causes: tuple[str, ...]

    @property
    def unclear(self) -> dict[str, tuple[str, ...]]:
        """Causes that data with a finding cannot tell, by its code, without those that are undetectable anyway.

        A finding that leaves no cause to be told has them all.
        """
        found: dict[str, tuple[str, ...]] = {}
        for finding in self.inspection.findings:
            named = self.causes if EVERYTHING in finding.cannot_tell else finding.cannot_tell
            names = [name for name in named if name in self.causes and name not in self.undetectable]
            if names:
                found[finding.code] = tuple(dict.fromkeys((*found.get(finding.code, ()), *names)))
        return found

    def summary(self) -> str:
        """Return how many runs and findings there are, and how many causes the runs can show."""
        runs = len(self.dataset.trials)
        shown = len(self.causes) - len(self.undetectable)
        return (
            f"{self.dataset.name}: {runs} {'run' if runs == 1 else 'runs'} of fish '{self.dataset.fish.name}', which "
            f"can show {shown} of {len(self.causes)} causes.\n{self.inspection.summary()}"
        )

    def to_dict(self) -> dict[str, Any]:
        """Return runs, findings and causes as plain data."""
        held_out = {trial.name for trial in self.dataset.split()[1]}
        return {
            "schema": SCHEMA,
            "dataset": self.dataset.name,
            "fish": self.dataset.fish.name,
            "clock": self.dataset.clock,
            "trials": [_of_trial(trial, held_out=trial.name in held_out) for trial in self.dataset.trials],
            "severity": self.inspection.severity,
            "findings": [finding.to_dict() for finding in self.inspection.findings],
            "undetectable": dict(self.undetectable),
            "unclear": {code: list(names) for code, names in self.unclear.items()},
        }


def report_on(dataset: Dataset | str | Path, effects: Causes = None) -> DataReport:
    """Say what is in a dataset, what is wrong with it, and which causes it cannot show. Nothing is fitted.

    Args:
        dataset: the trials, with velocities in m/s and rad/s and times in s, or the folder of ``dataset.toml``.
        effects: causes by name, or Python files with causes of your own; None: the shipped ones.

    Raises:
        InputError: `dataset` is a folder that cannot be read.

    Example:
        >>> import mjfish
        >>> from mjfish.inspection import report_on
        >>> report = report_on(mjfish.generate("pike", ["v1", "v3-t1"], noise=(0.01, 0.01, 0.05)))
        >>> report.undetectable["wall_effect"]
        'the walls are not known: the dataset has no tank = {x = [lo, hi], y = [lo, hi]}'
    """
    if not isinstance(dataset, Dataset):
        dataset = load_dataset(dataset)
    known = of_fish(catalogue(effects), dataset.fish)
    reasons = {name: reason for name, effect in known.items() if (reason := effect.not_applicable(dataset))}
    return DataReport(dataset, inspect(dataset, known), reasons, tuple(known))


def _of_trial(trial: Trial, *, held_out: bool) -> dict[str, Any]:
    """Return what a trial has: samples, mean and root mean square of each velocity, None of one not measured.

    Of places and headings, the velocities of the smoothed path.
    """
    trial = for_looking(trial)
    measured = trial.measured
    velocity = np.where(measured, np.nan_to_num(trial.velocity), np.nan)
    mean, rms = velocity.mean(axis=0), np.sqrt(np.square(velocity).mean(axis=0))
    return {
        "name": trial.name,
        "held_out": held_out,
        "samples": len(trial.time),
        "duration": float(trial.time[-1] - trial.time[0]),
        "rate": trial.rate,
        "driven_by": trial.driven_by,
        "pose": trial.pose is not None,
        "sensors": [sensor.name for sensor in trial.sensors],
        "mean": {name: float(mean[k]) if measured[k] else None for k, name in enumerate(CHANNELS)},
        "rms": {name: float(rms[k]) if measured[k] else None for k, name in enumerate(CHANNELS)},
    }
