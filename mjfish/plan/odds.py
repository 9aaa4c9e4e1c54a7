r"""The chance of a right verdict on two rivals, given the data at hand.

The margin of the data, m = SSE_l - SSE_k, is known. A run more, were k true at its own fit, adds to it

    g_{k|l} = min over dx of |d_m - J_m dx|^2 + |J dx|^2,   d_m = eta_k - eta_l on the run,

on average: what the refit of l cannot follow, d_m'(1 + J_m C J_m')^-1 d_m with C the covariance of l's estimates
([Buzzi-Ferraris1984]); its variance is 4 g. A verdict drops l once its likelihood is a tenth of that of k
(`mjfish.diagnose.select.CLOSE`); that noise would lead so far in less than 5 % of cases, were l the truth, is then so
too: 2 z sqrt(lambda) - lambda, z = 1.645, is 2.7 at most. So

    P_k = Phi((m + g_{k|l} - 2 ln 10) / (2 sqrt(g_{k|l})))

Which of the two is true has odds exp(m / 2). Of data not yet taken (m = 0, g = lambda) and large lambda that tends to
Phi(sqrt(lambda) / 2), which is Phi(sqrt(lambda_k (1 - rho) / 2)) of nearly parallel signatures, lambda = lambda_k
(1 - rho^2).
"""

from __future__ import annotations

import numpy as np
from scipy import special, stats

from mjfish.diagnose.select import CLOSE


def drops(margin: float) -> bool:
    """Return whether a verdict drops the rival l at the margin SSE_l - SSE_k."""
    return margin >= CLOSE


def told(margin: float, gain: float) -> float:
    """Return P_k, the chance that l is dropped where k is true.

    Args:
        margin: SSE_l - SSE_k of the data at hand.
        gain: g_{k|l} of the run; 0 of none.
    """
    return float(stats.norm.cdf((margin + gain - CLOSE) / (2.0 * np.sqrt(max(gain, 1e-12)))))


def chance(margin: float, gains: tuple[float, float]) -> float:
    """Return the chance that the true one of (k, l) is told.

    Args:
        margin: SSE_l - SSE_k of the data at hand.
        gains: g_{k|l} and g_{l|k} of the run.
    """
    first = float(special.expit(0.5 * margin))
    return first * told(margin, gains[0]) + (1.0 - first) * told(-margin, gains[1])
