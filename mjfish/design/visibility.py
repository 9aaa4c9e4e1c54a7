"""The smallest size of a cause that would show, on the data and with a run more."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mjfish.arrays import FloatArray
from mjfish.design.menu import Run
from mjfish.design.slopes import on_menu, scales, slopes
from mjfish.design.sums import Sums, gram_of, solve
from mjfish.effects.effect import Effect
from mjfish.estimation import Fit, Problem
from mjfish.parameter import Parameter

#: lambda that a family of some twenty causes at 5 % needs for 90 % power: (2.99 + 1.28)^2.
SEEN = 18.0


@dataclass(frozen=True, eq=False)
class Visibility:
    """Sums of the nominal model's and the causes' sensitivities: of the data, and of every run of the menu.

    Attributes:
        amplitudes: of every cause.
        old: of the data.
        new: one a run; None of a run in which the model diverges.
    """

    amplitudes: dict[str, tuple[Parameter, ...]]
    old: Sums
    new: tuple[Sums | None, ...]

    def sizes(self, cause: str, run: int | None = None) -> dict[str, float]:
        """Return the smallest visible size of each amplitude, sqrt(18 (I^-1)_jj), I = S'S - S'J (J'J)^+ J'S.

        Infinite where a refit of the coefficients hides all of it.
        """
        added = None if run is None else self.new[run]
        sums = self.old if added is None else self.old + added
        own = [sums.names.index(p.name) for p in self.amplitudes[cause]]
        others = {p.name for amplitudes in self.amplitudes.values() for p in amplitudes}
        theta = [i for i, name in enumerate(sums.names) if name not in others]
        mixed = sums.gram[np.ix_(theta, own)]
        whole = sums.gram[np.ix_(own, own)]
        left = whole - mixed.T @ solve(sums.gram[np.ix_(theta, theta)], mixed)
        shown = np.diag(left) > _HIDDEN * np.maximum(np.diag(whole), 1e-300)
        inverse = np.diag(np.linalg.pinv(left, hermitian=True))
        found = np.where(shown, np.sqrt(SEEN * np.maximum(inverse, 0.0)), np.inf) * scales(self.amplitudes[cause])
        return {p.name: float(size) for p, size in zip(self.amplitudes[cause], found, strict=True)}


#: A signature of which a refit leaves less than this share is hidden: a gauge, plus rounding.
_HIDDEN = 1e-5


def visibility(problem: Problem, nominal: Fit, causes: Sequence[Effect], runs: Sequence[Run]) -> Visibility:
    """Derive the nominal model by its coefficients and by every cause at its null, on the data and on the menu."""
    amplitudes = {cause.name: tuple(p for p in cause.parameters if not p.shape) for cause in causes}
    wide = replace(problem, model=replace(problem.model, effects=(*problem.model.effects, *causes)))
    menu = on_menu(wide, runs)
    here = {p.name: p.default for cause in causes for p in cause.parameters} | problem.named(nominal.x)
    held = {p.name for p, at_bound in zip(nominal.parameters, nominal.at_bound, strict=True) if at_bound}
    shapes = {p.name for cause in causes for p in cause.parameters if p.shape}
    finite = [bool(np.all(np.isfinite(one))) for one in menu.predictions(menu.start(here))]
    grams, names = _grams(wide, here, held | shapes)
    added, new_names = _grams(menu, here, held | shapes)
    return Visibility(
        amplitudes=amplitudes,
        old=_blind(names, np.sum(grams, axis=0)),
        new=tuple(_blind(new_names, gram) if ok else None for gram, ok in zip(added, finite, strict=True)),
    )


def _grams(problem: Problem, here: dict[str, float], fixed: set[str]) -> tuple[list[FloatArray], tuple[str, ...]]:
    moved = [p for p in problem.parameters if p.name not in fixed]
    blocks = slopes(problem, problem.start(here), moved)
    return [gram_of(problem, i, block) for i, block in enumerate(blocks)], tuple(p.name for p in moved)


def _blind(names: tuple[str, ...], gram: FloatArray) -> Sums:
    """Return sums without a difference to explain."""
    return Sums(names, gram, np.zeros(len(names)), 0.0)
