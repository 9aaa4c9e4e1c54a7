"""Datasets as they would be if what a finding says of them were true."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from mjfish.arrays import FloatArray, readonly
from mjfish.data import Dataset, Trial
from mjfish.drive.cpg import DriveSegment


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
