"""Residual and Jacobian of a fit in few numbers, trial by trial: what differs between trials is asked of these."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from mjfish.arrays import FloatArray, checked, project_out
from mjfish.estimation.fit import Fit
from mjfish.estimation.problem import Problem
from mjfish.estimation.serial_correlation import Serial, blocks_of, serial_apart

#: Directions weaker than this share of the strongest are not counted.
RANK = 1e-6


@dataclass(frozen=True, eq=False)
class Reduced:
    """Everything in coordinates of J_r = Q_r R_r, trial by trial: few numbers for many samples.

    J_r has the columns of the parameters that trials share, less what those of the trial alone explain.

    Attributes:
        trials: names.
        found: covariance of the residuals in time.
        bases: Q_r (n_r, 3, k) of every trial.
        factors: (trials, k, p) R_r.
        residual: (trials, k) Q_r' e_r.
        omega: (trials, k, k) Q_r' Omega_r Q_r.
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


def reduced(problem: Problem, fit: Fit) -> Reduced:
    """Reduce to the span of each trial's columns; the noise is what is left when each trial is fitted alone.

    What the common fit leaves of trials that differ is no noise, and would hide that they do. Parameters at a bound
    have no columns.
    """
    jacobian = fit.jacobian.chosen(~fit.at_bound).top(problem.samples)
    blocks = blocks_of(problem, fit.residual)
    bases, factors, residual, left = [], [], [], []
    for block in blocks:
        alone, columns = jacobian.at(block.rows)
        e, (q_own, _) = fit.residual[block.rows], np.linalg.qr(alone)
        columns = project_out(q_own, columns)
        full = np.concatenate([columns, np.zeros((max(columns.shape[1] - len(columns), 0), columns.shape[1]))])
        q, r = np.linalg.qr(full)
        q = q[: len(columns)]
        bases.append(block.on_grid(q))
        factors.append(r)
        residual.append(q.T @ e)
        rest = project_out(q, project_out(q_own, e))
        both = block.on_grid(np.hstack([q_own, q]))
        left.append((replace(block, residual=block.on_grid(rest[:, None])[:, :, 0]), both))
    found = serial_apart([block for block, _ in left], [both for _, both in left])
    middles = [found.quadratic_of(r, q) for r, q in enumerate(bases)]
    names = tuple(block.trial for block in blocks)
    return Reduced(names, found, tuple(bases), np.array(factors), np.array(residual), np.array(middles))


def span(columns: FloatArray) -> FloatArray:
    """Return an orthonormal basis of the span of columns, each first scaled to length 1."""
    length = np.linalg.norm(columns, axis=0)
    left, singular, _ = np.linalg.svd(columns[:, length > 0.0] / length[length > 0.0], full_matrices=False)
    return np.asarray(left[:, checked(singular) > RANK * singular.max(initial=0.0)])
