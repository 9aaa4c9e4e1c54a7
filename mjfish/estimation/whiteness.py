"""Is the residual white? Ljung-Box per trial and channel, and per channel over all trials.

    r_k = sum_t e_t e_{t+k} / sum_t e_t^2
    Q   = sum_{k=1..m} r_k^2 / var r_k,     var r_k = n_k / (n (n + 2))

with n samples, n_k pairs at lag k (n - k without gaps: [LjungBox1978]); under white e, Q is about chi-squared with
m - p degrees of freedom, p the order of an autoregressive noise model that was fitted to the same residuals. Its
variance is larger than that of chi-squared, by 1 + 2 m / n (measured: 1.33, 1.16, 1.10, 1.01 at m = 25 and n = 150,
320, 521, 5210, 20000 draws), which is taken into account by matching both moments. The nine coefficients cost no
freedom: they shift r_k by less than their number over the number of samples. Over trials, r_k is the mean weighted by
samples, so that a trial with larger noise does not rule. The mean is not taken out: an offset is a misfit too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from mjfish.arrays import FloatArray
from mjfish.errors import InputError
from mjfish.estimation.residual import Residual
from mjfish.frames import CHANNELS
from mjfish.noise import Autoregressive, Noise

#: Lags that are tested by default, and what a band leaves out.
LAGS = 25
BAND = 0.01
#: Name of the row over all trials.
ALL = "all"


@dataclass(frozen=True, eq=False)
class Autocorrelation:
    """Autocorrelation of the residual of one channel.

    Attributes:
        trial: its name, or ``all``.
        channel: ``surge``, ``sway`` or ``yaw_rate``.
        lag: (m,) in samples, from 1 on.
        value: (m,) r_k.
        band: (m,) half width that 99 % of r_k lie in where the residual is white.
        statistic: Q / (1 + 2 m / n).
        degrees_of_freedom: its degrees of freedom.
        p_value: chance of a larger Q.
    """

    trial: str
    channel: str
    lag: FloatArray
    value: FloatArray
    band: FloatArray
    statistic: float
    degrees_of_freedom: float
    p_value: float


def whiteness(
    residuals: Sequence[Residual], noise: Noise, *, lags: int = LAGS, spent: int | None = None
) -> tuple[Autocorrelation, ...]:
    """Test the residuals of every trial and channel, then of every channel over all trials.

    Args:
        residuals: of the trials.
        noise: what they are said to be; of autoregressive noise, the innovations are tested.
        lags: m; fewer where the shortest trial has less than four samples a lag.
        spent: degrees of freedom that the noise model took; None: its order.

    Raises:
        InputError: no lag can be tested.
    """
    taken = noise.order if spent is None else spent
    white = [_standardised(residual, noise) for residual in residuals]
    m = min([lags, *(int(np.isfinite(block).sum(axis=0).min()) // 4 for block in white)])
    if m - taken < 1:
        raise InputError(
            f"whiteness: {m} lags can be tested and the noise model took {taken}; expected more lags than that; "
            "record longer trials or ask for more lags"
        )
    found = []
    for channel, name in enumerate(CHANNELS):
        values, variances, weights = [], [], []
        for residual, block in zip(residuals, white, strict=True):
            value, variance, n = _correlation(block[:, channel], m)
            found.append(_tested(residual.trial.name, name, value, variance, m - taken, n))
            values.append(value)
            variances.append(variance)
            weights.append(n)
        share = np.array(weights)[:, None] / max(sum(weights), 1)
        pooled = (np.sum(share * values, axis=0), np.sum(share**2 * variances, axis=0))
        found.append(_tested(ALL, name, *pooled, m - taken, sum(weights)))
    return tuple(found)


def _standardised(residual: Residual, noise: Noise) -> FloatArray:
    """Return innovations of unit variance (m, 3) on the grid, NaN in gaps; empty after a divergence."""
    if residual.diverged:
        return np.full((1, 3), np.nan)
    values, variance = Autoregressive(noise.sigma, noise.phi).innovations(residual.on_grid(residual.values))
    return np.asarray(values / np.sqrt(variance))


def _correlation(series: FloatArray, lags: int) -> tuple[FloatArray, FloatArray, int]:
    """Return r_k, var r_k for k = 1..lags, and the number of samples, of a series with gaps."""
    there = np.isfinite(series)
    e, n = np.where(there, series, 0.0), int(there.sum())
    pairs = np.array([np.count_nonzero(there[k:] & there[:-k]) for k in range(1, lags + 1)])
    products = np.array([e[k:] @ e[:-k] for k in range(1, lags + 1)])
    return products / max(float(e @ e), 1e-300), np.maximum(pairs, 1) / (n * (n + 2.0)), n


def _tested(
    trial: str, channel: str, value: FloatArray, variance: FloatArray, degrees_of_freedom: int, n: int
) -> Autocorrelation:
    wider = 1.0 + 2.0 * len(value) / max(n, 1)
    statistic = float(np.sum(value**2 / variance)) / wider
    return Autocorrelation(
        trial=trial,
        channel=channel,
        lag=np.arange(1.0, len(value) + 1.0),
        value=value,
        band=np.asarray(stats.norm.isf(BAND / 2.0) * np.sqrt(variance)),
        statistic=statistic,
        degrees_of_freedom=degrees_of_freedom / wider,
        p_value=float(stats.chi2.sf(statistic, degrees_of_freedom / wider)),
    )
