"""Columns that single runs have, tested beyond what the free parameters explain, in time linear in runs.

With the derivative J of the whitened prediction by the free parameters, an orthonormal basis Q of its span, and columns
W_r of run r alone, W = diag(W_1 .. W_R): what J and W explain together, less what J does. Nothing as large as W' W is
kept.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mjfish.arrays import FloatArray
from mjfish.block_angular import Basis, BlockAngular, explained, span
from mjfish.diagnosis.sign_flips import tail_of_flips


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
