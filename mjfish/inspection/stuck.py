"""Frames that were frozen, and channels that were stuck or clipped: values that noise would not repeat."""

from __future__ import annotations

from collections.abc import Iterator, Sized

import numpy as np

from mjfish.arrays import BoolArray, FloatArray
from mjfish.data import Trial
from mjfish.frames import CHANNELS, UNITS
from mjfish.inspection.finding import EVERYTHING, Finding

#: Chance below which repeated values are no accident.
_LEVEL = 1e-4
#: Samples at an extreme value that make a clipped channel, and how many times more than at the next values.
_CLIPPED = 4
_PILE = 4.0
_NEXT = 5


def stuck(trial: Trial) -> Iterator[Finding]:
    """Find rows that repeat the row before, and channels that do, or that pile up at their largest value."""
    same = np.diff(trial.velocity, axis=0) == 0.0
    moving = np.any(trial.velocity[1:] != 0.0, axis=1)
    frozen = np.all(same, axis=1) & moving
    # How often single values repeat by chance, as they do where they were rounded.
    chance = np.array([np.mean(same[~frozen, c]) if np.any(~frozen) else 0.0 for c in range(3)])
    if len(same) * float(np.prod(chance)) < _LEVEL and frozen.any():
        yield _frozen(trial, frozen)
    for channel in range(3):
        if np.ptp(trial.velocity[:, channel]) == 0.0:
            yield _silent(trial, channel)
            continue
        alone = same[:, channel] & ~frozen & moving
        found = _clipped(trial, channel) or _held(trial, channel, alone)
        if found:
            yield found


def _silent(trial: Trial, channel: int) -> Finding:
    name = CHANNELS[channel]
    return Finding(
        "stuck",
        "blocks",
        f"trial '{trial.name}', {name}",
        f"every value is {trial.velocity[0, channel] + 0.0:.4g} {UNITS[name]}: the channel was not recorded",
        "a channel that moves with the fish",
        "give the recorded channel, or leave the trial out",
        cannot_tell=(EVERYTHING,),
        trials=(trial.name,),
        channels=(name,),
    )


def _frozen(trial: Trial, frozen: BoolArray) -> Finding:
    rows = np.flatnonzero(frozen) + 1
    first = int(rows[0])
    return Finding(
        "stuck",
        "suspect",
        f"trial '{trial.name}', row {first + 1} ({trial.time[first]:.3f} s)"
        + (f" and {len(rows) - 1} more" if len(rows) > 1 else ""),
        f"{_count(rows)} the row before in all channels: frozen frames",
        "rows that differ by their noise at least",
        "remove these rows and say gaps = true in the trial's entry",
        cannot_tell=("time_offset",) if len(rows) > 0.02 * len(trial.time) else (),
        trials=(trial.name,),
    )


def _held(trial: Trial, channel: int, same: BoolArray) -> Finding | None:
    """Find one channel that keeps its value while the others move, longer than rounding explains."""
    start, length = _longest(same)
    share = float(np.mean(np.delete(same, np.s_[start : start + length])))
    if length < 3 or len(same) * max(share, 1e-12) ** length > _LEVEL:
        return None
    name = CHANNELS[channel]
    value = trial.velocity[start, channel]
    return Finding(
        "stuck",
        "suspect",
        f"trial '{trial.name}', {name}, rows {start + 1} to {start + length + 1} ({trial.time[start]:.3f} s)",
        f"the value stays at {value:.4g} {UNITS[name]} while the other channels move",
        "a value that changes with every row",
        "remove these rows and say gaps = true, or see why the channel was stuck",
        trials=(trial.name,),
        channels=(name,),
    )


def _clipped(trial: Trial, channel: int) -> Finding | None:
    """Find values that pile up at the largest or the smallest one."""
    values, name = trial.velocity[:, channel], CHANNELS[channel]
    for sign, word in ((1.0, "above"), (-1.0, "below")):
        levels, counts = np.unique(sign * values, return_counts=True)
        if len(levels) <= _NEXT or levels[-1] == 0.0:
            continue
        piled = int(counts[-1])
        if piled >= max(_CLIPPED, _PILE * counts[-1 - _NEXT : -1].max()) and _several(sign * values == levels[-1]):
            return Finding(
                "stuck",
                "suspect",
                f"trial '{trial.name}', {name}",
                f"{piled} samples are exactly {sign * levels[-1]:.4g} {UNITS[name]} and none is {word}: the sensor is "
                "at its limit",
                "peaks that differ",
                "record with a wider range of the sensor, or remove these rows and say gaps = true",
                cannot_tell=("servo_saturation", "servo_rate_limit", "velocity_scale"),
                trials=(trial.name,),
                channels=(name,),
            )
    return None


def _several(at: BoolArray) -> bool:
    """Whether the samples stand in two places at least: a single place is a channel that was stuck."""
    return int(np.count_nonzero(np.diff(at.astype(np.int8)) > 0)) + int(at[0]) > 1


def _count(rows: Sized) -> str:
    return "1 row repeats" if len(rows) == 1 else f"{len(rows)} rows repeat"


def _longest(same: BoolArray) -> tuple[int, int]:
    """Return first row and length of the longest run of true."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], same.astype(np.int8), [0]])))
    starts, ends = edges[::2], edges[1::2]
    if not len(starts):
        return 0, 0
    longest = int(np.argmax(ends - starts))
    return int(starts[longest]), int(ends[longest] - starts[longest])


def resting(trial: Trial) -> FloatArray | None:
    """Return velocities (n, 3) of the rest before the joints first move, None where there is none of 25 samples.

    Only trials with measured joint angles can have one: a CPG starts at 0 s.
    """
    if trial.joint_angle is None:
        return None
    span = np.ptp(trial.joint_angle, axis=0).max()
    moved = np.abs(trial.joint_angle - trial.joint_angle[0]).max(axis=1) > 0.02 * span
    still = int(np.argmax(moved)) if moved.any() else len(moved)
    return trial.velocity[: still - 5] if still >= 30 else None
