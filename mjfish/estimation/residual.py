"""Residuals of single trials, and what they say: scores, predictions some samples ahead, information criteria.

A held-out trial is scored with everything frozen that was fitted elsewhere. What belongs to it alone (start velocity,
free clock) is fitted on its first part, and that part is left out of the score: nothing that is scored was fitted to.

How well a model agrees with measured velocities:

    RMSE  = sqrt(mean (y - yhat)^2)
    nRMSE = RMSE / (max y - min y)                              [Yu2016], below Table IV
    fit   = 100 (1 - |y - yhat| / |y - mean y|)                 percent, as MATLAB's ``compare`` prints it

A simulation knows the drive alone. A prediction k samples ahead is also told every measurement up to k samples before:

    yhat_{t+k|t} = simulation_{t+k} + v_{t+k|t}

with v the residual of the simulation, taken for autoregressive noise ([Ljung1999], ch. 3.2, the Box-Jenkins structure
with C = 1). Of the two forms that nlgreyest's users know it is the exact one here: the fit is an output-error fit, the
disturbance is added to the velocity, and nothing has to be linearised or tuned, as in a Kalman filter on the swimming
state. It errs on the side of the simulation: with white residuals it is the simulation.

Information criteria weigh what a parameter gained against what it cost. With K parameters, n scalar samples and the
log-likelihood L of the innovations,

    AIC  = -2 L + 2 K                                            [Akaike1974]
    AICc = AIC + 2 K (K + 1) / (n - K - 1)                       [HurvichTsai1989]
    BIC  = -2 L + K log n                                        [Schwarz1978]
    FPE  = det(S) (1 + d / N) / (1 - d / N)                      [Akaike1969]; [Ljung1999], ch. 7.4 and 16.4

where S = (1/N) sum_t e_t e_t' is the covariance of the innovations of the three channels over N sampling times, and d
counts the fitted parameters without those of the noise, as MATLAB's ``fpe`` does. Smaller is better; a difference in
AIC or BIC between models of the same data below 2 says nothing.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import Literal

import numpy as np
from scipy import linalg

from mjfish.data import Role, Sensor, Trial
from mjfish.data.trial import seen_of
from mjfish.estimation.fit import Fit, fit_or_raise
from mjfish.estimation.problem import Problem, nuisances
from mjfish.execution import mapped
from mjfish.fish.frames import CHANNELS, UNITS
from mjfish.noise import Autoregressive, Noise, estimate
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
        scored = counted & (np.cumsum(counted) > np.count_nonzero(counted) - len(left))
        result.append(Residual(trial, "held_out", predicted, counted, scored, sensors))
    return tuple(result)


Part = Literal["whole", "start_up", "change", "steady"]
#: Samples ahead that are scored by default: the next one, a part of a beat, and more than one (at 50 Hz).
HORIZONS = (1, 5, 25)
#: Beats from a step of the drive until the fish swims steadily: its speed is within 6 % of its last one then. In beats,
#: because the model is the same in time units of the beat (docs/theory.md).
SETTLING = 10.0
#: Intervals between samples that differ by less than this share are the same.
_SAME_RATE = 0.01


@dataclass(frozen=True)
class Agreement:
    """One number set: of one trial, channel, part of the trial and predictor.

    Attributes:
        trial: its name.
        role: ``fit`` or ``held_out``.
        channel: ``surge``, ``sway`` or ``yaw_rate``.
        part: ``whole``; ``start_up`` from rest, ``change`` after a later step of the drive, ``steady`` otherwise.
        horizon: samples ahead; None: simulated.
        samples: scored.
        rmse: in `unit`.
        range: of the measurement, over the whole trial, in `unit`.
        nrmse: rmse / range.
        fit: percent; the mean is that of the scored samples. NaN where they do not vary.
        unit: of the channel.
    """

    trial: str
    role: Role
    channel: str
    part: Part
    horizon: int | None
    samples: int
    rmse: float
    range: float
    nrmse: float
    fit: float
    unit: str


def agreement(
    residuals: Sequence[Residual],
    *,
    horizons: Sequence[int] = HORIZONS,
    noise: Autoregressive | None = None,
    settling: float = SETTLING,
) -> tuple[Agreement, ...]:
    """Score simulation and prediction of every trial and channel, whole and in parts.

    Args:
        residuals: of the trials, fitted or held out.
        horizons: samples ahead of the predictions.
        noise: that forecasts the residuals, in physical units; None: estimated from the residuals of the trials that
            were fitted (from all, if none was), order by BIC, one for every sampling rate. Held-out trials have no say.
        settling: beats from a step of the drive until the fish swims steadily.

    Returns:
        Rows by trial, channel that was measured, part, horizon; parts only where the drive tells them. NaN for a
        rollout that diverged, and for predictions of a trial that has not all channels.
    """
    rows, estimated = [], cache(partial(noise_at, residuals))
    for residual in residuals:
        own = noise
        if own is None and horizons and not residual.diverged and residual.trial.measured.all():
            own = estimated(float(f"{residual.trial.step:.9g}"))  # times that were rounded are of one step
        where = parts_of_trial(residual.trial, settling)
        left: dict[int | None, FloatArray] = {None: residual.values, **_unforecast(residual, own, horizons)}
        for channel in np.flatnonzero(residual.trial.measured).tolist():
            for part, inside in where.items():
                rows += [_row(residual, channel, part, inside, k, values) for k, values in left.items()]
    return tuple(rows)


def parts_of_trial(trial: Trial, settling: float = SETTLING) -> dict[Part, BoolArray]:
    """Return which samples (n,) belong to which part of a trial; where joints were measured, all that is known is all.

    A part without samples is left out.
    """
    found: dict[Part, BoolArray] = {"whole": np.ones(len(trial.time), dtype=np.bool_)}
    if not trial.drive:
        return found
    starts = np.array([segment.start for segment in trial.drive])
    period = 2.0 * np.pi / np.array([segment.omega for segment in trial.drive])
    index = np.clip(np.searchsorted(starts, trial.time, side="right") - 1, 0, None)
    unsettled = trial.time - starts[index] < settling * period[index]
    split: dict[Part, BoolArray] = {
        "start_up": unsettled & (index == 0),
        "change": unsettled & (index > 0),
        "steady": ~unsettled,
    }
    return found | {part: inside for part, inside in split.items() if np.any(inside)}


def noise_at(residuals: Sequence[Residual], step: float) -> Autoregressive:
    """Estimate the noise of the residuals that are sampled at `step` [s], of fitted trials where there are any."""
    good = [r for r in residuals if r.trial.measured.all() and not r.diverged]
    same_rate = [r for r in good if abs(r.trial.step / step - 1.0) < _SAME_RATE]
    chosen = [r for r in same_rate if r.role == "fit"] or same_rate
    there = [np.all(np.isfinite(r.values), axis=1) for r in chosen]
    kept = [(r.values[inside], r.trial.rows[inside]) for r, inside in zip(chosen, there, strict=True) if np.any(inside)]
    return estimate([block for block, _ in kept], seen=[seen_of(rows - rows[0]) for _, rows in kept])


def _unforecast(
    residual: Residual, noise: Autoregressive | None, horizons: Sequence[int]
) -> dict[int | None, FloatArray]:
    """Return, by horizon, residuals (n, 3) less their forecasts; NaN where no noise is known."""
    if noise is None:
        return {steps: np.full_like(residual.values, np.nan) for steps in horizons}
    ahead = noise.forecasts(residual.on_grid(residual.values), horizons)
    return {steps: residual.values - forecast[residual.trial.rows] for steps, forecast in ahead.items()}


def _row(
    residual: Residual, channel: int, part: Part, inside: BoolArray, horizon: int | None, left: FloatArray
) -> Agreement:
    measured = residual.trial.velocity[:, channel]
    scored = residual.scored & inside & np.isfinite(measured)
    y, error = measured[scored], left[scored, channel]
    rmse = float(np.sqrt(np.mean(error**2))) if len(y) else np.nan
    span = float(np.ptp(measured[np.isfinite(measured)]))
    deviation = float(np.linalg.norm(y - y.mean())) if len(y) else 0.0
    return Agreement(
        trial=residual.trial.name,
        role=residual.role,
        channel=CHANNELS[channel],
        part=part,
        horizon=horizon,
        samples=len(y),
        rmse=rmse,
        range=span,
        nrmse=rmse / span if span > 0.0 else np.nan,
        fit=100.0 * (1.0 - float(np.linalg.norm(error)) / deviation) if deviation > 0.0 else np.nan,
        unit=UNITS[CHANNELS[channel]],
    )


@dataclass(frozen=True)
class Criteria:
    """Criteria of one fit; NaN after a divergence, and where a trial has not all velocities: they are the data here.

    Attributes:
        samples: n, scalar.
        parameters: K: the fitted ones off their bounds, and those of the noise where it was estimated.
        log_likelihood: L, Gaussian.
        aic: Akaike's criterion.
        aicc: corrected for few samples; infinite where n <= K + 1.
        bic: Schwarz's criterion.
        fpe: final prediction error [(m/s)^2 (m/s)^2 (rad/s)^2]; infinite where N <= d.
    """

    samples: int
    parameters: int
    log_likelihood: float
    aic: float
    aicc: float
    bic: float
    fpe: float


def criteria(problem: Problem, fit: Fit, *, noise: Literal["estimated", "stated"] = "estimated") -> Criteria:
    """Return the criteria of a fit.

    Args:
        problem: that was fitted.
        fit: its result. Parameters that rest on a bound are not counted: they were not fitted to the data.
        noise: ``stated``: the noise of the problem is known; compare only fits with the same one. ``estimated``: sigma
            of every channel is the root mean square of the innovations, which is its most likely value, and it and
            the autoregressive coefficients count as parameters.
    """
    free = int(np.count_nonzero(~fit.at_bound))
    if fit.lost or not problem.complete:
        return Criteria(0, free, *(np.nan,) * 5)
    determinant = sum(problem.noise.log_determinant(t, problem.mask(i)) for i, t in enumerate(problem.trials))
    return of_whitened(
        fit.residual[: problem.samples].reshape(-1, len(CHANNELS)),
        problem.noise,
        determinant,
        free,
        stated=noise == "stated",
    )


def of_whitened(white: FloatArray, noise: Noise, determinant: float, free: int, *, stated: bool) -> Criteria:
    """Return the criteria of whitened residuals (N, channels) of a model with `free` parameters; see `criteria`.

    `determinant`: the logarithm of that of the noise's covariance.
    """
    counted, squares = free, float(np.sum(white**2))
    if not stated:
        size = np.maximum(np.mean(white**2, axis=0), 1e-300)
        determinant, squares = determinant + len(white) * float(np.sum(np.log(size))), float(white.size)
        counted += len(size) * (1 + noise.order)
    n, spare = white.size, white.size - counted - 1
    likelihood = -0.5 * (n * float(np.log(2.0 * np.pi)) + determinant + squares)
    aic = -2.0 * likelihood + 2.0 * counted
    return Criteria(
        samples=n,
        parameters=counted,
        log_likelihood=likelihood,
        aic=aic,
        aicc=aic + 2.0 * counted * (counted + 1) / spare if spare > 0 else np.inf,
        bic=-2.0 * likelihood + counted * float(np.log(n)),
        fpe=final_prediction_error(white * noise.sigma, free),
    )


def final_prediction_error(innovation: FloatArray, parameters: int) -> float:
    """Return det(S) (1 + d/N) / (1 - d/N) of innovations (N, channels)."""
    ratio = parameters / max(len(innovation), 1)
    if ratio >= 1.0:
        return np.inf
    return float(np.linalg.det(innovation.T @ innovation / len(innovation)) * (1.0 + ratio) / (1.0 - ratio))
