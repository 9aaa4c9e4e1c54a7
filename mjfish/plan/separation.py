r"""How far apart two rivals are on data that were, and on data that were not yet, measured.

Were rival k the truth, at its own fit, the best that rival l could do after a refit of everything it has leaves

    lambda_{k|l} = min over x_l of |eta_k - eta_l(x_l)|^2,   eta whitened predictions of all runs,

by one Gauss-Newton step from the own fit of l, with d = eta_k - eta_l and J_l = [coefficients, amplitudes of l]:

    lambda_{k|l} = d'd - d'J_l (J_l'J_l)^+ J_l'd

All of it is sums over runs, so that a run more adds its J_l'J_l, J_l'd and d'd: the projection is done anew. To first
order in the effect it is psi_k' D_{k|l} psi_k of the score tests ([Eriksson2013]: distinguishability).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import permutations

import numpy as np

from mjfish.arrays import FloatArray
from mjfish.identify import Problem
from mjfish.parameter import Parameter
from mjfish.plan.fitted import Fitted
from mjfish.plan.menu import Run

#: Directions below this share of the strongest are numerical dust.
_RANK = 1e-10


@dataclass(frozen=True, eq=False)
class Sums:
    """Sums over runs that lambda is made of.

    Attributes:
        names: of the columns of J, in units of the parameters' scales.
        gram: J'J (p, p).
        moment: J'd (p,).
        square: d'd.
    """

    names: tuple[str, ...]
    gram: FloatArray
    moment: FloatArray
    square: float

    def __add__(self, other: Sums) -> Sums:
        """Join runs; columns of the same name are the same parameter."""
        names = (*self.names, *(name for name in other.names if name not in self.names))
        gram, moment = np.zeros((len(names), len(names))), np.zeros(len(names))
        for part in (self, other):
            at = [names.index(name) for name in part.names]
            gram[np.ix_(at, at)] += part.gram
            moment[at] += part.moment
        return Sums(names, gram, moment, self.square + other.square)

    @property
    def apart(self) -> float:
        """Return lambda."""
        explained = self.moment @ solve(self.gram, self.moment[:, None])[:, 0]
        return max(self.square - float(explained), 0.0)


def solve(gram: FloatArray, right: FloatArray) -> FloatArray:
    """Return gram^+ right (p, k) of a positive semi-definite gram, its columns first scaled to length 1."""
    length = np.sqrt(np.maximum(np.diag(gram), 1e-300))
    values, vectors = np.linalg.eigh(gram / np.outer(length, length))
    kept = values > _RANK * max(float(values[-1]), 1e-300) if len(values) else np.zeros(0, dtype=bool)
    inner = vectors[:, kept].T @ (right / length[:, None])
    return np.asarray(vectors[:, kept] @ (inner / values[kept, None]) / length[:, None])


@dataclass(frozen=True, eq=False)
class Distances:
    """Sums of every ordered pair of rivals: of the data, and of every run of the menu.

    Attributes:
        old: by (k, l).
        new: by (k, l), one a run; None of a run in which a rival diverges.
        sse: of every rival's own fit.
    """

    old: dict[tuple[str, str], Sums]
    new: dict[tuple[str, str], tuple[Sums | None, ...]]
    sse: dict[str, float]

    def lambdas(self, k: str, l: str, run: int | None = None) -> float:  # noqa: E741 - the equation's
        """Return lambda_{k|l} of the data, and of the data with a run more."""
        added = None if run is None else self.new[k, l][run]
        return (self.old[k, l] if added is None else self.old[k, l] + added).apart

    def gain(self, k: str, l: str, run: int | None = None) -> float:  # noqa: E741 - the equation's
        """Return g_{k|l}: what a run is expected to add to the margin of the data (`mjfish.plan.odds`)."""
        added = None if run is None else self.new[k, l][run]
        fitted = self.old[k, l]
        # At its own fit l is at the bottom of its misfit of the data: no moment there.
        return 0.0 if added is None else (replace(fitted, moment=0.0 * fitted.moment, square=0.0) + added).apart

    def possible(self, run: int) -> bool:
        """Whether no rival diverges in a run."""
        return all(parts[run] is not None for parts in self.new.values())


def distances(rivals: Sequence[Fitted], runs: Sequence[Run]) -> Distances:
    """Compare every pair of rivals at their own fits on the data and on every run."""
    menus = [_on(one.problem, runs) for one in rivals]
    there = [
        [one.problem.predictions(one.fit.x), menu.predictions(_x(one, menu))]
        for one, menu in zip(rivals, menus, strict=True)
    ]
    slopes = [_slopes(one, menu) for one, menu in zip(rivals, menus, strict=True)]
    old, new = {}, {}
    for k, l in permutations(range(len(rivals)), 2):  # noqa: E741
        pair = rivals[k].effect.name, rivals[l].effect.name
        problem, menu = rivals[l].problem, menus[l]
        names = tuple(p.name for p in rivals[l].free)
        parts = [
            _sums(problem, i, names, there[k][0][i] - there[l][0][i], slopes[l][0][i])
            for i in range(len(problem.trials))
        ]
        old[pair] = _total([part for part in parts if part is not None])
        added = tuple(p.name for p in menu.parameters if p.name in names or ":" in p.name)
        new[pair] = tuple(
            _sums(menu, i, added, there[k][1][i] - there[l][1][i], slopes[l][1][i]) for i in range(len(runs))
        )
    return Distances(old, new, {one.effect.name: one.fit.sse for one in rivals})


def _on(problem: Problem, runs: Sequence[Run]) -> Problem:
    return replace(problem, trials=tuple(run.trial for run in runs), windows=None, ends=0)


def _x(one: Fitted, menu: Problem) -> FloatArray:
    return menu.start(one.problem.named(one.fit.x))


def _slopes(one: Fitted, menu: Problem) -> tuple[list[FloatArray], list[FloatArray]]:
    """Return the sensitivities of the data and of the menu, in units of the scales, by what a refit can move."""
    free = [p.name for p in one.free]
    old = one.problem.sensitivities(one.fit.x, only=free)
    moved = [p for p in menu.parameters if p.name in free or ":" in p.name]
    new = menu.sensitivities(_x(one, menu), only=[p.name for p in moved])
    return [b * scales(one.free) for b in old], [b * scales(moved) for b in new]


def scales(parameters: Sequence[Parameter]) -> FloatArray:
    """Return the scales (p,) of parameters."""
    return np.array([p.scale for p in parameters])


def _sums(problem: Problem, i: int, names: tuple[str, ...], d: FloatArray, slope: FloatArray) -> Sums | None:
    """Return the sums of one trial; None where a prediction is not finite."""
    if not np.all(np.isfinite(d)):
        return None
    joined = np.concatenate([slope, d[problem.mask(i)][:, :, None]], axis=2)
    gram = gram_of(problem, i, joined)
    return Sums(names, gram[:-1, :-1], gram[:-1, -1], float(gram[-1, -1]))


def gram_of(problem: Problem, i: int, block: FloatArray) -> FloatArray:
    """Return B'B (k, k) of the whitened columns of a block (n_i, 3, k) of the counted samples of trial i."""
    white = problem.whitened(i, block)
    white = white.reshape(-1, white.shape[2])
    return np.asarray(white.T @ white)


def _total(parts: Sequence[Sums]) -> Sums:
    total = parts[0]
    for part in parts[1:]:
        total = total + part
    return total
