r"""The chance of a right verdict on two rivals, given the data at hand.

The margin of the data, m = SSE_l - SSE_k, is known; what a run adds to it where k is true has a mean g and a standard
deviation s (`mjfish.design.gain`). A verdict drops l once its likelihood is a tenth of that of k
(`mjfish.diagnosis.select.CLOSE`); that noise would lead so far in less than 5 % of cases, were l the truth, is then so
too: 2 z sqrt(lambda) - lambda, z = 1.645, is 2.7 at most. So

    P_k = Phi((m + g - 2 ln 10) / s)

Which of the two is true has odds exp(m / 2). Of data not yet taken, of parameters that are known and of large lambda
(m = 0, g = lambda, s = 2 sqrt(lambda)) that tends to Phi(sqrt(lambda) / 2), which is Phi(sqrt(lambda_k (1 - rho) / 2))
of nearly parallel signatures, lambda = lambda_k (1 - rho^2).
"""

from __future__ import annotations

from scipy import special, stats

from mjfish.design.gain import Gain
from mjfish.diagnosis.select import CLOSE


def drops(margin: float) -> bool:
    """Return whether a verdict drops the rival l at the margin SSE_l - SSE_k."""
    return margin >= CLOSE


def told(margin: float, gain: Gain) -> float:
    """Return P_k, the chance that l is dropped where k is true.

    Args:
        margin: SSE_l - SSE_k of the data at hand.
        gain: of the run, where k is true; `mjfish.design.gain.NONE` without one.
    """
    return float(stats.norm.cdf((margin + gain.mean - CLOSE) / max(gain.spread, 1e-6)))


def chance(margin: float, gains: tuple[Gain, Gain]) -> float:
    """Return the chance that the true one of (k, l) is told.

    Args:
        margin: SSE_l - SSE_k of the data at hand.
        gains: of the run, where k is true and where l is.
    """
    first = float(special.expit(0.5 * margin))
    return first * told(margin, gains[0]) + (1.0 - first) * told(-margin, gains[1])
