r"""The chance of a right verdict on two rivals, given the data at hand.

The margin of the data, m = SSE_l - SSE_k, is known. A run more, were k true at its own fit, adds to it

    g_{k|l} = min over dx of |d_m - J_m dx|^2 + |J dx|^2,   d_m = eta_k - eta_l on the run,

on average: what the refit of l cannot follow, d_m'(1 + J_m C J_m')^-1 d_m with C the covariance of l's estimates
([Buzzi-Ferraris1984]); its variance is 4 g. A verdict drops l once the margin passes the 95 % point of what it would be
were l the truth, -lambda_{l|k} + 2 z sqrt(lambda_{l|k}), z = 1.645 (`mjfish.plan.separation`). So

    P_k = Phi((m + g_{k|l} - max(0, 2 z sqrt(lambda_{l|k}) - lambda_{l|k})) / (2 sqrt(g_{k|l})))

with lambda_{l|k} of the data and the run. Which of the two is true has odds exp(m / 2).
Of data not yet taken (m = 0, g = lambda) that is Phi(sqrt(lambda) - z) while lambda is small and Phi(sqrt(lambda) / 2)
beyond; the latter is Phi(sqrt(lambda_k (1 - rho) / 2)) of nearly parallel signatures, lambda = lambda_k (1 - rho^2).
"""

from __future__ import annotations

import numpy as np
from scipy import special, stats

#: 95 % point of the standard normal distribution.
Z95 = 1.6448536269514722


def needed(back: float) -> float:
    """Return the margin that drops the rival l, from lambda_{l|k}."""
    return float(max(0.0, 2.0 * Z95 * np.sqrt(back) - back))


def told(margin: float, gain: float, back: float) -> float:
    """Return P_k, the chance that l is dropped where k is true.

    Args:
        margin: SSE_l - SSE_k of the data at hand.
        gain: g_{k|l} of the run; 0 of none.
        back: lambda_{l|k} of the data and the run.
    """
    return float(stats.norm.cdf((margin + gain - needed(back)) / (2.0 * np.sqrt(max(gain, 1e-12)))))


def chance(margin: float, gains: tuple[float, float], apart: tuple[float, float]) -> float:
    """Return the chance that the true one of (k, l) is told.

    Args:
        margin: SSE_l - SSE_k of the data at hand.
        gains: g_{k|l} and g_{l|k} of the run.
        apart: lambda_{k|l} and lambda_{l|k} of the data and the run.
    """
    first = float(special.expit(0.5 * margin))
    return first * told(margin, gains[0], apart[1]) + (1.0 - first) * told(-margin, gains[1], apart[0])
