"""The run that holds all of a misfit: something happened in it that is in no other.

Two causes and more, fitted to all runs, can imitate what was odd in one. Without the rows of a run, and with the
coefficients refitted to first order on the others, the joint score of all candidates and the omnibus basis say whether
the others contradict the nominal model at all.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mjfish.arrays import FloatArray, orthonormal, principal_axes, project_out
from mjfish.block_angular import Part
from mjfish.diagnosis.evidence import Evidence, tail
from mjfish.diagnosis.table import THRESHOLDS

#: Fewest runs of which one can be the odd one.
_FEWEST = 4


def lone_run(evidence: Evidence) -> int | None:
    """Return the index of the fitted trial without which nothing contradicts the nominal model; None: of no other one.

    Args:
        evidence: of the nominal model.
    """
    runs = len(evidence.problem.trials)
    if runs < _FEWEST:
        return None
    every = evidence.waves.columns.parts
    small = [_small(evidence, i, every) for i in range(runs)]
    known = _known(evidence)
    alone = [i for i in range(runs) if _least_p([*small[:i], *small[i + 1 :], known], evidence) >= THRESHOLDS.goodness]
    return alone[0] if len(alone) == 1 else None


@dataclass(frozen=True, eq=False)
class _Small:
    """The rows of one run in few numbers, with the parameters of the run eliminated.

    Attributes:
        directed: (m, s + d + 1) shared derivatives, signatures and residual.
        waved: (m, s + 1) shared derivatives and residual, with the waves of the run eliminated, too.
        waves: rank of these.
    """

    directed: FloatArray
    waved: FloatArray
    waves: int


def _small(evidence: Evidence, run: int, every: Sequence[Part]) -> _Small:
    """Return the rows of one run in few numbers; `every` has the omnibus waves of all."""
    rows = evidence.problem.trial_rows[run]
    alone, shared = evidence.jacobian.at(rows)
    waves = next(part for part in every if part.rows[0] == rows[0])
    wave = np.zeros((len(rows), waves.block.shape[1]))
    wave[np.searchsorted(rows, waves.rows)] = waves.block
    residual = evidence.fit.residual[rows, None]
    first, both = orthonormal(alone), orthonormal(np.hstack([alone, wave]))
    directed = project_out(first, np.hstack([shared, evidence.raw[rows], residual]))
    waved = project_out(both, np.hstack([shared, residual]))
    return _Small(_triangle(directed), _triangle(waved), both.shape[1] - first.shape[1])


def _known(evidence: Evidence) -> _Small:
    """Return the rows of what is known of shared parameters, which no run has."""
    rows = slice(evidence.problem.measured, None)
    shared, residual = evidence.jacobian.shared[rows], evidence.fit.residual[rows, None]
    return _Small(np.hstack([shared, evidence.raw[rows], residual]), np.hstack([shared, residual]), 0)


def _triangle(columns: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.qr(columns, mode="r"), dtype=np.float64)


def _least_p(runs: Sequence[_Small], evidence: Evidence) -> float:
    """Return the smaller p value of the candidates' joint score and of the omnibus basis on some runs."""
    count = evidence.jacobian.shared.shape[1]
    directed, waved = (np.concatenate([getattr(run, name) for run in runs]) for name in ("directed", "waved"))
    shared = orthonormal(directed[:, :count])
    left = project_out(shared, directed[:, count:])
    signatures, cleared = left[:, :-1], left[:, -1]
    axes = principal_axes(signatures.T @ signatures)
    directed_p = tail(float(np.sum((axes.T @ (signatures.T @ cleared)) ** 2)), axes.shape[1])
    beside = orthonormal(waved[:, :count])
    behind = project_out(beside, waved[:, -1])
    rank = sum(run.waves for run in runs) + beside.shape[1] - shared.shape[1]
    return min(directed_p, tail(float(cleared @ cleared - behind @ behind), rank))
