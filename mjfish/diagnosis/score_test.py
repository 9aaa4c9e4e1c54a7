"""Statistics of the score tests, on whitened residuals e, baseline sensitivities J and effect sensitivities S.

    z = M e,  S^ = M S,  M = I - J (J'J)^+ J',      u = S^' z,  I = S^' S^,      T = u' I^+ u

All statistics are computed after the baseline's sensitivities are projected out: a refit of the coefficients hides most
of an effect, and only what survives it can name one. Amplitudes that cannot be negative count only where they are not.
"""

from __future__ import annotations

from itertools import chain, combinations

import numpy as np
from scipy import special, stats

from mjfish.arrays import BoolArray, FloatArray


def one_sided_statistic(u: FloatArray, information: FloatArray, positive: BoolArray) -> FloatArray:
    """Return T = max over feasible amplitudes psi of 2 u'psi - psi' I psi, for many draws at once.

    The maximum is that of an active set of amplitudes whose unconstrained solution has allowed signs; there are few
    amplitudes (d <= 3 or so), so that all sets are tried.

    Args:
        u: (draws, d) scores.
        information: (d, d).
        positive: (d,) amplitudes that cannot be negative.
    """
    best = np.zeros(len(u))
    for active in chain.from_iterable(combinations(range(len(positive)), k + 1) for k in range(len(positive))):
        index = list(active)
        solution = u[:, index] @ np.linalg.pinv(information[np.ix_(index, index)], hermitian=True)
        feasible = np.all((solution >= 0.0) | ~positive[index], axis=1)
        best = np.maximum(best, np.where(feasible, np.einsum("ij,ij->i", solution, u[:, index]), 0.0))
    return best


def amplitudes(u: FloatArray, information: FloatArray, positive: BoolArray) -> FloatArray:
    """Return the feasible amplitudes psi (d,) that maximise 2 u'psi - psi' I psi."""
    best, found = 0.0, np.zeros(len(u))
    for active in chain.from_iterable(combinations(range(len(positive)), k + 1) for k in range(len(positive))):
        index = list(active)
        solution = np.linalg.pinv(information[np.ix_(index, index)], hermitian=True) @ u[index]
        if np.all((solution >= 0.0) | ~positive[index]) and (value := float(solution @ u[index])) > best:
            best, found = value, np.zeros(len(u))
            found[index] = solution
    return found


def p_value_of(statistic: float, degrees_of_freedom: int) -> float:
    """Return the p value of a likelihood-ratio statistic."""
    return float(stats.chi2.sf(max(statistic, 0.0), degrees_of_freedom))


def log_tail(statistic: FloatArray | float, degrees_of_freedom: int) -> FloatArray:
    """Return log P(chi2(freedom) > statistic): statistics of different size compare on it, however far out.

    Beyond 500, where the tail underflows, by its asymptotic series with a = freedom / 2, x = statistic / 2:
    x^(a - 1) exp(-x) / Gamma(a) (1 + (a - 1) / x + (a - 1)(a - 2) / x^2), [Abramowitz1964] 6.5.32.
    """
    t = np.asarray(statistic, dtype=np.float64)
    a, x = 0.5 * degrees_of_freedom, 0.5 * np.maximum(t, 500.0)
    far = (a - 1.0) * np.log(x) - x - special.gammaln(a) + np.log1p((a - 1.0) / x * (1.0 + (a - 2.0) / x))
    return np.where(t > 500.0, far, stats.chi2.logsf(np.minimum(t, 500.0), degrees_of_freedom))
