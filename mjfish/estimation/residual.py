"""Residuals of single trials: which samples count, which are scored, where gaps are.

A held-out trial is scored with everything frozen that was fitted elsewhere. What belongs to it alone (start velocity,
free clock) is fitted on its first part, and that part is left out of the score: nothing that is scored was fitted to.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy import linalg

from mjfish.data import Role, Sensor, Trial
from mjfish.estimation.fit import Fit, fit_or_raise
from mjfish.estimation.problem import Problem, nuisances
from mjfish.execution import mapped
from mjfish.fish.frames import CHANNELS, UNITS
from mjfish.numerics.arrays import BoolArray, FloatArray

#: Share of a held-out trial, as far as its samples count, on which its nuisance parameters are fitted, if it has any.
PREFIX = 0.25
#: Most evaluations of their fit.
_MOST = 20


@dataclass(frozen=True, eq=False)
class ChannelError:
    """What a model leaves of one channel of a trial: a velocity, or where none was measured, a channel of a sensor.

    Attributes:
        name: of the channel, behind that of its sensor.
        unit: of it.
        time: (n,) of its scored samples [s].
        measured: (n,) there.
        residual: (n,) measured less predicted.
        ends: least and largest value of all samples of the trial.
    """

    name: str
    unit: str
    time: FloatArray
    measured: FloatArray
    residual: FloatArray
    ends: tuple[float, float]


def channel_errors(problem: Problem, x: FloatArray) -> list[tuple[ChannelError, ...]]:
    """Return what a model leaves of the channels of every trial of a problem, counted samples only."""
    return [_channel_errors(problem, x, index, left) for index, left in enumerate(problem.raw(x))]


def _channel_errors(problem: Problem, x: FloatArray, index: int, left: FloatArray) -> tuple[ChannelError, ...]:
    trial, mask = problem.trials[index], problem.mask(index)
    found = [
        (name, UNITS[name], trial.time[mask], trial.velocity[:, c], mask, left[:, c])
        for c, name in enumerate(CHANNELS)
        if trial.measured[c]
    ]
    for own in of_sensors(problem, x, index) if not found else ():
        sensor, scored, error = own.sensor, own.scored, own.sensor.values - own.predicted
        found += [
            (f"{sensor.name} {name}", unit, sensor.time[scored], sensor.values[:, c], scored, error[scored, c])
            for c, (name, unit) in enumerate(zip(sensor.channels, sensor.units, strict=True))
        ]
    return tuple(
        ChannelError(name, unit, time, every[there], error, (float(every.min()), float(every.max())))
        for name, unit, time, every, there, error in found
    )


@dataclass(frozen=True, eq=False)
class Score:
    """Residuals of one model on the held-out trials.

    Attributes:
        residuals: (n_r, 3) of the velocities per trial, scored samples only, physical units.
        predictions: (n_r, 3) per trial, all samples.
        whitened: the scored residuals of velocities and sensors in the metric of the noise, (rows,) per trial.
        sensors: per trial, those of its sensors.
        channels: per trial, what is left of its channels.
        trial_parameters: per trial, its own parameters.
    """

    residuals: tuple[FloatArray, ...]
    predictions: tuple[FloatArray, ...]
    whitened: tuple[FloatArray, ...]
    sensors: tuple[tuple[SensorResidual, ...], ...] = ()
    channels: tuple[tuple[ChannelError, ...], ...] = ()
    trial_parameters: tuple[FloatArray, ...] = ()

    @property
    def nbytes(self) -> int:
        """Bytes of velocities and whitened residuals."""
        return sum(block.nbytes for block in (*self.residuals, *self.predictions, *self.whitened))


def predict_held_out(fitted: Problem, values: Mapping[str, float], trials: tuple[Trial, ...]) -> Score:
    """Predict `trials` with the fitted model's values; their nuisance parameters come from their own first part."""
    # In this process: to send all fitted runs along with one takes longer.
    found = [*mapped(partial(_predicted, fitted, values=values), trials)]
    return Score(*map(tuple, zip(*found, strict=True))) if found else Score((), (), ())


