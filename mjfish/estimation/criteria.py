r"""Information criteria of a fit: what a parameter gained against what it cost.

With K parameters, n scalar samples and the log-likelihood L of the innovations,

    AIC  = -2 L + 2 K                                            [Akaike1974]
    AICc = AIC + 2 K (K + 1) / (n - K - 1)                       [HurvichTsai1989]
    BIC  = -2 L + K log n                                        [Schwarz1978]
    FPE  = det(S) (1 + d / N) / (1 - d / N)                      [Akaike1969]; [Ljung1999], ch. 7.4 and 16.4

where S = (1/N) sum_t e_t e_t' is the covariance of the innovations of the three channels over N sampling times, and d
counts the fitted parameters without those of the noise, as MATLAB's ``fpe`` does. Smaller is better; a difference in
AIC or BIC between models of the same data below 2 says nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from mjfish.arrays import FloatArray
from mjfish.estimation.fit import Fit
from mjfish.estimation.problem import Problem
from mjfish.estimation.residual import Residual, fitted
from mjfish.noise import Autoregressive, Noise


@dataclass(frozen=True)
class Criteria:
    """Criteria of one fit; NaN after a divergence.

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


def criteria(
    problem: Problem,
    fit: Fit,
    residuals: Sequence[Residual] | None = None,
    *,
    noise: Literal["estimated", "stated"] = "estimated",
) -> Criteria:
    """Return the criteria of a fit.

    Args:
        problem: that was fitted.
        fit: its result. Parameters that rest on a bound are not counted: they were not fitted to the data.
        residuals: of the fit, made here where they are not given.
        noise: ``stated``: the noise of the problem is known; compare only fits with the same one. ``estimated``: sigma
            of every channel is the root mean square of the innovations, which is its most likely value, and it and
            the autoregressive coefficients count as parameters.
    """
    free = int(np.count_nonzero(~fit.at_bound))
    return of_residuals(residuals or fitted(problem, fit.x), problem.noise, free, stated=noise == "stated")


def of_residuals(residuals: Sequence[Residual], noise: Noise, free: int, *, stated: bool) -> Criteria:
    """Return the criteria of residuals of a model with `free` fitted parameters; see `criteria`."""
    if any(residual.diverged for residual in residuals):
        return Criteria(0, free, *(np.nan,) * 5)
    model = Autoregressive(noise.sigma, noise.phi)
    parts = [model.innovations(residual.on_grid(residual.values)) for residual in residuals]
    error, variance = (np.concatenate([part[k] for part in parts]) for k in (0, 1))
    there = np.isfinite(error)
    relative = np.where(there, variance, 1.0) / noise.sigma**2
    counted = free
    sigma = noise.sigma
    if not stated:
        squares = np.where(there, error, 0.0) ** 2 / relative
        sigma = np.sqrt(np.maximum(squares.sum(axis=0) / there.sum(axis=0), 1e-300))
        counted += len(sigma) * (1 + noise.order)
    n, likelihood = int(there.sum()), _log_likelihood(error, relative * sigma**2)
    aic = -2.0 * likelihood + 2.0 * counted
    spare = n - counted - 1
    return Criteria(
        samples=n,
        parameters=counted,
        log_likelihood=likelihood,
        aic=aic,
        aicc=aic + 2.0 * counted * (counted + 1) / spare if spare > 0 else np.inf,
        bic=-2.0 * likelihood + counted * float(np.log(n)),
        fpe=final_prediction_error(error / np.sqrt(relative), free),
    )


def final_prediction_error(innovation: FloatArray, parameters: int) -> float:
    """Return det(S) (1 + d/N) / (1 - d/N) of innovations (N, channels); rows with a gap are left out."""
    whole = innovation[np.all(np.isfinite(innovation), axis=1)]
    ratio = parameters / max(len(whole), 1)
    if ratio >= 1.0:
        return np.inf
    return float(np.linalg.det(whole.T @ whole / len(whole)) * (1.0 + ratio) / (1.0 - ratio))


def _log_likelihood(error: FloatArray, variance: FloatArray) -> float:
    """Return log p of independent Gaussian innovations, where there are any."""
    there = np.isfinite(error)
    e, v = error[there], variance[there]
    return float(-0.5 * np.sum(np.log(2.0 * np.pi * v) + e**2 / v))
