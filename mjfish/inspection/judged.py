"""Findings about pose and velocity, about repeats, and about the start of a run."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from mjfish.arrays import FloatArray
from mjfish.data import Trial
from mjfish.frames import CHANNELS, UNITS
from mjfish.inspection.compatibility import Compatibility, Estimated
from mjfish.inspection.finding import EVERYTHING, Finding
from mjfish.inspection.repeats import LINE, Repeats
from mjfish.inspection.stuck import resting

#: Standard errors by which pose and velocity must disagree, and the least disagreement worth a word.
_SURE = 6.0
_SCALE, _ANGLE, _SKEW = 0.01, math.radians(0.5), 0.002
_BIAS = {"surge_bias": 0.005, "sway_bias": 0.005, "bias": 0.02}
#: A factor of this size is a unit, not a calibration.
_UNIT = 3.0
#: A start counts as in motion where the first samples have this share of the typical speed, and this many sigma.
_MOVING = 0.5


def of_compatibility(one: Compatibility) -> Iterator[Finding]:
    """Say what pose and velocity disagree about."""
    where = "pose and velocity"
    if one.derived:
        yield Finding(
            "compatibility",
            "remark",
            where,
            "the velocity was made from the pose by a filter, so that they agree whatever the camera's scale or clock",
            "two measurements that can check each other",
            "calibrate by a scale bar and a flash of light",
            cannot_tell=("velocity_scale", "frame_misalignment", "time_offset"),
            trials=one.trials,
        )
        return
    for name, estimate in one.translation.items():
        yield from _disagreement(name, estimate, ("surge", "sway"), one.trials)
    for name, estimate in one.turning.items():
        yield from _disagreement(name, estimate, ("yaw_rate",), one.trials)


def _disagreement(name: str, one: Estimated, channels: tuple[str, ...], trials: tuple[str, ...]) -> Iterator[Finding]:
    null = 1.0 if name == "scale" else 0.0
    least = {"scale": _SCALE, "rotation": _ANGLE, "skew": _SKEW, **_BIAS}[name]
    if not (one.off(null) > _SURE and abs(one.value - null) > least):
        return
    unit = name == "scale" and not 1.0 / _UNIT < abs(one.value) < _UNIT
    found, remedy, cause = {
        "scale": (
            f"the velocity is {one.value:.4g} (+- {one.error:.2g}) times that of the pose",
            "check both units" if unit else "calibrate the scale of both, and divide the wrong one by this factor",
            "velocity_scale",
        ),
        "rotation": (
            f"the velocity is turned by {math.degrees(one.value):.2f} (+- {math.degrees(one.error):.2g}) degrees "
            "against the heading",
            "align the axes of the velocity, or the line that the heading is read from, with the body",
            "frame_misalignment",
        ),
        "skew": (
            f"what the velocity says at t the pose says at t {'+' if one.value > 0 else '-'} "
            f"{1e3 * abs(one.value):.2f} (+- {1e3 * one.error:.2g}) ms",
            "bring both to one clock",
            "time_offset",
        ),
    }.get(
        name,
        (
            f"the velocity has an offset of {one.value:.3g} (+- {one.error:.2g}) {UNITS[channels[0]]}",
            "take the offset at rest, and subtract it; a velocity against the water has that of a current",
            "ambient_current",
        ),
    )
    yield Finding(
        "compatibility",
        "blocks" if unit else "suspect",
        f"pose and velocity, {' and '.join(channels)}" + (f" ({name.partition('_')[0]})" if "bias" in name else ""),
        found,
        "velocities that are the rates of the pose",
        remedy,
        cannot_tell=(EVERYTHING,) if unit else (cause,),
        trials=trials,
        channels=channels,
    )


def of_repeats(one: Repeats) -> Iterator[Finding]:
    """Say how much noise the repeats show, and whether they differ by more."""
    if one.clean:
        yield _repeated(one)
    for group, line in zip(one.groups, one.line, strict=True):
        if line > LINE:
            yield Finding(
                "repeats",
                "suspect",
                f"trials {', '.join(group)}",
                f"these repeats differ at the beat frequency, {line:.0f} times as much as beside it",
                "repeats that differ by noise alone",
                "look whether their clocks, batteries or starts differ, and leave the odd one out",
                cannot_tell=("time_offset", "servo_lag", "velocity_scale"),
                trials=group,
            )


def _repeated(one: Repeats) -> Finding:
    sigma = ", ".join(f"{s:.3g} {UNITS[c]} in {c}" for s, c in zip(one.sigma, CHANNELS, strict=True))
    return Finding(
        "repeats",
        "remark",
        " and ".join("/".join(group) for group in one.clean),
        f"repeats differ by noise of {sigma} (order {one.noise.order}, from {one.seconds:.0f} s)",
        "this noise, whatever the model",
        "weigh the residuals by it where it was seen for 60 s or more",
    )


def of_start(trial: Trial, guess: FloatArray | None, noise: FloatArray) -> Iterator[Finding]:
    """Find a run that was under way when it is said to start, or that reads something while it rests.

    Args:
        trial: the run.
        guess: (n, 3) its nominal simulation, from rest; None where there is none.
        noise: (3,) sigma.
    """
    rest = resting(trial)
    if rest is not None:
        mean, error = rest.mean(axis=0), 3.0 * rest.std(axis=0) / math.sqrt(len(rest)) * 3.0 + 1e-12
        least = 0.05 * np.abs(trial.velocity).max(axis=0)
        for channel in np.flatnonzero((np.abs(mean) > error) & (np.abs(mean) > least)):
            yield Finding(
                "start",
                "suspect",
                f"trial '{trial.name}', {CHANNELS[channel]}",
                f"it reads {mean[channel]:.3g} {UNITS[CHANNELS[channel]]} while the joints rest",
                "0 at rest in still water",
                "subtract it if it is the sensor's; it is a current if it turns with the heading",
                cannot_tell=("ambient_current",),
                trials=(trial.name,),
                channels=(CHANNELS[channel],),
            )
    if guess is None or not trial.starts_at_rest or trial.time[0] > 0.05:
        return
    step = trial.step
    few = slice(0, max(int(0.1 / step), 2))
    usual = float(np.median(trial.velocity[len(trial.time) // 2 :, 0]))
    excess = float(np.median(trial.velocity[few, 0] - guess[few, 0]))
    if usual > 0.0 and excess > _MOVING * usual and excess > 6.0 * float(noise[0]):
        yield Finding(
            "start",
            "blocks",
            f"trial '{trial.name}', first {few.stop} rows",
            f"the fish swims at {excess:.2f} m/s when its drive is said to start ({excess / usual:.0%} of its later "
            "speed)",
            "a start from rest at 0 s, as every run that a CPG drives has",
            "give the recording from the start of the drive, or measured joint angles",
            cannot_tell=(EVERYTHING,),
            trials=(trial.name,),
        )


def sampling(trials: Sequence[Trial], enough: Sequence[bool]) -> Iterator[Finding]:
    """Say which runs are sampled too coarsely, or have times in another unit."""
    coarse = [trial for trial, fine in zip(trials, enough, strict=True) if not fine]
    if not coarse:
        return
    one = coarse[0]
    step = one.step
    beat = 2.0 * math.pi / max(segment.omega for segment in one.drive)
    yield Finding(
        "sampling",
        "blocks",
        f"{'all trials' if len(coarse) == len(trials) else 'trials ' + ', '.join(t.name for t in coarse)}, time",
        f"'{one.name}' has a sample every {step:.4g} s, {beat / step:.2g} a beat, for {one.time[-1]:.4g} s",
        "5 samples a beat or more, and minutes at most",
        "multiply the times by 0.001 if they are in ms; else record faster",
        cannot_tell=(EVERYTHING,),
        trials=tuple(trial.name for trial in coarse),
    )
