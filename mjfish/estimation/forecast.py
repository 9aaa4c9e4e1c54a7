"""Forecasts of autoregressive noise some samples ahead, exact where samples are missing.

The residual v of a simulation, v_t = sum_j phi_j v_{t-j} + sigma eps_t, is carried by the state
s_t = (v_t, ..., v_{t-p+1}), s_t = F s_{t-1} + (sigma eps_t, 0, ...), F the companion matrix of phi. A Kalman filter
without measurement noise starts from the stationary covariance and passes over gaps; its forecast

    v_{t+k|t} = (F^k s_{t|t})_1

is the conditional mean given every sample up to t ([Ljung1999], ch. 3.2; [Jones1980] on gaps).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import linalg

from mjfish.arrays import FloatArray
from mjfish.errors import InputError
from mjfish.estimation.noise import Noise


@dataclass(frozen=True, eq=False)
class Filtered:
    """What the filter knows about one channel.

    Attributes:
        state: (m, p) s_{t|t}.
        innovation: (m,) v_t minus its forecast one sample ahead; NaN in gaps.
        variance: (m,) of the innovation: sigma^2, more at the start and after gaps.
    """

    state: FloatArray
    innovation: FloatArray
    variance: FloatArray


def forecast(noise: Noise, residual: FloatArray, steps: int) -> FloatArray:
    """Return forecasts of a residual from what was measured `steps` samples and more before.

    Args:
        noise: of the residual, per channel.
        residual: (m, 3) on a grid of equal intervals, NaN in gaps.
        steps: k, at least 1.

    Returns:
        (m, 3); zero, its mean, for the first k samples, which have nothing to look back on.
    """
    if steps < 1:
        raise InputError(f"a forecast {steps} samples ahead, expected 1 or more; correct the horizon")
    ahead = np.zeros_like(residual)
    if noise.order == 0 or steps >= len(residual):
        return ahead
    for channel in range(residual.shape[1]):
        phi = noise.phi[channel]
        state = filtered(residual[:, channel], phi, float(noise.sigma[channel])).state
        ahead[steps:, channel] = state[:-steps] @ np.linalg.matrix_power(linalg.companion([1.0, *-phi]), steps)[0]
    return ahead


def innovations(noise: Noise, residual: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return innovations (m, 3) of a residual (m, 3), NaN in gaps, and their variances (m, 3).

    Where the noise model holds, each over the root of its variance is white and of variance 1, from the first sample
    on.
    """
    parts = [
        filtered(residual[:, channel], noise.phi[channel], float(noise.sigma[channel]))
        for channel in range(residual.shape[1])
    ]
    return np.stack([p.innovation for p in parts], axis=1), np.stack([p.variance for p in parts], axis=1)


def filtered(series: FloatArray, phi: FloatArray, sigma: float) -> Filtered:
    """Run the filter over one channel (m,), NaN in gaps."""
    order = len(phi)
    if order == 0:
        return Filtered(np.zeros((len(series), 0)), series.copy(), np.full(len(series), sigma**2))
    transition = linalg.companion([1.0, *-phi])
    if np.max(np.abs(linalg.eigvals(transition))) >= 1.0:
        raise InputError(f"autoregressive noise {phi.tolist()} grows without bound; give a stationary one")
    drive = np.zeros((order, order))
    drive[0, 0] = sigma**2
    mean, covariance = np.zeros(order), linalg.solve_discrete_lyapunov(transition, drive)
    states, innovation, variance = np.empty((len(series), order)), np.empty(len(series)), np.empty(len(series))
    for t, seen in enumerate(series):
        if t > 0:
            mean, covariance = transition @ mean, transition @ covariance @ transition.T + drive
        innovation[t], variance[t] = seen - mean[0], max(covariance[0, 0], sigma**2)
        if np.isfinite(seen):
            gain = covariance[:, 0] / variance[t]
            mean = mean + gain * innovation[t]
            covariance = covariance - np.outer(gain, covariance[0])
        states[t] = mean
    return Filtered(states, innovation, variance)
