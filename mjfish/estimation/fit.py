"""Least squares within bounds ([Yu2016] eq. (21)) and what it says about its estimates.

Fits from many starts: is the optimum that was found the only one, and the best?
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, Literal

import numpy as np
from scipy import special
from scipy.stats import qmc
from threadpoolctl import threadpool_limits

from mjfish.arrays import BoolArray, FloatArray
from mjfish.block_angular import BlockAngular
from mjfish.errors import NUMERIC, MjfishError, reason_of
from mjfish.estimation.gauss_newton import minimise, weights_of
from mjfish.estimation.problem import LOST, Problem
from mjfish.estimation.settings import Loss
from mjfish.execution import mapped
from mjfish.parameter import Parameter, bounds
from mjfish.sized_cache import Remade, always

#: 97.5 % point of the standard normal distribution.
Z95 = 1.959963984540054
#: An estimate this close to a bound, as a share of the range, rests on it.
_AT_BOUND = 1e-4
_MAX_EVALUATIONS = 200
#: Variance of the estimates of a fit that failed.
_UNKNOWN = 1e200
#: A fit keeps this share of the range off its bounds: some causes do nothing on theirs, and have no derivative there.
_INSIDE = 1e-6


@dataclass(frozen=True, eq=False)
class Linearised:
    """A problem where a fit ended.

    Attributes:
        jacobian: (n, p) derivative of the whitened prediction.
        covariance: (p, p) of the estimates.
    """

    jacobian: BlockAngular
    covariance: FloatArray

    @property
    def nbytes(self) -> int:
        """Bytes of both."""
        return self.jacobian.nbytes + self.covariance.nbytes


@dataclass(frozen=True, eq=False)
class Fit:
    """Result of a fit.

    Attributes:
        parameters: the free parameters (p,).
        x: their estimates (p,).
        sse: sum of squared whitened residuals, those of the data.
        penalty: what priors add to it.
        residuals: returns `residual`: it may have to be made again.
        linearised: returns `jacobian` and `covariance`.
        reach: (p,) standard errors were no parameter held by its bound: how far one that is might lie from it.
        at_bound: (p,) whether the estimate rests on a bound.
        status: ``converged`` or ``stopped`` (too many evaluations), ``diverged``, or ``failed``: an error was raised.
        message: of the optimiser; which trial diverged, when and with which parameters, where one did; the error.
        evaluations: of the residual.
        cost: what was minimised: `sse`, or its robust form.
        ended: (p,) where the optimiser ended, each in units of its parameter's scale: there derivatives are taken.
        count: n, number of whitened residuals.
        lengths: (p,) of the columns of `jacobian`.
        errors: (p,) standard errors; 0 where the estimate rests on a bound.
    """

    parameters: tuple[Parameter, ...]
    x: FloatArray
    sse: float
    residuals: Callable[[], FloatArray]
    linearised: Callable[[], Linearised]
    reach: FloatArray
    at_bound: BoolArray
    status: Literal["converged", "stopped", "diverged", "failed"]
    message: str
    evaluations: int
    cost: float = math.nan
    penalty: float = 0.0
    ended: FloatArray = field(default_factory=lambda: np.zeros(0))
    count: int = field(init=False)
    lengths: FloatArray = field(init=False)
    errors: FloatArray = field(init=False)

    def __post_init__(self) -> None:
        """Keep what is small of what is large."""
        errors = np.sqrt(np.maximum(np.diag(self.covariance), 0.0))
        for name, value in {"count": len(self.residual), "lengths": self.jacobian.lengths, "errors": errors}.items():
            object.__setattr__(self, name, value)

    @property
    def residual(self) -> FloatArray:
        """Whitened residuals (n,)."""
        return self.residuals()

    @property
    def jacobian(self) -> BlockAngular:
        """Derivative (n, p) of the whitened prediction."""
        return self.linearised().jacobian

    @property
    def covariance(self) -> FloatArray:
        """Covariance (p, p) of the estimates; rows and columns of parameters at a bound are zero."""
        return self.linearised().covariance

    def having(self, **other: Any) -> Fit:
        """Return the fit with other attributes, `residual`, `jacobian` and `covariance` among them."""
        if "residual" in other:
            other["residuals"] = always(other.pop("residual"))
        large = {name: other.pop(name) for name in ("jacobian", "covariance") if name in other}
        if large:
            other["linearised"] = always(replace(self.linearised(), **large))
        return replace(self, **other)

    @property
    def lost(self) -> bool:
        """Whether it says nothing about the data: it diverged or failed."""
        return self.status in ("diverged", "failed")

    @property
    def objective(self) -> float:
        """What a fit minimises: `sse` and the penalty of the priors."""
        return self.sse + self.penalty

    @property
    def values(self) -> dict[str, float]:
        """Estimates by name."""
        return {p.name: float(v) for p, v in zip(self.parameters, self.x, strict=True)}

    @property
    def sigma(self) -> dict[str, float]:
        """Standard errors by name; 0 where the estimate rests on a bound."""
        return {p.name: float(v) for p, v in zip(self.parameters, self.errors, strict=True)}

    @property
    def correlation(self) -> FloatArray:
        """Correlation of the estimates (p, p); 0 where one rests on a bound."""
        safe = np.where(self.errors > 0.0, self.errors, 1.0)
        return np.asarray(self.covariance / np.outer(safe, safe))

    def interval(self, name: str, z: float = Z95) -> tuple[float, float]:
        """Return the interval of one estimate, cut at its bounds; of one at a bound, one-sided from there."""
        index = [p.name for p in self.parameters].index(name)
        p, half = self.parameters[index], z * float(self.reach[index] if self.at_bound[index] else self.sigma[name])
        at = float(self.x[index])
        return max(at - half, p.low), min(at + half, p.high)


def fit(
    problem: Problem,
    start: FloatArray | None = None,
    *,
    tolerance: float = 1e-8,
    evaluations: int = _MAX_EVALUATIONS,
    loss: Loss = "linear",
    loss_scale: float = 1.0,
) -> Fit:
    """Minimise the sum of squared whitened residuals within the bounds (`mjfish.estimation.gauss_newton`).

    Args:
        problem: the residuals.
        start: (p,) where to start; None: the declared starts.
        tolerance: relative change of the cost at which it stops.
        evaluations: of the residual, at most.
        loss, loss_scale: robust loss of each whitened residual; what the result says of the data (`residual`,
            `jacobian`, covariances) is then weighted as the loss weighs it at the optimum.
    """
    low, high = bounds(problem.parameters)
    inside = _INSIDE * (high - low)
    within = low + inside, high - inside
    x0 = np.clip(problem.start() if start is None else start, *within)
    try:
        with threadpool_limits(1, "blas"):  # matrices of nine columns: more threads only wait for each other
            found = minimise(problem, x0, within, tolerance, evaluations, loss, loss_scale)
        x, at_bound = _settle(found.x, low, high, found.gradient)
        end = End(x, found.x, at_bound, found.status, found.message, found.evaluations, found.cost)
        return _fit_at(_Ended(problem, end, loss, loss_scale), found.residual, found.jacobian)
    except MjfishError:
        raise
    except NUMERIC as error:
        return _failed(problem, x0, reason_of(error))


class FitFailedError(ArithmeticError):
    """A fit failed, and there is nothing in its place."""


def fit_or_raise(problem: Problem, start: FloatArray, *, tolerance: float, evaluations: int = _MAX_EVALUATIONS) -> Fit:
    """Fit as `fit` does, for work that cannot go on without: a fit that diverged may be worse than another.

    Raises:
        FitFailedError: it failed.
    """
    found = fit(problem, start, tolerance=tolerance, evaluations=evaluations)
    if found.status == "failed":
        raise FitFailedError(f"a fit failed: {found.message}")
    return found


@dataclass(frozen=True, eq=False)
class End:
    """Where an optimiser ended; the rest of a `Fit`, whose attributes these are, follows from the problem."""

    x: FloatArray
    ended: FloatArray
    at_bound: BoolArray
    status: Literal["converged", "stopped"]
    message: str
    evaluations: int
    cost: float


def fit_at(problem: Problem, end: End) -> Fit:
    """Return the `fit` of a problem by squares that is known to have ended there, to the last bit."""
    ended = _Ended(problem, end, "linear", 1.0)
    return _fit_at(ended, problem.residual(end.ended), problem.jacobian(end.ended))


@dataclass(frozen=True, eq=False)
class _Ended:
    """Where the fit of a problem ended: what is large of the fit is made of this, once and again."""

    problem: Problem
    end: End
    loss: Loss
    loss_scale: float

    def plain(self) -> FloatArray:
        """Return the residual; putting an estimate onto its bound is a move too small for a derivative."""
        return self.problem.residual(self.end.x if self.end.at_bound.any() else self.end.ended)

    def weighted(self, plain: FloatArray) -> FloatArray:
        """Return the residual as the loss weighs it."""
        return plain if self.loss == "linear" else plain * self._weight(plain)

    def residual(self) -> FloatArray:
        """Return the residual of the fit."""
        return self.weighted(self.plain())

    def linearised(self) -> Linearised:
        """Return derivatives and covariance of the fit."""
        return self.seen(self.problem.jacobian(self.end.ended), self.plain)[0]

    def seen(self, jacobian: BlockAngular, plain: Callable[[], FloatArray]) -> tuple[Linearised, FloatArray]:
        """Return the same of derivatives and of a residual, which a robust loss asks for; and the reach of the fit."""
        at_bound = self.end.at_bound
        if self.loss != "linear":
            jacobian = jacobian.scaled(rows=self._weight(plain()))
        triangle = jacobian.above(self.problem.prior_root).factorised().triangle
        every = covariance(triangle, np.zeros_like(at_bound))
        own = covariance(triangle, at_bound) if at_bound.any() else every
        return Linearised(jacobian, own), np.sqrt(np.diag(every))

    def _weight(self, plain: FloatArray) -> FloatArray:
        return weights_of(self.loss, self.loss_scale, plain)


def _fit_at(ended: _Ended, plain: FloatArray, jacobian: BlockAngular) -> Fit:
    problem, end = ended.problem, ended.end
    if end.at_bound.any():
        plain = ended.plain()
    divergence = problem.divergence(end.x) if np.abs(plain).max(initial=0.0) >= LOST else ""
    residual, (linearised, reach) = ended.weighted(plain), ended.seen(jacobian, always(plain))
    return Fit(
        parameters=problem.parameters,
        x=end.x,
        sse=float(residual @ residual),
        residuals=Remade(ended.residual, residual),
        linearised=Remade(ended.linearised, linearised),
        reach=reach,
        at_bound=end.at_bound,
        status="diverged" if divergence else end.status,
        message=divergence or end.message,
        evaluations=end.evaluations,
        cost=end.cost,
        penalty=float(np.sum((problem.prior_root @ end.x - problem.prior_mean) ** 2)),
        ended=end.ended,
    )


def _failed(problem: Problem, x: FloatArray, reason: str) -> Fit:
    """Return a fit that failed, at its start: as far off as one that diverged, and no derivative known."""
    count = len(x)
    residual, free = np.full(problem.measured + len(problem.known), LOST), np.zeros(count, dtype=np.bool_)
    unknown = np.full(count, _UNKNOWN)
    return Fit(
        parameters=problem.parameters,
        x=x,
        sse=float(residual @ residual),
        residuals=always(residual),
        linearised=always(Linearised(BlockAngular.of(np.zeros((len(residual), count))), np.diag(unknown))),
        reach=np.sqrt(unknown),
        at_bound=free,
        status="failed",
        message=reason,
        evaluations=0,
        cost=float(residual @ residual),
    )


def _settle(x: FloatArray, low: FloatArray, high: FloatArray, gradient: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Put estimates that the fit pushes against a bound onto it (the fit itself stays strictly inside)."""
    near = _AT_BOUND * (high - low)
    at_low = (x - low < near) & (gradient > 0.0)
    at_high = (high - x < near) & (gradient < 0.0)
    return np.where(at_low, low, np.where(at_high, high, x)), at_low | at_high


