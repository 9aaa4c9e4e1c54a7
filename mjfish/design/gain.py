r"""What a run more is expected to add to the margin of two rivals.

The margin of the data, m = SSE_l - SSE_k, is known. With the run, were k true,

    m' - m = (d + u)' P_l (d + u) - u' P_k u,    d = eta_k - eta_l on the run,  u ~ N(0, T_k),
    P = (1 + J C J')^-1,    T_k = 1 + J_k C_k J_k',    C = (J_0'J_0)^-1 of the data at hand,

where u is the noise and what k's estimates are off by ([Buzzi-Ferraris1984]: P_l weighs what a refit of l cannot
follow). What is the run's own, its start, is free in both P and drops out of u. Therefore

    E   = d'P_l d + tr((P_l - P_k) T_k)
    Var = 4 d'P_l T_k P_l d + 2 tr(((P_l - P_k) T_k)^2)

d is made of estimates: noise that the two fits do not share passes for a difference, of which d'P_l d is too large by

    tr(P_l Cov(d)),    Cov(d) = J_k C_k J_k' + J_l C_l J_l' - J_k C_kl J_l' - J_l C_lk J_k',    C_kl = C_k J_0k'J_0l C_l

on average, and that is taken off (down to nothing; of the variance, in the same proportion). It is an approximation:
nothing else is assumed of sizes, and u is as wide as the data leave it. docs/plan.md has how often it was right.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mjfish.arrays import FloatArray
from mjfish.design.sums import Sums, solve


class Gain(NamedTuple):
    """What a run adds to the margin where the first of two rivals is true.

    Attributes:
        mean: on average.
        spread: its standard deviation.
    """

    mean: float
    spread: float


NONE = Gain(0.0, 0.0)


def gain(old: Sums, new: Sums, k: str, l: str) -> Gain:  # noqa: E741 - the equation's
    """Return what a run adds to SSE_l - SSE_k where k is true.

    Args:
        old, new: sums of the pair (`mjfish.design.sums.column`) of the data and of the run.
        k, l: names of the rivals.
    """
    columns, d = _coordinates(new)
    one = np.eye(len(d))
    p_k, p_l = (one - _followed(old + new, columns, rival) for rival in (k, l))
    moves_k, moves_l = (_moves(old.of(rival), columns) for rival in (k, l))
    t_k = one + _squared(moves_k, old)
    raw = float(d @ p_l @ d)
    seen = max(raw - float(np.trace(p_l @ _squared({**moves_k, **{n: -h for n, h in moves_l.items()}}, old))), 0.0)
    turned = (p_l - p_k) @ t_k
    variance = 4.0 * (seen / max(raw, 1e-300)) * float(d @ p_l @ t_k @ p_l @ d) + 2.0 * float(np.trace(turned @ turned))
    return Gain(seen + float(np.trace(turned)), float(np.sqrt(max(variance, 0.0))))


def _coordinates(new: Sums) -> tuple[dict[str, FloatArray], FloatArray]:
    """Return the columns of J by name, and d, in an orthonormal basis (q,) of what they span."""
    joint = np.block([[new.gram, new.moment[:, None]], [new.moment[None, :], np.array([[new.square]])]])
    values, vectors = np.linalg.eigh(joint)
    root = np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T
    return dict(zip(new.names, root.T[:-1], strict=True)), root[:, -1]


def _on_the_run(names: tuple[str, ...], columns: dict[str, FloatArray]) -> FloatArray:
    """Return J (q, p) of the run; what is an old run's own moves nothing there."""
    still = np.zeros(len(next(iter(columns.values()))))
    return np.stack([columns.get(name, still) for name in names], axis=1)


def _followed(total: Sums, columns: dict[str, FloatArray], rival: str) -> FloatArray:
    """Return 1 - P (q, q) of a rival: what a refit to all runs follows."""
    own = total.of(rival)
    j = _on_the_run(own.names, columns)
    return np.asarray(j @ solve(own.gram, j.T))


def _moves(own: Sums, columns: dict[str, FloatArray]) -> dict[str, FloatArray]:
    """Return J C (q,) by column of the data: how noise along it moves the prediction of the run."""
    return dict(zip(own.names, solve(own.gram, _on_the_run(own.names, columns).T), strict=True))


def _squared(moves: dict[str, FloatArray], old: Sums) -> FloatArray:
    """Return the covariance (q, q) of what the noise of the data moves."""
    at = [old.names.index(name) for name in moves]
    h = np.stack(list(moves.values()), axis=1)
    return np.asarray(h @ old.gram[np.ix_(at, at)] @ h.T)
