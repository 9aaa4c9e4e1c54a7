"""What a dataset cannot show, however good its data: the runs that are missing from it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from mjfish.data import Dataset, Trial
from mjfish.data.validation import SAME, beats
from mjfish.effects import Effect
from mjfish.inspection.finding import Finding
from mjfish.numerics.arrays import FloatArray

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