def covariance(rows: BlockAngular, at_bound: BoolArray) -> FloatArray:
    """Return (R' R)^-1 of the parameters off their bounds; directions that the data do not move get a huge variance.

    Args:
        rows: R, or any matrix whose factor it is.
        at_bound: (p,) which parameters rest on a bound: theirs is zero.
    """
    free = np.flatnonzero(~at_bound)
    result = np.zeros((len(at_bound), len(at_bound)))
    result[np.ix_(free, free)] = rows.chosen(~at_bound).factorised().triangle.inverse_gram(1e-10)
    return result


#: Evaluations of a fit on its way; the best goes on to the end.
_SCOUT = 25
_SCOUT_TOLERANCE = 1e-5
#: A start reached the best optimum where its cost is above the best by no more than this share, or by 1 in 2 log L.
SAME = 1e-3


@dataclass(frozen=True, eq=False)
class MultiStart:
    """Fits from several starts.

    Attributes:
        best: the best fit, converged.
        costs: (k,) sum of (robust) squares that each start reached; infinite where it diverged.
        optima: (k, p) where each ended.
        reached: share of the starts that reached the best optimum.
    """

    best: Fit
    costs: FloatArray
    optima: FloatArray
    reached: float


def multistart(
    problem: Problem,
    starts: int,
    *,
    seed: int = 0,
    loss: Loss = "linear",
    loss_scale: float = 1.0,
    tell: Callable[[float], None] | None = None,
) -> MultiStart:
    """Fit from the declared start and from a Latin hypercube over the bounds [McKay1979].

    The same seed gives the same answer for any number of jobs: starts are drawn at once, and fits share nothing.

    [McKay1979] M. McKay, R. Beckman, W. Conover: A comparison of three methods for selecting values of input variables.

    Args:
        problem: what is fitted.
        starts: number of starts, the declared one among them.
        seed: of the hypercube.
        loss, loss_scale: as in `fit`.
        tell: called with the share that is done.
    """
    robust = {"loss": loss, "loss_scale": loss_scale}
    if starts == 1:
        best = fit(problem, **robust)  # type: ignore[arg-type]
        return MultiStart(best, np.array([_cost(best)]), best.x[None], float(not best.lost))
    points = [problem.start(), *hypercube(problem, starts - 1, seed)]
    short: dict[str, Any] = {**robust, "tolerance": _SCOUT_TOLERANCE, "evaluations": _SCOUT}
    scouts = []
    for scout in mapped(partial(scouted, problem, **short), points, sent=True):
        scouts.append(scout)
        if tell is not None:
            tell(len(scouts) / (len(points) + 1))
    costs = np.array([scout.cost for scout in scouts])
    order = int(np.argmin(costs))
    best = fit(problem, scouts[order].x, **robust)  # type: ignore[arg-type]
    costs[order] = min(costs[order], _cost(best))
    slack = max(SAME * float(costs.min()), 1.0)
    return MultiStart(
        best=replace(best, evaluations=best.evaluations + sum(scout.evaluations for scout in scouts)),
        costs=costs,
        optima=np.array([scout.x for scout in scouts]),
        reached=float(np.mean(np.isfinite(costs) & (costs <= costs.min() + slack))),
    )


