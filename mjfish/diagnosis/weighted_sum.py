"""Tail of a weighted sum of squares of Gaussian noise, by the saddlepoint [Lugannani1980].

    T = sum_i w_i x_i^2,   K(s) = -1/2 sum_i ln(1 - 2 w_i s),   K'(s) = t
    P(T > t) = 1 - Phi(a + ln(b / a) / a),   a = sign(s) sqrt(2 (s t - K(s))),   b = s sqrt(K''(s))

Right to a few per cent, however far out; a chi2 of the same mean and variance is not where weights differ. Where the
noise is known but for a factor e^h, h ~ N(0, doubt^2), P is the mean over h of P(T > t / e^h).

[Lugannani1980] R. Lugannani and S. Rice, Advances in Applied Probability 12.
"""

from __future__ import annotations

import numpy as np
from scipy import optimize, stats

from mjfish.arrays import FloatArray

#: Weights below this share of the largest are rounding.
_ROUNDING = 1e-10
#: |a| below which the formula is a quotient of rounding errors, and its limit 1/2 - skewness / (6 sqrt(2 pi)) does.
_MIDDLE = 1e-3
#: Nodes of the mean over h.
_NODES = 21


def weighted_tail(statistic: float, weights: FloatArray, doubt: float = 0.0) -> float:
    """Return the p value of a sum of squares.

    Args:
        statistic: t.
        weights: (k,) w, none negative.
        doubt: standard deviation of the logarithm of the variance of the noise.
    """
    weights = weights[weights > _ROUNDING * weights.max(initial=1e-300)]
    if not len(weights) or statistic <= 0.0:
        return 1.0
    if doubt == 0.0:
        return _tail(statistic, weights)
    nodes, shares = np.polynomial.hermite_e.hermegauss(_NODES)
    tails = [_tail(statistic * float(np.exp(-doubt * node)), weights) for node in nodes]
    return float(shares @ tails / shares.sum())


def _tail(t: float, weights: FloatArray) -> float:
    t, w = t / weights.max(), weights / weights.max()
    s = optimize.brentq(lambda s: np.sum(w / (1.0 - 2.0 * w * s)) - t, -0.5 * len(w) / t - 1.0, 0.5 - 1e-13, xtol=1e-15)
    a = np.sign(s) * np.sqrt(max(2.0 * s * t + np.sum(np.log1p(-2.0 * w * s)), 0.0))
    if abs(a) < _MIDDLE:
        return float(0.5 - np.sum(8.0 * w**3) / np.sum(2.0 * w**2) ** 1.5 / (6.0 * np.sqrt(2.0 * np.pi)))
    b = s * np.sqrt(np.sum(2.0 * w**2 / (1.0 - 2.0 * w * s) ** 2))
    return float(stats.norm.sf(a + np.log(b / a) / a))
