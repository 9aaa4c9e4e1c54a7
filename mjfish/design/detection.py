"""The minimum detectable effect of a cause, on the data and with a run more."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mjfish.design.fitted_models import ModelEstimate
from mjfish.design.information import Information, jacobians, on_menu, solve
from mjfish.design.menu import Run
from mjfish.effects import Effect
from mjfish.estimation import Problem
from mjfish.parameter import Parameter

#: lambda that a family of some twenty causes at 5 % needs for 90 % power: (2.99 + 1.28)^2.
DETECTED = 18.0
#: A signature of which a refit leaves less than this share is structurally unidentifiable: what is left is rounding.
_CONFOUNDED = 1e-5


@dataclass(frozen=True, eq=False)
class Detection:
    """Information on the nominal model's parameters and the causes' amplitudes: of the data, and of every run.

    Attributes:
        amplitudes: of every cause.
        data: of the data.
        runs: of every run; None of a run in which the model diverges.
    """

    amplitudes: dict[str, tuple[Parameter, ...]]
    data: Information
    runs: tuple[Information | None, ...]

    def sizes(self, cause: str, run: int | None = None) -> dict[str, float]:
        """Return the minimum detectable effect of each amplitude: sqrt(18 (I^-1)_jj), I = S'S - S'J (J'J)^+ J'S.

        Infinite where a refit of the coefficients hides all of it.
        """
        added = None if run is None else self.runs[run]
        sums = self.data if added is None else self.data + added
        own = [sums.names.index(p.name) for p in self.amplitudes[cause]]
        others = {p.name for amplitudes in self.amplitudes.values() for p in amplitudes}
        theta = [i for i, name in enumerate(sums.names) if name not in others]
        mixed, whole = sums.gram[np.ix_(theta, own)], sums.gram[np.ix_(own, own)]
        left = whole - mixed.T @ solve(sums.gram[np.ix_(theta, theta)], mixed)
        shown = np.diag(left) > _CONFOUNDED * np.maximum(np.diag(whole), 1e-300)
        inverse = np.diag(np.linalg.pinv(left, hermitian=True))
        found = np.where(shown, np.sqrt(DETECTED * np.maximum(inverse, 0.0)), np.inf)
        return {p.name: float(size) * p.scale for p, size in zip(self.amplitudes[cause], found, strict=True)}


def detection(nominal: ModelEstimate, causes: Sequence[Effect], runs: Sequence[Run]) -> Detection:
    """Derive the nominal model by its parameters and by every cause at its null, on the data and on the menu."""
    problem = nominal.problem
    wide = replace(problem, model=replace(problem.model, effects=(*problem.model.effects, *causes)))
    menu = on_menu(wide, runs)
    parameters = [p for cause in causes for p in cause.parameters]
    here = {p.name: p.default for p in parameters} | problem.named(nominal.x)
    fixed = nominal.at_bound | {p.name for p in parameters if p.shape}
    finite = [bool(np.all(np.isfinite(one))) for one in menu.predictions(menu.start(here))]
    added = _information(menu, here, fixed)
    data, *rest = _information(wide, here, fixed)
    return Detection(
        amplitudes={cause.name: tuple(p for p in cause.parameters if not p.shape) for cause in causes},
        data=sum(rest, start=data),
        runs=tuple(one if ok else None for one, ok in zip(added, finite, strict=True)),
    )


def _information(problem: Problem, here: dict[str, float], fixed: frozenset[str]) -> list[Information]:
    """Return the information of every trial."""
    names = tuple(p.name for p in problem.parameters if p.name not in fixed)
    return [Information.of(names, block) for block in jacobians(problem, problem.start(here), names)]