def _predicted(
    fitted: Problem, trial: Trial, values: Mapping[str, float]
) -> tuple[FloatArray, FloatArray, FloatArray, tuple[SensorResidual, ...], tuple[ChannelError, ...], FloatArray]:
    """Return what `Score` has of a trial."""
    alone, first = _alone(fitted, values, trial)
    x = alone.start() if first is alone else fit_or_raise(first, alone.start(), tolerance=1e-6, evaluations=_MOST).x
    return (
        alone.raw(x)[0], alone.predictions(x)[0], alone.residual(x)[: alone.measured], of_sensors(alone, x, 0),
        channel_errors(alone, x)[0], x,
    )  # fmt: skip


def held_out_covariance_root(
    fitted: Problem, found: Fit, trials: tuple[Trial, ...], own: tuple[FloatArray, ...]
) -> FloatArray:
    """Return whitened columns D (n, k) of the scored samples of all trials; D D' is the covariance of the prediction.

    D = (J C^(1/2), J_o C_o^(1/2)). C is the covariance of the model's free parameters. C_o is that of a trial's own
    parameters, which are fitted to its first part. J is the derivative by the former, the latter fitted anew; J_o is
    the derivative by the latter.

    Args:
        fitted, found: the problem and its fit.
        trials: held out.
        trial_parameters: parameters of each of them, see `Score`.
    """
    rows = [i for i, p in enumerate(found.parameters) if ":" not in p.name]
    values, vectors = np.linalg.eigh(found.covariance[np.ix_(rows, rows)])
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    derived = mapped(partial(_derived, fitted, values=found.values), [*zip(trials, own, strict=True)])
    slopes, doubts = zip(*derived, strict=True)
    return np.hstack([np.concatenate(slopes) @ root, linalg.block_diag(*doubts)])


def _derived(
    fitted: Problem, task: tuple[Trial, FloatArray], values: Mapping[str, float]
) -> tuple[FloatArray, FloatArray]:
    """Return J and J_o C_o^(1/2) of a trial with its own parameters."""
    trial, x = task
    alone, first = _alone(fitted, values, trial)
    free, before = (replace(one, fixed=fitted.fixed) for one in (alone, first))
    here = free.start({**alone.named(x), **values})
    mine = np.array([":" not in p.name for p in free.parameters])
    scored, told = free.jacobian(here).dense(), before.jacobian(here).above(before.prior_root).dense()
    basis, triangle = np.linalg.qr(told[:, ~mine])
    own = scored[: free.measured, ~mine] @ np.linalg.pinv(triangle)
    return scored[: free.measured, mine] - own @ (basis.T @ told[:, mine]), own


def _alone(fitted: Problem, values: Mapping[str, float], trial: Trial) -> tuple[Problem, Problem]:
    """Return the problems of a trial's scored samples, and of those that its own parameters are fitted to.

    They are the same where it has no parameters of its own.
    """
    shared = {name: value for name, value in {**fitted.fixed, **values}.items() if ":" not in name}
    alone = replace(fitted, trials=(trial,), fixed=shared, windows=None)
    if not nuisances(trial, fitted.free_clock, fitted.walk):
        return alone, alone
    read = () if alone.samples else (s.time[alone.sensor_mask(0, s)] for s in trial.sensors)
    counted = np.concatenate([trial.time[alone.mask(0)], *read])
    split = float(counted.min() + PREFIX * np.ptp(counted))
    first = replace(alone, windows=((-np.inf, split),))
    return replace(alone, windows=((float(np.nextafter(split, np.inf)), np.inf),)), first


def trial_parameters(fitted: Problem, values: Mapping[str, float], trials: Sequence[Trial]) -> dict[str, float]:
    """Return the parameters of trials that were not fitted, each fitted to all of its trial with the others frozen."""
    shared = {name: value for name, value in {**fitted.fixed, **values}.items() if ":" not in name}
    found: dict[str, float] = {}
    for trial in trials:
        alone = replace(fitted, trials=(trial,), fixed=shared, windows=None)
        if alone.parameters:
            found |= fit_or_raise(alone, alone.start(), tolerance=1e-6, evaluations=_MOST).values
    return found


