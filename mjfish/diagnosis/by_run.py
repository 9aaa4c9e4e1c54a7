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
from mjfish.block_angular import Basis, BlockAngular, Part, explained, span
from mjfish.diagnosis.sign_flips import tail_of_flips
from mjfish.diagnosis.weighted_sum import Ridge, weighted_tail

#: Sum of squares that drawn sizes explain on average.
_DRAWN = 100.0


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

    def drawn(self, cleared: FloatArray, doubt: float = 0.0) -> Drawn:
        """Return the test of sizes of all columns that are drawn alike (`mjfish.diagnosis.weighted_sum`).

        Args:
            cleared: (n,) residual.
            doubt: of the size of the noise.
        """
        values, coupling, score = [], [], []
        for part, (d, b) in zip(self.columns.parts, self.blocks, strict=True):
            own, vectors = np.linalg.eigh(d)
            values.append(np.maximum(own, 0.0))
            coupling.append(vectors.T @ b)
            score.append(vectors.T @ (part.block.T @ cleared[part.rows]))
        if not values:
            return Drawn(self, 1.0, 0.0, 0.0)
        ridge = Ridge.of(np.concatenate(values), np.concatenate(coupling), _DRAWN)
        statistic = ridge.statistic(np.concatenate(score))
        beyond = (statistic - ridge.total) / max(ridge.largest, 1e-300)
        p = weighted_tail(statistic, ridge, doubt)
        if not np.isfinite([p, beyond, ridge.variance]).all():
            raise FloatingPointError("the test of drawn sizes is no number")
        return Drawn(self, p, beyond, ridge.variance)


@dataclass(frozen=True, eq=False)
class Drawn:
    """The outcome of the test of drawn sizes.

    Attributes:
        columns: that were tested.
        p: the p value.
        beyond: a sum of squares that they explain beyond chance, at least.
        variance: of the sizes.
    """

    columns: ByRun
    p: float
    beyond: float
    variance: float

    def flipped_p(self, cleared: FloatArray) -> float:
        """Return the p value of the statistic over all flips of signs.

        z' C z with C = H - Q Q', H the hat matrix of J and of W with rows 1 / a below: a ridge regression.
        """
        if not self.variance > 0.0:
            return 1.0
        both, count = self.columns.jacobian.beside(self.columns.columns), len(cleared)
        first, ridge = self.columns.jacobian.shape[1], 1.0 / np.sqrt(self.variance)
        parts, row = [], count
        for part in both.parts:
            own = np.flatnonzero(part.columns >= first)
            below = np.zeros((len(own), part.block.shape[1]))
            below[np.arange(len(own)), own] = ridge
            rows = np.concatenate([part.rows, row + np.arange(len(own))])
            parts.append(Part(rows, part.columns, np.concatenate([part.block, below])))
            row += len(own)
        shared = np.concatenate([both.shared, np.zeros((row - count, both.shared.shape[1]))])
        hat = span(BlockAngular(shared, both.places, tuple(parts))).top(count)
        return tail_of_flips(hat, self.columns.basis, cleared)
