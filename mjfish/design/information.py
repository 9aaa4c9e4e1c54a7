"""What data say of parameters, as sums over runs: each run more adds its own. And the minimum detectable effect."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mjfish.arrays import FloatArray
from mjfish.design.fitted_models import ModelEstimate
from mjfish.design.menu import Run
from mjfish.effects import Effect
from mjfish.estimation import Problem
from mjfish.parameter import Parameter

#: Eigenvalues below this share of the largest are rounding.
_RANK = 1e-10
#: lambda that a family of some twenty causes at 5 % needs for 90 % power: (2.99 + 1.28)^2.
DETECTED = 18.0
#: A signature of which a refit leaves less than this share is structurally unidentifiable: what is left is rounding.
_CONFOUNDED = 1e-5


@dataclass(frozen=True, eq=False)
class Information:
    """Sums over runs of the columns of a Jacobian J and of a difference d, all whitened.

    Attributes:
        names: of the columns of J; columns of the same name in two runs are the same parameter.
        gram: J'J (p, p).
        moment: J'd (p,).
        square: d'd.
    """

    names: tuple[str, ...]
    gram: FloatArray
    moment: FloatArray
    square: float

    @classmethod
    def of(cls, names: tuple[str, ...], jacobian: FloatArray, difference: FloatArray | None = None) -> Information:
        """Return the sums of J (n, p) and d (n,); d is zero where there is no difference to explain."""
        d = np.zeros(len(jacobian)) if difference is None else difference
        return cls(names, jacobian.T @ jacobian, jacobian.T @ d, float(d @ d))

    def __add__(self, other: Information) -> Information:
        """Join runs."""
        names = (*self.names, *(name for name in other.names if name not in self.names))
        gram, moment = np.zeros((len(names), len(names))), np.zeros(len(names))
        for part in (self, other):
            at = [names.index(name) for name in part.names]
            gram[np.ix_(at, at)] += part.gram
            moment[at] += part.moment
        return Information(names, gram, moment, self.square + other.square)

    def of_rival(self, rival: str) -> Information:
        """Return the sums of the columns that `column` named after a rival."""
        at = [i for i, name in enumerate(self.names) if name.startswith(column(rival, ""))]
        return Information(tuple(self.names[i] for i in at), self.gram[np.ix_(at, at)], self.moment[at], self.square)

    @property
    def unexplained(self) -> float:
        """What a refit leaves of the difference: d'd - d'J (J'J)^+ J'd."""
        return max(self.square - float(self.moment @ solve(self.gram, self.moment[:, None])[:, 0]), 0.0)


def column(rival: str, parameter: str) -> str:
    """Return the name of a rival's own column; two rivals have parameters of the same name."""
    return f"{rival}/{parameter}"


def solve(gram: FloatArray, right: FloatArray) -> FloatArray:
    """Return gram^+ right (p, k) of a positive semi-definite matrix, its columns first scaled to length 1."""
    length = np.sqrt(np.maximum(np.diag(gram), 1e-300))
    values, vectors = np.linalg.eigh(gram / np.outer(length, length))
    kept = values > _RANK * max(float(values[-1]), 1e-300) if len(values) else np.zeros(0, dtype=bool)
    inner = vectors[:, kept].T @ (right / length[:, None])
    return np.asarray(vectors[:, kept] @ (inner / values[kept, None]) / length[:, None])


def on_menu(problem: Problem, runs: Sequence[Run]) -> Problem:
    """Return the problem with the runs of a menu for its trials, all of their samples counted."""
    return replace(problem, trials=tuple(run.trial for run in runs), windows=None, ends=0)


def jacobians(problem: Problem, x: FloatArray, names: Collection[str]) -> list[FloatArray]:
    """Return, per trial, the whitened derivative (n, k) of the prediction by parameters in units of their scales."""
    scales = np.array([p.scale for p in problem.parameters if p.name in names])
    blocks = problem.sensitivities(x, list(names))
    return [problem.whitened(i, block * scales).reshape(-1, len(scales)) for i, block in enumerate(blocks)]


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
