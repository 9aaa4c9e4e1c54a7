"""What a dataset can never show, however good its data: the runs that are not in it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from mjfish.data import Dataset, Trial, beat
from mjfish.effects.effect import Effect
from mjfish.inspection.finding import EVERYTHING, Finding

#: Frequencies closer than this share are one.
_SAME = 0.05
#: Runs of fewer beats hardly leave their start-up.
_SHORT = 5.0
#: A drive whose largest bias is below this one [-], or joints whose mean bend is below this angle [rad], do not turn.
_NO_BIAS = 1e-6
_NO_BEND = 0.03
#: Causes that a turn, or a start, tells from others, beside those whose fingerprint says so.
_TURNING = ("ambient_current", "frame_misalignment", "munk_moment")
_STARTING = ("inertia_error", "mass_error", "servo_lag", "time_offset", "wake_memory")
#: Exponents of frequency below this one are none.
_ALIKE = 0.25


def design(dataset: Dataset, effects: Mapping[str, Effect]) -> Iterator[Finding]:
    """Say which runs are missing, and which causes that leaves alike."""
    trials = dataset.trials
    fitted, held = dataset.split()
    if len(trials) == 1:
        yield _missing(
            "the dataset has one run",
            "several runs, of different drives",
            "record more runs: with one, a fault of the run cannot be told from a fault of the model",
            (EVERYTHING,),
        )
    if not held and len(trials) > 1:
        yield _missing(
            "no run is held out", "one at least", "set one aside, or record another: no gain can be measured"
        )
    frequencies = sorted(f for trial in fitted for f in beats(trial))
    if frequencies and frequencies[-1] <= frequencies[0] * (1.0 + _SAME):
        alike = tuple(name for name, one in effects.items() if abs(one.fingerprint.exponent or 0.0) > _ALIKE)
        yield _missing(
            f"all fitted runs beat at one frequency ({np.mean(frequencies):.2f} Hz)",
            "two at least, a factor of 1.5 apart",
            f"record a run at another frequency: how they go with it is what tells {_listed(alike)} apart",
            alike,
        )
    if not any(_turns(trial) for trial in fitted):
        yield _missing(
            "no fitted run turns",
            "a turn to either side",
            "record a turn: with one heading a current looks like another speed or a turned camera, and what turns the "
            "fish shows least",
            _shown_in("turn", effects, _TURNING),
        )
    yield from _starts(dataset, fitted, effects)


def beats(trial: Trial) -> list[float]:
    """Return the beat frequencies [Hz] of a trial: of its drive, or of its measured joints."""
    if trial.drive:
        shown = [segment for segment in trial.drive if segment.start < trial.time[-1]]
        return [segment.omega / (2.0 * np.pi) for segment in shown]
    if trial.joint_angle is None:
        return []
    count = beat.count(trial.time, trial.joint_angle)
    return [] if count is None else [count / float(np.ptp(trial.time))]


def _starts(dataset: Dataset, fitted: tuple[Trial, ...], effects: Mapping[str, Effect]) -> Iterator[Finding]:
    if not any(trial.starts_at_rest for trial in fitted) and not any(len(trial.drive) > 1 for trial in fitted):
        yield _missing(
            "no fitted run starts from rest, and none changes its drive",
            "a start or a step of the drive",
            "record a start: what is steady hides inertia, added mass and memory",
            _shown_in("start-up", effects, _STARTING),
        )
    short = [
        trial.name for trial in dataset.trials if (f := beats(trial)) and float(np.ptp(trial.time)) * min(f) < _SHORT
    ]
    if short:
        yield Finding(
            "design",
            "remark",
            f"trials {', '.join(short)}",
            f"shorter than {_SHORT:.0f} beats",
            "runs that reach steady swimming",
            "record longer: the steady speed, that tells drag laws apart, is not reached",
            cannot_tell=tuple(sorted({"reynolds_drag", "linear_drag"} & set(effects))),
            trials=tuple(short),
        )


def _shown_in(part: str, effects: Mapping[str, Effect], known: tuple[str, ...]) -> tuple[str, ...]:
    """Return the causes that show in a part of a run, by their fingerprint or by name."""
    return tuple(sorted(name for name, one in effects.items() if one.fingerprint.part == part or name in known))


def _turns(trial: Trial) -> bool:
    if trial.drive:
        return any(abs(b) > _NO_BIAS for segment in trial.drive for b in segment.bias)
    return trial.joint_angle is not None and float(np.abs(trial.joint_angle.mean(axis=0)).max()) > _NO_BEND


def _missing(found: str, expected: str, remedy: str, cannot_tell: tuple[str, ...] = ()) -> Finding:
    return Finding("design", "remark", "dataset", found, expected, remedy, cannot_tell)


def _listed(names: tuple[str, ...]) -> str:
    return ", ".join(names) or "causes"
