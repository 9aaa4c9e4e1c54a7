"""Whether a run has samples enough of every beat, and its times are in seconds."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

from mjfish.data import Trial
from mjfish.data.validation import beats
from mjfish.inspection.finding import Finding
from mjfish.numerics.arrays import readonly

#: Fewest samples a beat in which a motion can be recognised.
_SAMPLES_A_BEAT = 5.0
#: A run of a CPG that lasts longer than this [s] is not simulated.
_LONGEST = 4.0 * 3600.0
#: Frequencies [Hz] between which recorded joints beat, of any fish.
_PLAUSIBLE = (0.03, 30.0)


def sampled_enough(trial: Trial) -> bool:
    """Whether a CPG-driven trial has enough samples a beat, and not too long a time to simulate."""
    if not trial.drive:
        return True
    beat = 2.0 * math.pi / max(segment.omega for segment in trial.drive)
    return bool(trial.step * _SAMPLES_A_BEAT < beat and trial.time[-1] < _LONGEST)


def time_factor(trial: Trial) -> float:
    """Return by what the times must be multiplied to be in s: 0.001 or 1000 where only that is plausible, else 1."""
    if trial.drive:
        return 1.0 if sampled_enough(trial) or not sampled_enough(retimed(trial, 0.001)) else 0.001
    frequency = min(beats(trial), default=1.0) if trial.joint_angle is not None else 1.0
    low, high = _PLAUSIBLE
    return next((factor for factor in (1.0, 0.001, 1000.0) if low < frequency / factor < high), 1.0)


def retimed(trial: Trial, factor: float) -> Trial:
    """Return the trial with its times multiplied, without its sensors, which have clocks of their own."""
    return trial if factor == 1.0 else replace(trial, time=readonly(factor * trial.time), sensors=())


def time_units(trials: Sequence[Trial]) -> Iterator[Finding]:
    """Say which recorded joints beat at a frequency of no fish: their times are in another unit."""
    for factor, unit in ((0.001, "they are in ms"), (1000.0, "they are in s and were divided by 1000")):
        strange = [trial for trial in trials if not trial.drive and time_factor(trial) == factor]
        if strange:
            first, names = strange[0], tuple(trial.name for trial in strange)
            everywhere = len(names) == len(trials)
            yield Finding(
                "sampling-unit",
                "blocks",
                f"{'all trials' if everywhere else 'trials ' + ', '.join(names)}, time",
                f"the joints of '{first.name}' beat at {min(beats(first)):.3g} Hz, with a sample every "
                f"{first.step:.3g} s",
                f"a beat of {_PLAUSIBLE[0]:g} to {_PLAUSIBLE[1]:g} Hz",
                f"{unit}: multiply the times by {factor:g}; the other findings take them so",
                trials=() if everywhere else names,
            )


def coarse(trials: Sequence[Trial]) -> Iterator[Finding]:
    """Say which runs are sampled too coarsely, or have times in another unit."""
    few = [trial for trial in trials if not sampled_enough(trial)]
    if few:
        first, names = few[0], tuple(trial.name for trial in few)
        samples = 2.0 * math.pi / max(segment.omega for segment in first.drive) / first.step
        yield Finding(
            "sampling-coarse",
            "blocks",
            f"{'all trials' if len(few) == len(trials) else 'trials ' + ', '.join(names)}, time",
            f"'{first.name}' has a sample every {first.step:.4g} s, {samples:.2g} a beat, for {first.time[-1]:.4g} s",
            "5 samples a beat or more, and hours at most",
            "multiply the times by 0.001 if they are in ms; else record faster",
            trials=names,
        )
