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
from dataclasses import dataclass
from functools import reduce
from itertools import combinations
from operator import add

import numpy as np

from mjfish.arrays import FloatArray
from mjfish.data import Trial
from mjfish.design.fitted import Fitted
from mjfish.design.gain import NONE, Gain, gain
from mjfish.design.menu import Run
from mjfish.design.slopes import on_menu, slopes
from mjfish.design.sums import Sums, column, gram_of
from mjfish.estimation import Problem
from mjfish.estimation.problem import elsewhere
from mjfish.parameter import Parameter


@dataclass(frozen=True, eq=False)
class Distances:
    """Sums of every pair of rivals, J = [J_k, J_l]: of the data, and of every run of the menu.

    Attributes:
        old: by the pair; columns are named by `mjfish.design.sums.column`.
        new: by the pair, one a run; None of a run in which a rival diverges.
        sse: of every rival's own fit.
    """

    old: dict[frozenset[str], Sums]
    new: dict[frozenset[str], tuple[Sums | None, ...]]
    sse: dict[str, float]

    def lambdas(self, k: str, l: str, run: int | None = None) -> float:  # noqa: E741 - the equation's
        """Return lambda_{k|l} of the data, and of the data with a run more."""
        old, new = self._sums(k, l, run)
        return (old if new is None else old + new).of(l).apart

    def gain(self, k: str, l: str, run: int | None = None) -> Gain:  # noqa: E741 - the equation's
        """Return what a run is expected to add to the margin of the data."""
        old, new = self._sums(k, l, run)
        return NONE if new is None else gain(old, new, k, l)

    def _sums(self, k: str, l: str, run: int | None) -> tuple[Sums, Sums | None]:  # noqa: E741
        pair = frozenset((k, l))
        return self.old[pair], None if run is None else self.new[pair][run]

    def possible(self, run: int) -> bool:
        """Whether no rival diverges in a run."""
        return all(parts[run] is not None for parts in self.new.values())


def distances(rivals: Sequence[Fitted], runs: Sequence[Run]) -> Distances:
    """Compare every pair of rivals at their own fits on the data and on every run."""
    menus = [on_menu(one.problem, runs) for one in rivals]
    here = [_here(one) for one in rivals]
    there = [_there(one, menu) for one, menu in zip(rivals, menus, strict=True)]
    old, new = {}, {}
    for k, l in combinations(range(len(rivals)), 2):  # noqa: E741
        pair = frozenset((rivals[k].effect.name, rivals[l].effect.name))
        problem = rivals[l].problem
        parts = [_sums(problem, i, here[k], here[l]) for i in range(len(problem.trials))]
        old[pair] = reduce(add, (part for part in parts if part is not None))
        new[pair] = tuple(_sums(menus[l], i, there[k], there[l]) for i in range(len(runs)))
    return Distances(old, new, {one.effect.name: one.fit.sse for one in rivals})


@dataclass(frozen=True, eq=False)
class _View:
    """What a rival says of the runs: predictions, and their slopes by what a refit can move, in units of the scales."""

    rival: str
    moved: Sequence[Parameter]
    predictions: list[FloatArray]
    slopes: list[FloatArray]

    def of(self, i: int, trial: Trial) -> tuple[tuple[str, ...], FloatArray]:
        """Return the columns of a trial and their names, without what is another trial's own."""
        own = [j for j, p in enumerate(self.moved) if not elsewhere(p, trial)]
        return tuple(column(self.rival, self.moved[j].name) for j in own), self.slopes[i][:, :, own]


def _view(one: Fitted, problem: Problem, x: FloatArray, moved: Sequence[Parameter]) -> _View:
    return _View(one.effect.name, moved, problem.predictions(x), slopes(problem, x, moved))


def _here(one: Fitted) -> _View:
    return _view(one, one.problem, one.fit.x, one.free)


def _there(one: Fitted, menu: Problem) -> _View:
    free = {p.name for p in one.free}
    moved = [p for p in menu.parameters if p.name in free or ":" in p.name]
    return _view(one, menu, menu.start(one.problem.named(one.fit.x)), moved)


def _sums(problem: Problem, i: int, k: _View, l: _View) -> Sums | None:  # noqa: E741
    """Return the sums of one trial; None where a prediction is not finite."""
    d = k.predictions[i] - l.predictions[i]
    if not np.all(np.isfinite(d)):
        return None
    views = [view.of(i, problem.trials[i]) for view in (k, l)]
    joined = np.concatenate([*(block for _, block in views), d[problem.mask(i)][:, :, None]], axis=2)
    gram = gram_of(problem, i, joined)
    names = tuple(name for names, _ in views for name in names)
    return Sums(names, gram[:-1, :-1], gram[:-1, -1], float(gram[-1, -1]))
