"""Runs under the wrong label: a run that another run's drive explains, and its own does not.

    cost_ij = mean over channels of  min_a sum |y_i - a p_j|^2 / sum |y_i|^2,      a in [1/2, 2]

with p_j the swimming that drive j would have made at the times of run i. Amplitudes are left open where nothing was
fitted yet; frequencies and turns show all the same. After a fit they are not, and cost is in units of the noise.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from mjfish.arrays import FloatArray, readonly
from mjfish.data import Trial
from mjfish.inspection.finding import EVERYTHING, Finding
from mjfish.inspection.guess import Drive
from mjfish.model import Model

#: Smallest amplitude a.
_LOW = 0.5
#: Two runs are swapped where, crossed over, both cost less than this share of what they cost as they are.
_SWAPPED = 0.5
#: One run has the wrong label where its own drive costs this much, and another's this share of it.
_FOREIGN = 0.4
_SHARE = 0.25
#: Fewest beats from which a frequency is read.
_BEATS = 5.0


def costs(
    model: Model,
    trials: Sequence[Trial],
    drives: Sequence[Drive],
    values: Mapping[str, float],
    sigma: FloatArray | None = None,
) -> FloatArray:
    """Return the costs (trials, drives); infinite where a rollout diverges or a trial's joints were measured.

    Args:
        model, values: that predict.
        trials: measured.
        drives: that may have been theirs.
        sigma: (3,) after a fit: then a = 1, and costs are mean squares of the misfit over sigma.
    """
    table = np.full((len(trials), len(drives)), np.inf)
    driven = [trial for trial in trials if trial.drive]
    if not driven:
        return table
    longest = max(driven, key=lambda trial: float(trial.time[-1]))
    for j, drive in enumerate(drives):
        blank = replace(longest, drive=drive, pose=None, time=readonly(longest.time[[0, -1]]))
        run = model.predict(blank, values)
        if run.status != "ok":
            continue
        for i, trial in enumerate(trials):
            if trial.drive:
                clock = model.prepare(trial, values).time
                predicted = run.rollout.at(np.clip(clock, 0.0, run.rollout.time[-1]))[:, :3]
                table[i, j] = _cost(trial.velocity, predicted, sigma)
    return table


def _cost(measured: FloatArray, predicted: FloatArray, sigma: FloatArray | None) -> float:
    if sigma is not None:
        return float(np.mean(((measured - predicted) / sigma) ** 2))
    amplitude = np.sum(measured * predicted, axis=0) / (np.sum(predicted**2, axis=0) + 1e-24)
    left = measured - np.clip(amplitude, _LOW, 1.0 / _LOW) * predicted
    return float(np.mean(np.sum(left**2, axis=0) / (np.sum(measured**2, axis=0) + 1e-24)))


def labels(
    trials: Sequence[Trial], drives: Sequence[Drive], table: FloatArray, *, fitted: bool = False
) -> Iterator[Finding]:
    """Find pairs of runs that changed places, and runs that swam another run's drive.

    Args:
        trials: (n,).
        drives: (m,) distinct.
        table: (n, m) `costs`.
        fitted: they are in units of the noise.
    """
    own = [drives.index(trial.drive) if trial.drive in drives else -1 for trial in trials]
    taken: set[int] = set()
    for gain, i, j in sorted(_pairs(table, own)):
        if i in taken or j in taken:
            continue
        taken |= {i, j}
        here, there = (np.sqrt(table[i, own[k]]) for k in (i, j))
        yield Finding(
            "labels",
            "blocks",
            f"trials '{trials[i].name}' and '{trials[j].name}'",
            f"each swam the other's drive: crossed over, their misfit falls to {gain:.0%} (that of '{trials[i].name}' "
            f"from {here:.2f} to {there:.2f})",
            "each run to fit its own drive best",
            "swap the two files in dataset.toml, or their drives",
            cannot_tell=(EVERYTHING,),
            trials=(trials[i].name, trials[j].name),
        )
    for i, trial in enumerate(trials):
        if i in taken or own[i] < 0 or not np.isfinite(table[i, own[i]]):
            continue
        best = int(np.argmin(table[i]))
        if fitted:
            continue
        if table[i, own[i]] > _FOREIGN and table[i, best] < _SHARE * table[i, own[i]]:
            whose = ", ".join(f"'{other.name}'" for k, other in enumerate(trials) if own[k] == best)
            yield Finding(
                "labels",
                "blocks",
                f"trial '{trial.name}'",
                f"it swam the drive of {whose}: its own leaves {table[i, own[i]]:.2f} of its power unexplained, that "
                f"one {table[i, best]:.2f}",
                "each run to fit its own drive best",
                "correct its drive or its file in dataset.toml",
                cannot_tell=(EVERYTHING,),
                trials=(trial.name,),
            )
        elif table[i, own[i]] > _FOREIGN:
            yield from _beats_otherwise(trial)


def _beats_otherwise(trial: Trial) -> Iterator[Finding]:
    """Find a run that beats at another frequency than its drive, where the drive has one and the run is long enough."""
    omegas = {segment.omega for segment in trial.drive}
    span = float(np.ptp(trial.time))
    frequency = np.arange(0.2, 0.4 / trial.step, 0.25 / span)
    wave = np.exp(-2j * np.pi * frequency[:, None] * trial.time) @ (trial.velocity[:, 2] - trial.velocity[:, 2].mean())
    found, asked = float(frequency[np.argmax(np.abs(wave))]), float(trial.drive[0].omega / (2.0 * np.pi))
    # A tail that gives way may answer loudest at three times the beat.
    harmonic = abs(found - max(round(found / asked), 1) * asked) < 2.0 / span
    if len(omegas) > 1 or harmonic or span * asked < _BEATS:
        return
    yield Finding(
        "labels",
        "blocks",
        f"trial '{trial.name}'",
        f"the fish beats at {found:.2f} Hz, its drive at {asked:.2f} Hz",
        "a fish that beats as it is driven",
        "correct its drive or its file in dataset.toml",
        cannot_tell=(EVERYTHING,),
        trials=(trial.name,),
    )


def _pairs(table: FloatArray, own: Sequence[int]) -> Iterator[tuple[float, int, int]]:
    """Yield what is left of the misfit when two runs are crossed over, and the two, where it helps both."""
    for i in range(len(own)):
        for j in range(i):
            if own[i] == own[j] or min(own[i], own[j]) < 0:
                continue
            now = np.array([table[i, own[i]], table[j, own[j]]])
            crossed = np.array([table[i, own[j]], table[j, own[i]]])
            if np.all(np.isfinite(now)) and np.all(np.isfinite(crossed)) and np.all(crossed < _SWAPPED * now):
                yield float(crossed.sum() / now.sum()), j, i
