"""The test of sizes that are drawn at random, and the tail of its weighted sum of squares.

Columns S with scores u = S' z and information I = S' S are tested for sizes that are all drawn from N(0, a^2), against
none [Lin1997]. With the axes V and values v of I,

    T = sum_i a^2 (V' u)_i^2 / (1 + a^2 v_i),   sum_i a^2 v_i = 100

is under noise alone a sum of chi2(1) with weights w = a^2 v / (1 + a^2 v). Where all columns are seen alike it is the
chi2 test of them all. Where some are seen far better, it asks these; chi2 counts all axes alike, and they drown in the
others. 100 is the sum of squares that such sizes explain on average. What is explained beyond chance is at least
(T - sum w) / max w.

The tail is that of the saddlepoint [Lugannani1980]:

    K(s) = -1/2 sum_i ln(1 - 2 w_i s),   K'(s) = t
    P(T > t) = 1 - Phi(a + ln(b / a) / a),   a = sign(s) sqrt(2 (s t - K(s))),   b = s sqrt(K''(s))

Right to a few per cent, however far out; a chi2 of the same mean and variance is not where weights differ. Where the
noise is known but for a factor e^h, h ~ N(0, doubt^2), P is the mean over h of P(T > t / e^h).

[Lin1997] X. Lin, Variance component testing in generalised linear models with random effects, Biometrika 84.
[Lugannani1980] R. Lugannani and S. Rice, Advances in Applied Probability 12.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import optimize, stats

from mjfish.arrays import FloatArray

#: Weights below this share of the largest are rounding.
_ROUNDING = 1e-10
#: |a| below which the formula is a quotient of rounding errors, and its limit 1/2 - skewness / (6 sqrt(2 pi)) does.
_MIDDLE = 1e-3
#: Nodes of the mean over h.
_NODES = 21
#: Sum of squares that the sizes explain on average.
_DRAWN = 100.0


@dataclass(frozen=True, eq=False)
class DrawnSizes:
    """The outcome of the test.

    Attributes:
        p: its p value.
        beyond: a sum of squares that the columns explain beyond chance, at least.
        axes: (columns, k) A, with which T = |A' u|^2.
    """

    p: float
    beyond: float
    axes: FloatArray


def drawn_sizes(score: FloatArray, information: FloatArray, doubt: float = 0.0) -> DrawnSizes:
    """Return the outcome of the test.

    Args:
        score: (columns,) u.
        information: (columns, columns) I.
        doubt: as of `weighted_tail`.
    """
    values, vectors = np.linalg.eigh(information)
    values = np.maximum(values, 0.0)
    variance = _DRAWN / max(float(values.sum()), 1e-300)
    weights = variance * values / (1.0 + variance * values)
    axes = vectors * np.sqrt(variance / (1.0 + variance * values))
    statistic = float(np.sum((axes.T @ score) ** 2))
    beyond = (statistic - float(weights.sum())) / max(float(weights.max(initial=0.0)), 1e-300)
    return DrawnSizes(weighted_tail(statistic, weights, doubt), beyond, axes)


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