@dataclass(frozen=True, eq=False)
class SensorResidual:
    """What a sensor of a trial measured and what it is predicted to read.

    Attributes:
        sensor: of the trial.
        predicted: (m, c) at all its samples; NaN after a divergence.
        scored: (m,) samples that are scored.
    """

    sensor: Sensor
    predicted: FloatArray
    scored: BoolArray


@dataclass(frozen=True, eq=False)
class Residual:
    """Measured minus predicted velocities of one trial.

    Attributes:
        trial: that was predicted.
        role: ``fit`` or ``held_out``.
        predicted: (n, 3) at all its samples; NaN after a divergence.
        counted: (n,) samples that the fit looks at; a predictor may feed them back.
        scored: (n,) those of them that are scored; of a held-out trial, without the part that its own nuisance
            parameters were fitted on.
        sensors: the same of its sensors.
    """

    trial: Trial
    role: Role
    predicted: FloatArray
    counted: BoolArray
    scored: BoolArray
    sensors: tuple[SensorResidual, ...] = ()

    @property
    def diverged(self) -> bool:
        """Whether the rollout did not reach every sample that counts."""
        return not bool(np.all(np.isfinite(self.predicted[self.counted])))

    @property
    def values(self) -> FloatArray:
        """Residuals (n, 3) in physical units; NaN where a sample is missing or does not count."""
        return np.where(self.counted[:, None], self.trial.velocity - self.predicted, np.nan)

    def on_grid(self, block: FloatArray) -> FloatArray:
        """Spread a block (n, ...) over the grid: (m, ...), NaN between."""
        spread = np.full((int(self.trial.rows[-1]) + 1, *block.shape[1:]), np.nan)
        spread[self.trial.rows] = block
        return spread


def fitted(problem: Problem, x: FloatArray) -> tuple[Residual, ...]:
    """Return the residuals of the trials of a problem at `x`; all counted samples are scored."""
    return tuple(
        Residual(trial, "fit", predicted, problem.mask(i), problem.mask(i), of_sensors(problem, x, i))
        for i, (trial, predicted) in enumerate(zip(problem.trials, problem.predictions(x), strict=True))
    )


def of_sensors(problem: Problem, x: FloatArray, index: int) -> tuple[SensorResidual, ...]:
    """Return what the sensors of a trial measured, and what they are predicted to read at `x`.

    Errors of its joints are allowed for as far as samples before its window tell them.
    """
    trial = problem.trials[index]
    reads = problem.prediction(trial, problem.named(x)).sensors if trial.sensors else ()
    moved = problem.explained(index, [sensor.values - read for sensor, read in zip(trial.sensors, reads, strict=True)])
    return tuple(
        SensorResidual(sensor, read + by, problem.sensor_mask(index, sensor))
        for sensor, read, by in zip(trial.sensors, reads, moved, strict=True)
    )


def held_out(problem: Problem, values: Mapping[str, float], trials: tuple[Trial, ...]) -> tuple[Residual, ...]:
    """Return the residuals of held-out trials, predicted as `mjfish.estimation.predict_held_out` does.

    The part that a trial's own nuisance parameters were fitted on counts, for it was measured before what is
    scored, but is not scored.
    """
    score = predict_held_out(problem, values, trials)
    result = []
    for trial, left, predicted, sensors in zip(trials, score.residuals, score.predictions, score.sensors, strict=True):
        counted = replace(problem, trials=(trial,), windows=None).mask(0)
        scored = np.zeros_like(counted)
        scored[np.flatnonzero(counted)[np.count_nonzero(counted) - len(left) :]] = True
        result.append(Residual(trial, "held_out", predicted, counted, scored, sensors))
    return tuple(result)
