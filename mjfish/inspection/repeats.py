"""Repeated runs: what differs between runs of the same drive is noise, and nothing but noise, whatever the model.

d = (y_1 - y_2) / sqrt(2),   in general the deviations from the mean of R repeats times sqrt(R / (R - 1))
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mjfish.arrays import BoolArray, FloatArray, readonly
from mjfish.data import Dataset, Trial
from mjfish.data.types import seen_of
from mjfish.estimation.noise import Noise, estimate

#: Repeats shorter than this many samples together say little of a noise.
_FEWEST = 100
#: Lags of the autocorrelation that is shown.
_LAGS = 10
#: Powers that differences at the beat and twice the beat may have over their neighbours, before they are no noise.
LINE = 25.0


@dataclass(frozen=True, eq=False)
class Repeats:
    """The noise that repeated runs show.

    Attributes:
        groups: names of the trials that repeat each other.
        noise: autoregressive, order by BIC, free of any model of the fish.
        sigma: (3,) standard deviation, surge, sway [m/s], yaw rate [rad/s].
        autocorrelation: (3, 11) at lags 0 to 10 samples.
        seconds: of recording that went into it, counting a pair once.
        clean: the groups whose line is below `LINE`: those the noise is from; without any, all.
        line: per group the largest power of the differences at one or two times the beat frequency, over that of its
            neighbours; about 1 to 7 where the repeats differ by noise alone.
    """

    groups: tuple[tuple[str, ...], ...]
    clean: tuple[tuple[str, ...], ...]
    noise: Noise
    sigma: FloatArray
    autocorrelation: FloatArray
    seconds: float
    line: tuple[float, ...]

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain data."""
        return {
            "groups": [list(group) for group in self.groups],
            "clean": [list(group) for group in self.clean],
            "sigma": self.sigma.tolist(),
            "order": self.noise.order,
            "phi": self.noise.phi.tolist(),
            "innovation_sigma": self.noise.sigma.tolist(),
            "autocorrelation": self.autocorrelation.tolist(),
            "seconds": self.seconds,
            "line": list(self.line),
        }


def noise_from_repeats(dataset: Dataset, leave_out: Sequence[str] = ()) -> Repeats | None:
    """Estimate the noise from runs of one drive, sampled at the same times; None where there are none.

    Args:
        dataset: its trials.
        leave_out: names of trials that are copies of others or have a wrong label.
    """
    groups: dict[Any, list[Trial]] = {}
    for trial in dataset.trials:
        if trial.drive and trial.name not in leave_out:
            groups.setdefault(trial.drive, []).append(trial)
    found = [_differences(group, dataset.clock == "free") for group in groups.values() if len(group) > 1]
    every = [one for one in found if one is not None]
    clean = [one for one in every if one[4] <= LINE]
    used = clean or every
    if sum(len(block) for one in used for block in one[0]) < _FEWEST:
        return None
    blocks = [block for one in used for block in one[0]]
    seen = [there for one in used for there in one[1]]
    noise = estimate(blocks, seen=seen)
    products = _autocovariance(blocks, seen)
    return Repeats(
        groups=tuple(one[2] for one in every),
        clean=tuple(one[2] for one in clean),
        noise=noise,
        sigma=readonly(np.sqrt(products[:, 0])),
        autocorrelation=readonly(products / products[:, :1]),
        seconds=float(sum(one[3] for one in used)),
        line=tuple(one[4] for one in every),
    )


def _differences(
    group: Sequence[Trial], free_clock: bool
) -> tuple[list[FloatArray], list[BoolArray], tuple[str, ...], float, float] | None:
    """Return differences (n, 3) a repeat, where they stand on the grid, names, seconds, power at the beat."""
    step = group[0].step
    cells = [np.rint(trial.time / step).astype(np.int64) for trial in group]
    aligned = all(np.abs(t.time - c * step).max() < 0.05 * step for t, c in zip(group, cells, strict=True))
    common = cells[0]
    for other in cells[1:]:
        common = np.intersect1d(common, other)
    # A step of the drive is seen before or after, as the clocks have it.
    for segment in group[0].drive[1:]:
        common = common[np.abs(common * step - segment.start) > 1.5 * step]
    if not aligned or len(common) < _FEWEST // 2:
        return None
    values = np.stack([t.velocity[np.searchsorted(c, common)] for t, c in zip(group, cells, strict=True)])
    mean = values.mean(axis=0)
    apart = values - mean
    if free_clock:
        slope = np.gradient(mean, common * step, axis=0)
        weight = 1.0 / np.square(np.ptp(mean, axis=0) + 1e-12)
        shift = np.einsum("rnc,nc,c->r", apart, slope, weight) / np.einsum("nc,nc,c->", slope, slope, weight)
        apart = apart - shift[:, None, None] * slope
    apart = np.asarray(apart * np.sqrt(len(group) / (len(group) - 1)), dtype=np.float64)
    # The last of the deviations follows from the others.
    there = seen_of(common - common[0])
    kept = list(apart[: len(group) - 1])
    names = tuple(trial.name for trial in group)
    line = max(_line(block, np.asarray(common * step, dtype=np.float64), group[0]) for block in apart)
    return kept, [there] * len(kept), names, len(common) * step * (len(group) - 1), line


def _line(block: FloatArray, time: FloatArray, trial: Trial) -> float:
    """Return the largest power at one and two times the beat, over the mean power beside it, in the last segment."""
    tail = time > trial.drive[-1].start
    span = float(np.ptp(time[tail])) if tail.any() else 0.0
    beat = trial.drive[-1].omega / (2.0 * np.pi)
    if span * beat < 5.0:
        return 0.0
    largest = 0.0
    for harmonic in (1, 2):
        beside = [k for k in range(-5, 6) if abs(k) > 1]
        power = {k: _power(block[tail], time[tail], harmonic * beat + k / span) for k in [0, *beside]}
        largest = max(largest, float(np.max(power[0] / np.mean([power[k] for k in beside], axis=0))))
    return largest


def _power(block: FloatArray, time: FloatArray, frequency: float) -> FloatArray:
    window = np.hanning(len(time))[:, None]
    wave = np.exp(-2j * np.pi * frequency * time)[:, None]
    return np.asarray(np.abs(np.sum(window * wave * (block - block.mean(axis=0)), axis=0)) ** 2 + 1e-300)


def _autocovariance(blocks: Sequence[FloatArray], seen: Sequence[BoolArray]) -> FloatArray:
    """Return autocovariances (3, 11) from the pairs that are there."""
    products, pairs = np.zeros((3, _LAGS + 1)), np.zeros(_LAGS + 1)
    for block, there in zip(blocks, seen, strict=True):
        grid = np.zeros((len(there), 3))
        grid[there] = block
        for lag in range(_LAGS + 1):
            products[:, lag] += np.sum(grid[lag:] * grid[: len(grid) - lag], axis=0)
            pairs[lag] += np.count_nonzero(there[lag:] & there[: len(there) - lag])
    return np.asarray(products / np.maximum(pairs, 1.0) + 1e-300)
