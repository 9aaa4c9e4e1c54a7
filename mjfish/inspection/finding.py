"""One finding about the data: where, what, what was expected, what to do; with a stable code.

And datasets as they would be if what a finding says of them were true.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

from mjfish.arrays import FloatArray, readonly
from mjfish.data import Dataset, Trial
from mjfish.drive.cpg import DriveSegment
from mjfish.serialise import fields_of, unsaved

#: ``remark``: good to know; ``suspect``: look before you believe a verdict; ``blocks``: no verdict can be given.
Severity = Literal["remark", "suspect", "blocks"]
SEVERITIES: tuple[Severity, ...] = ("blocks", "suspect", "remark")

#: Stands for every cause in `Finding.cannot_tell`.
EVERYTHING = "*"


@dataclass(frozen=True)
class Finding:
    """One thing about the data that a reader, or a verdict, must know.

    Attributes:
        code: stable name of the finding, such as ``clock-jump``.
        severity: ``remark``, ``suspect`` or ``blocks``.
        place: where: trial, channel, time.
        found: what is there.
        expected: what good data have there.
        remedy: what to do.
        trials: names of the trials it is about; empty: all.
        channels: names of the channels it is about; empty: all.
        cannot_tell: causes (names of effects, or ``*`` for all) that such data cannot show, or that look like what was
            found. `Inspection.of` fills it in from what the effects declare.
        corrected: returns a dataset as it would be if the finding were true; None: nobody can say that.
    """

    code: str
    severity: Severity
    place: str
    found: str
    expected: str
    remedy: str
    trials: tuple[str, ...] = ()
    channels: tuple[str, ...] = ()
    cannot_tell: tuple[str, ...] = ()
    corrected: Callable[[Dataset], Dataset] | None = unsaved(default=None, compare=False, repr=False)

    @property
    def message(self) -> str:
        """The finding in one sentence."""
        return f"{self.place}: {self.found}, expected {self.expected}; {self.remedy}"

    def to_dict(self) -> dict[str, Any]:
        """Return the finding as plain data, with its message."""
        return {**fields_of(self), "message": self.message}


def reread(dataset: Dataset, trials: Sequence[str], order: Sequence[int], factors: FloatArray) -> Dataset:
    """Return the dataset with the velocities of some trials read from other columns, then multiplied.

    Args:
        dataset: as it was recorded.
        trials: names of those that are concerned.
        order: (3,) the column that each channel is in.
        factors: (3,) of each channel.
    """

    def of(trial: Trial) -> Trial:
        return replace(trial, velocity=readonly(trial.velocity[:, [*order]] * factors))

    return _changed(dataset, {trial.name: of(trial) for trial in dataset.trials if trial.name in trials})


def redriven(dataset: Dataset, drives: Mapping[str, tuple[DriveSegment, ...]]) -> Dataset:
    """Return the dataset with other drives of some trials, by name."""
    return _changed(dataset, {t.name: replace(t, drive=drives[t.name]) for t in dataset.trials if t.name in drives})


def resumed(dataset: Dataset, name: str, at: float, by: float) -> Dataset:
    """Return the dataset with a trial in which frames were lost: its samples after a time [s] are later by `by`."""
    trial = next(trial for trial in dataset.trials if trial.name == name)
    return _changed(dataset, {name: replace(trial, time=readonly(trial.time + by * (trial.time > at)), gaps=True)})


def _changed(dataset: Dataset, trials: Mapping[str, Trial]) -> Dataset:
    return replace(dataset, trials=tuple(trials.get(trial.name, trial) for trial in dataset.trials))
