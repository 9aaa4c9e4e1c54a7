"""Residual and Jacobian of a fit in few numbers, trial by trial: what differs between trials is asked of these."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import linalg

from mjfish.arrays import BoolArray, FloatArray
from mjfish.estimation.serial_correlation import Block, Serial, serial

#: Directions weaker than this share of the strongest are not counted.
RANK = 1e-6


@dataclass(frozen=True, eq=False)
class Reduced:
    """Everything in coordinates of J_r = Q_r R_r, trial by trial: few numbers for many samples.

    Attributes:
        trials: names.
        found: covariance of the residuals in time.
        bases: Q_r (n_r, 3, k) of every trial.
        factors: (trials, k, p) R_r.
        residual: (trials k,) Q_r' e_r.
        omega: (trials k, trials k) Q_r' Omega_r Q_r on its diagonal.
    """

    trials: tuple[str, ...]
    found: Serial
    bases: tuple[FloatArray, ...]
    factors: FloatArray
    residual: FloatArray
    omega: FloatArray

    @property
    def common(self) -> FloatArray:
        """Columns (trials k, p) of parameters that all trials share."""
        return self.factors.reshape(-1, self.factors.shape[2])

    def split(self, place: int) -> FloatArray:
        """Return the column of one parameter as one column a trial (trials k, trials)."""
        return linalg.block_diag(*self.factors[:, :, place, None])


def reduced(blocks: Sequence[Block], free: BoolArray) -> Reduced:
    """Reduce to the span of each trial's own columns; the noise is what is left when each trial is fitted alone.

    What the common fit leaves of trials that differ is no noise, and would hide that they do.
    """
    bases, factors, residual, left = [], [], [], []
    for block in blocks:
        columns = block.jacobian[:, :, free].reshape(3 * len(block.residual), -1)
        full = np.concatenate([columns, np.zeros((max(columns.shape[1] - len(columns), 0), columns.shape[1]))])
        q, r = np.linalg.qr(full)
        q = q[: len(columns)]
        own = q.T @ block.residual.ravel()
        bases.append(q.reshape(-1, 3, q.shape[1]))
        factors.append(r)
        residual.append(own)
        left.append(replace(block, residual=block.residual - (q @ own).reshape(-1, 3)))
    found = serial(left, free, apart=True)
    middles = [np.einsum("tci,tcj->ij", q, found.times(r, q)) for r, q in enumerate(bases)]
    names = tuple(block.trial for block in blocks)
    return Reduced(names, found, tuple(bases), np.array(factors), np.concatenate(residual), linalg.block_diag(*middles))


def span(columns: FloatArray) -> FloatArray:
    """Return an orthonormal basis of the span of columns, each first scaled to length 1."""
    length = np.linalg.norm(columns, axis=0)
    left, singular, _ = np.linalg.svd(columns[:, length > 0.0] / length[length > 0.0], full_matrices=False)
    return np.asarray(left[:, singular > RANK * singular.max(initial=0.0)])
