"""Repeated runs: what differs between runs of the same drive is noise, and nothing but noise, whatever the model.

d = (y_1 - y_2) / sqrt(2),   in general the deviations from the mean of R repeats times sqrt(R / (R - 1))
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from functools import reduce
from typing import Any, NamedTuple

import numpy as np

from mjfish.data import Dataset, Trial
from mjfish.data.trial import seen_of
from mjfish.fish.frames import CHANNELS, UNITS
from mjfish.inspection.finding import Finding
from mjfish.noise import Autoregressive, estimate
from mjfish.noise.autoregressive import products_and_pairs
from mjfish.numerics.arrays import BoolArray, FloatArray, readonly

#: Repeats shorter than this many samples together say little of a noise.
_FEWEST = 100
#: Lags of the autocorrelation that is shown.
_LAGS = 10
#: Largest power of differences at the beat and twice the beat, over their neighbours, that counts as noise.
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
    noise: Autoregressive
    sigma: FloatArray
    autocorrelation: FloatArray
    seconds: float
    line: tuple[float, ...]

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain data."""
        noise = {"order": self.noise.order, "phi": self.noise.phi, "innovation_sigma": self.noise.sigma}
        return {name: value for name, value in vars(self).items() if name != "noise"} | noise


def noise_from_repeats(dataset: Dataset, leave_out: Collection[str] = ()) -> Repeats | None:
    """Estimate the noise from runs of one drive, sampled at the same times; None where there are none.

    Args:
        dataset: its trials.
        leave_out: names of trials that are copies of others or have a wrong label.
    """
    trials = [trial for trial in dataset.trials if trial.drive and trial.name not in leave_out]
    groups = ([t for t in trials if t.drive == drive] for drive in dict.fromkeys(trial.drive for trial in trials))
    differences = (_differences(group, dataset.clock == "free") for group in groups if len(group) > 1)
    every = [group for group in differences if group is not None]
    clean = [group for group in every if group.line <= LINE]
    used = clean or every
    blocks = [block for group in used for block in group.blocks]
    if sum(map(len, blocks)) < _FEWEST:
        return None
    seen = [rows for group in used for rows in group.seen]
    noise = estimate(blocks, seen=seen)
    products, pairs = products_and_pairs(blocks, seen, _LAGS)
    covariances = products / np.maximum(pairs, 1.0) + 1e-300
    return Repeats(
        groups=tuple(group.names for group in every),
        clean=tuple(group.names for group in clean),
        noise=noise,
        sigma=readonly(np.sqrt(covariances[:, 0])),
        autocorrelation=readonly(covariances / covariances[:, :1]),
        seconds=float(sum(group.seconds for group in used)),
        line=tuple(group.line for group in every),
    )


class _Group(NamedTuple):
    """Repeats of one drive: differences (n, 3) per repeat, their rows on the grid, power at the beat."""

    blocks: list[FloatArray]
    seen: list[BoolArray]
    names: tuple[str, ...]
    seconds: float
    line: float


def _differences(group: Sequence[Trial], free_clock: bool) -> _Group | None:
    """Return the differences between repeats; None where they have too few samples in common."""
    step = group[0].step
    cells = [np.rint(trial.time / step).astype(np.int64) for trial in group]
    aligned = all(np.abs(t.time - c * step).max() < 0.05 * step for t, c in zip(group, cells, strict=True))
    common = reduce(np.intersect1d, cells)
    # A step of the drive is seen before or after, as the clocks have it.
    for segment in group[0].drive[1:]:
        common = common[np.abs(common * step - segment.start) > 1.5 * step]
    if not aligned or len(common) < _FEWEST // 2:
        return None
    values = np.stack([t.velocity[np.searchsorted(c, common)] for t, c in zip(group, cells, strict=True)])
    time, mean = np.asarray(common * step, dtype=np.float64), values.mean(axis=0)
    apart = values - mean
    if free_clock:
        slope = np.gradient(mean, time, axis=0)
        weight = 1.0 / np.square(np.ptp(mean, axis=0) + 1e-12)
        shift = np.einsum("rnc,nc,c->r", apart, slope, weight) / np.einsum("nc,nc,c->", slope, slope, weight)
        apart -= shift[:, None, None] * slope
    apart *= np.sqrt(len(group) / (len(group) - 1))
    return _Group(
        blocks=list(apart[:-1]),  # the last of the deviations follows from the others
        seen=[seen_of(common - common[0])] * (len(group) - 1),
        names=tuple(trial.name for trial in group),
        seconds=len(common) * step * (len(group) - 1),
        line=max(_line(block, time, group[0]) for block in apart),
    )


def _line(block: FloatArray, time: FloatArray, trial: Trial) -> float:
    """Return the largest power at one and two times the beat, over the mean power beside it, in the last segment."""
    tail = time > trial.drive[-1].start
    span = float(np.ptp(time[tail])) if tail.any() else 0.0
    beat = trial.drive[-1].omega / (2.0 * np.pi)
    if span * beat < 5.0:
        return 0.0
    beside = np.array([0.0, *(k for k in range(-5, 6) if abs(k) > 1)])
    frequency = np.array([[beat], [2.0 * beat]]) + beside / span
    windowed = np.hanning(np.count_nonzero(tail))[:, None] * (block[tail] - block[tail].mean(axis=0))
    power = np.abs(np.exp(-2j * np.pi * frequency[:, :, None] * time[tail]) @ windowed) ** 2 + 1e-300
    return float(np.max(power[:, 0] / power[:, 1:].mean(axis=1)))


def repeat_findings(repeats: Repeats) -> Iterator[Finding]:
    """Yield how much noise the repeats show, and which of them differ by more."""
    if repeats.clean:
        sigma = ", ".join(f"{s:.3g} {UNITS[c]} in {c}" for s, c in zip(repeats.sigma, CHANNELS, strict=True))
        yield Finding(
            "repeats-noise",
            "remark",
            " and ".join("/".join(group) for group in repeats.clean),
            f"repeats differ by noise of {sigma} (order {repeats.noise.order}, from {repeats.seconds:.0f} s)",
            "this noise, whatever the model",
            "weigh the residuals by it where it was seen for 60 s or more",
        )
    for group, line in zip(repeats.groups, repeats.line, strict=True):
        if line > LINE:
            yield Finding(
                "repeats-differ",
                "suspect",
                f"trials {', '.join(group)}",
                f"these repeats differ at the beat frequency, {line:.0f} times as much as beside it",
                "repeats that differ by noise alone",
                "look whether their clocks, batteries or starts differ, and leave the outlying run out",
                trials=group,
            )
