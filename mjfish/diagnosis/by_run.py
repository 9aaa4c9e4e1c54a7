"""Columns that single runs have, tested beyond what the free parameters explain, in time linear in runs.

With the derivative J of the whitened prediction by the free parameters, an orthonormal basis Q of its span, and columns
W_r of run r alone, W = diag(W_1 .. W_R): what J and W explain together, less what J does. Nothing as large as W' W is
kept.

**Flips.** How much of noise with outliers a basis explains by chance: its distribution over all flips of the signs.
What m orthonormal columns q explain of Gaussian noise is chi2(m). One outlier adds to it by far more. With independent,
symmetric noise every sign is as likely as the other, given all sizes |z| ([Hemerik2020]), and over all flips

    T = |q'z|^2,  A = q' diag(z^2) q:   mean = tr A,   variance = 2 (|A|^2 - sum_i |q_i|^4 z_i^4)

with rows q_i. A misfit has equal signs in a row: flipped, little of it is left. The tail is that of a multiple of a
chi2 with this mean and variance.

[Hemerik2020] J. Hemerik, J. Goeman and L. Finos, Robust testing in generalized linear models by sign flipping score
contributions, JRSS B 82.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import stats

from mjfish.arrays import FloatArray, principal_axes
from mjfish.block_angular import Basis, BlockAngular, explained, span


def flipped_p(columns: FloatArray, residual: FloatArray) -> float:
    """Return the p value of what columns (n, k) explain of a residual (n,), over all flips of its signs.

    Args:
        columns: what the fitted parameters leave of them; they may depend on each other.
        residual: whitened, of the fit.
    """
    axes = Basis((), columns @ principal_axes(columns.T @ columns))
    return tail_of_flips(axes, Basis((), np.zeros((len(columns), 0))), residual)


def tail_of_flips(both: Basis, first: Basis, residual: FloatArray) -> float:
    """Return the p value of z' (Q Q' - P P') z over all flips of the signs, Q = `both`, P = `first`."""
    squares, leverage = residual**2, both.leverage() - first.leverage()
    mean = float(np.sum(leverage * squares))
    spread = both.square(both, squares) - 2.0 * both.square(first, squares) + first.square(first, squares)
    variance = 2.0 * float(spread - np.sum((leverage * squares) ** 2))
    if not min(mean, variance) > 0.0:
        return 1.0
    explained = both.explained(residual) - first.explained(residual)
    return float(stats.chi2.sf(2.0 * explained * mean / variance, 2.0 * mean**2 / variance))


@dataclass(frozen=True, eq=False)
class ByRun:
    """Columns of single runs beside the parameters of a fit.

    Attributes:
        jacobian: (n, p) J.
        basis: Q.
        columns: (n, k) W: no shared ones.
    """

    jacobian: BlockAngular
    basis: Basis
    columns: BlockAngular

    def statistic(self, cleared: FloatArray) -> tuple[float, int]:
        """Return what W explains of a residual (n,) that J explains nothing of, and the rank that W adds to J."""
        both, rank = explained(self.jacobian.beside(self.columns), cleared)
        return both, rank - self.basis.rank

    def flipped_p(self, cleared: FloatArray) -> float:
        """Return the p value of the statistic over all flips of signs."""
        return tail_of_flips(span(self.jacobian.beside(self.columns)), self.basis, cleared)

    def fitted(self, cleared: FloatArray) -> FloatArray:
        """Return what the columns explain (n,) of a residual."""
        return np.asarray(cleared - span(self.jacobian.beside(self.columns)).off(cleared))
