"""Runs that are sampled too coarsely or in another unit of time, and runs that are missing from a dataset."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from mjfish.data import Dataset, Trial
from mjfish.data.validation import SAME, beats
from mjfish.effects import Effect
from mjfish.inspection.finding import Finding
from mjfish.numerics.arrays import FloatArray, readonly

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


def time_units(trials: Sequence[Trial], factors: Mapping[str, float]) -> Iterator[Finding]:
    """Say which recorded joints beat at a frequency of no fish: their times are in another unit.

    Args:
        trials: that are looked at.
        factors: the `time_factor` of each, by name.
    """
    for factor, unit in ((0.001, "they are in ms"), (1000.0, "they are in s and were divided by 1000")):
        strange = [trial for trial in trials if not trial.drive and factors[trial.name] == factor]
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


#: Runs of fewer beats hardly leave their start-up.
_SHORT = 5.0
#: Samples of a run of which a twentieth says something, and such parts.
_FEWEST, _PARTS = 100, 20
#: A CPG whose largest bias is below this [-], or joints whose mean bend is below this angle [rad], do not turn.
_NO_BIAS, _NO_BEND = 1e-6, 0.03


def missing_runs(dataset: Dataset, effects: Mapping[str, Effect]) -> Iterator[Finding]:
    """Yield the runs that are missing. The remedies name the causes that these runs would tell apart."""
    fitted, held = dataset.split()
    if len(dataset.trials) == 1:
        yield _missing(
            "design-one-run",
            "the dataset has one run",
            "several runs, of different drives",
            "record more runs: with one, a fault of the run cannot be told from a fault of the model",
        )
    if not held and len(dataset.trials) > 1:
        yield _missing(
            "design-no-held-out",
            "no run is held out",
            "at least one",
            "set one aside, or record another: without it the gain cannot be measured",
        )
    frequencies = sorted(f for trial in fitted for f in beats(trial))
    if frequencies and frequencies[-1] <= frequencies[0] * (1.0 + SAME):
        code = "design-one-frequency"
        causes = ", ".join(name for name, effect in effects.items() if effect.unclear_under(code)) or "causes"
        yield _missing(
            code,
            f"all fitted runs beat at one frequency ({np.mean(frequencies):.2f} Hz)",
            "two at least, a factor of 1.5 apart",
            f"record a run at another frequency: how the misfit grows with it tells {causes} apart",
        )
    if not any(_turns(trial) for trial in fitted):
        yield _missing(
            "design-no-turn",
            "no fitted run turns",
            "a turn to either side",
            "record a turn: with one heading a current looks like another speed or a turned camera, and moments that "
            "turn the fish hardly show",
        )
    if not any(trial.starts_at_rest or len(trial.drive) > 1 or _gathers_speed(trial) for trial in fitted):
        yield _missing(
            "design-no-start",
            "no fitted run starts from rest, and none changes its drive",
            "a start or a step of the drive",
            "record a start: steady swimming hides inertia, added mass and memory",
        )
    short = [trial.name for trial in dataset.trials if np.ptp(trial.time) * min(beats(trial), default=np.inf) < _SHORT]
    if short:
        yield Finding(
            "design-short",
            "remark",
            f"trials {', '.join(short)}",
            f"shorter than {_SHORT:.0f} beats",
            "runs that reach steady swimming",
            "record longer: the steady speed, which tells drag laws apart, is not reached",
            trials=tuple(short),
        )


def _gathers_speed(trial: Trial) -> bool:
    """Return whether the first twentieth of a run is less than half as fast as its last half: a start, measured."""
    speeds = _speeds(trial)
    return bool(speeds[0] < 0.5 * speeds[_PARTS // 2 :].mean())


def _speeds(trial: Trial) -> FloatArray:
    """Return the speed in every twentieth of a run (20,) [m/s], of its surge or a tracked point; zero without both."""
    if trial.measured[0] and len(trial.time) >= _FEWEST:
        return np.array([np.abs(part).mean() for part in np.array_split(trial.velocity[:, 0], _PARTS)])
    for sensor in trial.sensors:
        if sensor.kind == "position" and len(sensor.time) >= _FEWEST:
            rows = np.linspace(0, len(sensor.time) - 1, _PARTS + 1).astype(int)
            way = np.linalg.norm(np.diff(sensor.values[rows], axis=0), axis=1)
            return np.asarray(way / np.diff(sensor.time[rows]))
    return np.zeros(_PARTS)


def _turns(trial: Trial) -> bool:
    if trial.drive:
        return any(abs(b) > _NO_BIAS for segment in trial.drive for b in segment.bias)
    if trial.wave is not None:
        return max(map(abs, trial.wave.bias)) > _NO_BEND
    return trial.joint_angle is not None and float(np.abs(trial.joint_angle.mean(axis=0)).max()) > _NO_BEND


def _missing(code: str, found: str, expected: str, remedy: str) -> Finding:
    return Finding(code, "remark", "dataset", found, expected, remedy)
