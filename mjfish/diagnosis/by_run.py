"""Columns that single runs have, tested beyond what the free parameters explain, in time linear in runs.

With the derivative J of the whitened prediction by the free parameters, an orthonormal basis Q of its span, and columns
W_r of run r alone, the projector M off J and W = diag(W_1 .. W_R),

    u = W' z,    I = W' M W = D - B B',    D_r = W_r' M_r W_r,    B_r = W_r' Q_s

with M_r off the parameters that run r alone has, and Q_s the part of Q that runs share: a block a run, less a product
of as few columns as there are shared parameters. Nothing of the size of I is kept.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

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
        """Return u' I^+ u and the rank of I, of a residual (n,) that J explains nothing of."""
        both, rank = explained(self.jacobian.beside(self.columns), cleared)
        return both, rank - self.basis.rank

    def flipped_p(self, cleared: FloatArray) -> float:
        """Return the p value of the statistic over all flips of signs."""
        return tail_of_flips(span(self.jacobian.beside(self.columns)), self.basis, cleared)

    def fitted(self, cleared: FloatArray) -> FloatArray:
        """Return what the columns explain (n,) of a residual."""
        return np.asarray(cleared - span(self.jacobian.beside(self.columns)).off(cleared))

    @cached_property
    def blocks(self) -> tuple[tuple[FloatArray, FloatArray], ...]:
        """D_r (k_r, k_r) and B_r (k_r, s) of every run."""
        found = []
        for part in self.columns.parts:
            _, own, shared = self.basis.at(part.rows)
            inside = own.T @ part.block
            found.append((part.block.T @ part.block - inside.T @ inside, part.block.T @ shared))
        return tuple(found)

    @property
    def energy(self) -> tuple[FloatArray, ...]:
        """Diagonal (k_r,) of I in every run."""
        return tuple(np.diag(d) - np.sum(b**2, axis=1) for d, b in self.blocks)
