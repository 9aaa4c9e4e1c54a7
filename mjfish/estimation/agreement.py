"""How well a model agrees with measured velocities: simulated, predicted some samples ahead, by information criteria.

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

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from mjfish.data import Role, Trial
from mjfish.data.trial import seen_of
from mjfish.estimation.fit import Fit
from mjfish.estimation.problem import Problem
from mjfish.estimation.residual import Residual
from mjfish.fish.frames import CHANNELS, UNITS
from mjfish.noise import Autoregressive, Noise, estimate
from mjfish.numerics.arrays import BoolArray, FloatArray

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
    rows, estimated = [], functools.cache(functools.partial(noise_at, residuals))
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
    white = fit.residual[: problem.samples].reshape(-1, len(CHANNELS))
    return of_whitened(white, problem.noise, determinant, free, stated=noise == "stated")


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