@dataclass(frozen=True, eq=False)
class Scout:
    """What is kept of a fit on its way: where it ended (p,), its cost, infinite where it diverged, its evaluations."""

    x: FloatArray
    cost: float
    evaluations: int


def scouted(problem: Problem, start: FloatArray, **settings: Any) -> Scout:
    """Return where a `fit` from a start, with these settings, ends; one that failed is as bad as one that diverged."""
    found = fit(problem, start, **settings)
    return Scout(found.x, _cost(found), found.evaluations)


def hypercube(problem: Problem, count: int, seed: int) -> FloatArray:
    """Return starts (count, p): nuisance parameters of trials stay at their own, which the data give.

    A parameter with a prior is drawn from it, any other evenly between its bounds.
    """
    parameters = problem.parameters
    x = np.tile(problem.start(), (count, 1))
    shared = [i for i, p in enumerate(parameters) if ":" not in p.name]
    if count and shared:
        shares = qmc.LatinHypercube(len(shared), rng=np.random.default_rng(seed)).random(count)
        for i, share in zip(shared, shares.T, strict=True):
            p = parameters[i]
            if p.sd is None:
                x[:, i] = p.low + (p.high - p.low) * share
            else:
                x[:, i] = np.clip([p.at_deviation(float(z)) for z in special.ndtri(share)], p.low, p.high)
    return x


def _cost(fit_: Fit) -> float:
    return np.inf if fit_.lost else fit_.cost
