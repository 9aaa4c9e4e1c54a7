"""All findings about a dataset, and tests of the data that need no fit: what `diagnose` runs first.

And the report on a dataset before anything is fitted to it: its runs, the findings, the causes that it cannot show.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from mjfish.data import Dataset, Trial, load_dataset
from mjfish.data.trial import for_looking
from mjfish.effects import Causes, Effect, catalogue, of_fish
from mjfish.estimation.clocks import aligned, beat
from mjfish.files.plain_data import plain
from mjfish.files.result import Result
from mjfish.fish.frames import CHANNELS
from mjfish.inspection.finding import EVERYTHING, SEVERITIES, Finding, Severity
from mjfish.inspection.kinematics import Compatibility, compatibility, disagreements
from mjfish.inspection.nominal_simulation import against_simulation
from mjfish.inspection.poses import pose_findings
from mjfish.inspection.repeats import Repeats, noise_from_repeats, repeat_findings
from mjfish.inspection.runs import coarse, missing_runs, retimed, sampled_enough, time_factor, time_units
from mjfish.inspection.samples import copies, interpolated, outliers, stuck, unresolved

#: What is looked at, where the channels for it were measured.
_TESTED = (
    "mjfish.inspect looks at signs, units, labels, clocks, sampling, starts, copies, outliers, joints, places, repeats "
    "and missing runs"
)


@dataclass(frozen=True, repr=False)
class Inspection(Result):
    """All findings about a dataset.

    Attributes:
        findings: worst first, else in the order in which they were found.
        compatibility: of pose and velocity, where both were measured; None else.
        repeats: the noise that repeated runs show; None where no run was repeated.
    """

    findings: tuple[Finding, ...] = ()
    compatibility: Compatibility | None = None
    repeats: Repeats | None = None

    @classmethod
    def of(
        cls,
        findings: Iterable[Finding],
        effects: Mapping[str, Effect],
        compatibility: Compatibility | None = None,
        repeats: Repeats | None = None,
    ) -> Inspection:
        """Return the findings in order, each with the causes that it concerns."""
        concerned = [replace(finding, cannot_tell=_concerned(finding, effects)) for finding in findings]
        return cls(_ordered(concerned), compatibility, repeats)

    @property
    def severity(self) -> Severity | None:
        """The worst severity; None where nothing was found."""
        return self.findings[0].severity if self.findings else None

    @property
    def blocks(self) -> tuple[Finding, ...]:
        """Findings with which no verdict can be given."""
        return tuple(finding for finding in self.findings if finding.severity == "blocks")

    def joined(self, other: Inspection) -> Inspection:
        """Return the findings of both; those that are in both once."""
        return Inspection(
            _ordered([*self.findings, *(finding for finding in other.findings if finding not in self.findings)]),
            self.compatibility or other.compatibility,
            self.repeats or other.repeats,
        )

    def changed(self, findings: Mapping[Finding, Finding]) -> Inspection:
        """Return the inspection with other findings in the place of some."""
        return replace(self, findings=_ordered(findings.get(finding, finding) for finding in self.findings))

    def summary(self) -> str:
        """Return what was looked at, how many findings there are, and the worst of them, a line each."""
        if not self.findings:
            return f"Nothing was found in the data ({_TESTED})."
        counts = [(sum(f.severity == severity for f in self.findings), severity) for severity in SEVERITIES]
        head = ", ".join(f"{count} {severity}" for count, severity in counts if count)
        lines = [f"{finding.severity}: {finding.code}: {finding.place}: {finding.found}" for finding in self.findings]
        lines[7:] = [f"and {len(lines) - 7} more"] if len(lines) > 7 else []
        return "\n".join([f"Findings: {head} ({_TESTED}).", *lines])

    def to_dict(self) -> dict[str, Any]:
        """Return the findings as plain data."""
        return {"severity": self.severity, **super().to_dict()}


def _concerned(finding: Finding, effects: Mapping[str, Effect]) -> tuple[str, ...]:
    if finding.severity == "blocks" or finding.code == "design-one-run":  # it leaves no cause to be told either
        return (EVERYTHING,)
    return tuple(sorted(name for name, effect in effects.items() if effect.unclear_under(finding.code)))


def _ordered(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """Sort findings, the worst first; the order is kept among equals."""
    return tuple(sorted(findings, key=lambda finding: SEVERITIES.index(finding.severity)))


def inspect(dataset: Dataset | str | Path, effects: Causes = None) -> Inspection:
    """Test a dataset before anything is fitted to it: signs, units, labels, clocks, copies, missing runs.

    Velocities are in m/s and rad/s, times in s, as `mjfish.load_dataset` reads them. Nothing is raised for bad data:
    each fault is a `Finding` with a code, a place, what was expected, and a remedy. Of trials without all three
    velocities, places, headings and joints are tested.

    Args:
        dataset: the trials, or the folder of ``dataset.toml``.
        effects: the causes that findings may concern, by name, or Python files with causes of your own; None: the
            shipped ones.

    Returns:
        The findings, the worst first; those of severity ``blocks`` make a diagnosis worthless.

    Raises:
        InputError: `dataset` is a folder that cannot be read, or has no trial to fit; a file of effects is none.

    Example:
        >>> import mjfish
        >>> dataset = mjfish.generate("pike", ["v1", "v3-t1"], noise=(0.01, 0.01, 0.05))
        >>> [finding.code for finding in mjfish.inspect(dataset).findings]
        ['design-one-frequency', 'design-no-turn']
    """
    if not isinstance(dataset, Dataset):
        dataset = load_dataset(dataset)
    known = catalogue(effects)
    complete, others = ([trial for trial in dataset.trials if trial.measured.all() == whole] for whole in (True, False))
    factors = {trial.name: time_factor(trial) for trial in dataset.trials}
    beside = [
        *time_units(others, factors),
        *pose_findings(dataset),
        *(one for trial in others for one in unresolved(trial)),
    ]
    if not complete:
        return Inspection.of([*beside, *missing_runs(dataset, known)], known)
    read = aligned(replace(dataset, trials=tuple(complete))).trials
    found = [finding for trial in read for finding in stuck(trial)]
    silent = {name for finding in found if finding.severity == "blocks" for name in finding.trials}
    found += coarse([trial for trial in read if trial.name not in silent])
    found += [*time_units(read, factors), *wave_frequencies(complete)]
    # Other units show only where the times are right.
    timed = {trial.name: retimed(trial, factors[trial.name]) for trial in read}
    trials = [trial for name, trial in timed.items() if name not in silent]
    fine = [trial for trial in trials if sampled_enough(trial)]
    lines = [line for line in map(interpolated, fine) if line is not None]
    noise = np.median([line.noise for line in lines], axis=0) if lines else np.zeros(3)
    found += [finding for trial in trials for finding in unresolved(trial)]
    found += copies(trials, [trial.name for trial in dataset.split()[1]], noise, lines)
    found += against_simulation(dataset.fish, fine, noise)
    harmless = ("copies", "joints", "sampling")
    misread = {name for finding in found if not finding.code.startswith(harmless) for name in finding.trials}
    found += outliers([line for line in lines if line.trial.name not in misread])
    pair = compatibility(trials)
    found += disagreements(pair) if pair is not None else ()
    spoiled = {
        name
        for finding in found
        if finding.severity == "blocks" or finding.code.startswith("copies")
        for name in finding.trials
    }
    repeats = noise_from_repeats(replace(dataset, trials=tuple(timed.values())), leave_out=spoiled)
    found += repeat_findings(repeats) if repeats is not None else ()
    every = replace(dataset, trials=tuple(timed.get(trial.name, trial) for trial in dataset.trials))
    return Inspection.of([*beside, *found, *missing_runs(every, known)], known, pair, repeats)


def wave_frequencies(trials: Sequence[Trial]) -> Iterator[Finding]:
    """Yield a finding for every wave of its own clock that the fish beats faster or slower than."""
    for trial in trials:
        found = beat(trial)
        if trial.wave is not None and found is not None:
            yield Finding(
                "wave-frequency",
                "suspect",
                f"trial {trial.name}",
                f"the frequency of the drive is {trial.wave.frequency:.3g} Hz, the fish beats at {found:.3g} Hz",
                "the same frequency",
                "correct the frequency of the drive; meanwhile it is taken to be that of the beat",
                trials=(trial.name,),
            )


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
        'the walls are not known: dataset.toml has no [tank]'
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
    velocity = np.where(trial.measured, np.nan_to_num(trial.velocity), np.nan)
    return {
        "name": trial.name,
        "held_out": held_out,
        "samples": len(trial.time),
        "duration": float(trial.time[-1] - trial.time[0]),
        "rate": trial.rate,
        "driven_by": trial.driven_by,
        "pose": trial.pose is not None,
        "sensors": [sensor.name for sensor in trial.sensors],
        "mean": dict(zip(CHANNELS, plain(velocity.mean(axis=0)), strict=True)),
        "rms": dict(zip(CHANNELS, plain(np.sqrt(np.square(velocity).mean(axis=0))), strict=True)),
    }
