"""Least squares within bounds ([Yu2016] eq. (21)) and what it says about its estimates.

Fits from many starts: is the optimum that was found the only one, and the best?

**Steps.** Gauss-Newton steps in a trust region, each the exact minimum of its model there. At x, with the residual e
and the derivative J of the prediction, the step s minimises

    |e - J s|^2,  low <= x + s <= high,  |D s|_max <= radius,

with the lengths of the columns of J in D; a shape goes over a quarter of its range at most. All constraints are bounds
of single parameters, so that one call of `scipy.optimize.lsq_linear` solves it. The radius follows from how well the
model predicted the gain of the last step ([ConnGouldToint2000], algorithm 6.1.1). `scipy.optimize.least_squares` (trf)
bends its steps away from bounds, however far they are [ColemanLi1996]: along what the data hardly say, such as the
shares of head, body and tail in the friction, it goes in ten to forty small steps where these go in three.

[ConnGouldToint2000] A. Conn, N. Gould, P. Toint, Trust-Region Methods. [ColemanLi1996] T. Coleman and Y. Li, SIAM
Journal on Optimization 6.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, Literal

import numpy as np
from scipy import optimize, special
from scipy.stats import qmc
from threadpoolctl import threadpool_limits

from mjfish.errors import NUMERIC, MjfishError, reason_of
from mjfish.estimation.problem import LOST, Problem
from mjfish.estimation.settings import Loss
from mjfish.execution import mapped
from mjfish.numerics.arrays import BoolArray, FloatArray
from mjfish.numerics.block_angular import BlockAngular
from mjfish.numerics.sized_cache import Recomputable, always
from mjfish.parameters import Parameter, bounds

#: A column shorter than this share of the longest counts as that long: what does nothing stays.
_IDLE = 1e-12
#: A step changes a shape by this share of its range at most: while its cause has no size, the data hardly see it.
_FARTHEST = 0.25
#: Shares of the predicted gain below which the radius shrinks, and above which it grows.
_POOR, _GOOD = 0.1, 0.5
#: By how much: it is a quarter of the length of a poor step; and a step of this share of the radius was held by it.
_SHRINK, _GROW, _HELD = 0.25, 2.0, 0.95
#: A step below this, relative to x, both in units of the columns, ends the fit.
_SHORT = 1e-8
#: Parameters up to which a step is solved with dense matrices; by LSMR, whose time is linear in them, beyond.
_DENSE = 400
#: Tolerance of LSMR: to the last digits, steps, and so their number, are then those of dense matrices.
_EXACTLY = 1e-12
#: Losses rho(z) of z = (r / scale)^2, as `scipy.optimize.least_squares` has them, and their slopes rho'(z).
LOSSES: Mapping[Loss, tuple[Callable[[FloatArray], FloatArray], Callable[[FloatArray], FloatArray]]] = {
    "linear": (lambda z: z, np.ones_like),
    "soft_l1": (lambda z: 2.0 * (np.sqrt(1.0 + z) - 1.0), lambda z: 1.0 / np.sqrt(1.0 + z)),
    "huber": (lambda z: np.where(z > 1.0, 2.0 * np.sqrt(z) - 1.0, z), lambda z: 1.0 / np.sqrt(np.maximum(z, 1.0))),
    "cauchy": (np.log1p, lambda z: 1.0 / (1.0 + z)),
    "arctan": (np.arctan, lambda z: 1.0 / (1.0 + z**2)),
}


@dataclass(frozen=True, eq=False)
class Minimum:
    """Where the minimisation ended.

    Attributes:
        x: (p,) the point.
        residual: (n,) there, of the data.
        jacobian: (n, p) derivative of the prediction there.
        gradient: (p,) of half the cost there.
        cost: what is minimised there: the sum of squares, or its robust form, priors among them.
        evaluations: of the residual.
        status: ``converged``, or ``stopped`` after the most evaluations.
        message: why it ended, in words.
    """

    x: FloatArray
    residual: FloatArray
    jacobian: BlockAngular
    gradient: FloatArray
    cost: float
    evaluations: int
    status: Literal["converged", "stopped"]
    message: str


def minimise(
    problem: Problem,
    x: FloatArray,
    bounds: tuple[FloatArray, FloatArray],
    tolerance: float,
    evaluations: int,
    loss: Loss,
    loss_scale: float,
) -> Minimum:
    """Minimise the sum of squares, or a robust loss, of whitened residuals and rows of priors.

    A robust loss weighs the rows of a step by the square root of its slope at the point where the step begins.

    Args:
        problem: gives residual, derivative and priors.
        x: (p,) where to start, within the bounds.
        bounds: low and high (p,).
        tolerance: share of the cost; a fit has converged where a step lowers the cost by less.
        evaluations: of the residual, at most.
        loss: of a row, one of `LOSSES`.
        loss_scale: of its rows, in sigmas.

    Raises:
        FloatingPointError: a residual or a step is not finite.
    """
    prior, mean = problem.prior_root, problem.prior_mean

    def left(at: FloatArray) -> tuple[FloatArray, float]:
        whole = np.concatenate([problem.residual(at), mean - prior @ at])
        if not np.isfinite(whole).all():
            raise FloatingPointError(f"the residual is not finite: {problem.lost_row(whole)}")
        return whole, float(loss_scale**2 * np.sum(LOSSES[loss][0]((whole / loss_scale) ** 2)))

    here, cost = left(x)
    done, radius, message = 1, np.inf, ""
    farthest = np.where([p.shape for p in problem.parameters], _FARTHEST * (bounds[1] - bounds[0]), np.inf)
    while True:
        jacobian = problem.jacobian(x)
        rows, right = jacobian.above(prior), here
        if loss != "linear":
            weights = weights_of(loss, loss_scale, here)
            rows, right = rows.scaled(rows=weights), weights * here
        factors = rows.factorised()
        triangle, turned = factors.triangle, factors.basis.coordinates(right)
        del rows, factors  # of an hour of samples they are large
        lengths = np.maximum(triangle.lengths, _IDLE * triangle.lengths.max(initial=1e-100))
        least, most = np.maximum(bounds[0] - x, -farthest), np.minimum(bounds[1] - x, farthest)
        ahead = False
        while not (ahead or message or done >= evaluations):
            step = _step(triangle, turned, lengths, radius, least, most)
            predicted = float(turned @ turned - np.sum((turned - triangle @ step) ** 2))
            size = float(np.abs(lengths * step).max(initial=0.0))
            if predicted <= tolerance * cost and size < _HELD * radius:
                message = f"a step would lower the cost by less than {tolerance:g} of it"
                break
            moved = np.clip(x + step, *bounds)
            there, new = left(moved)
            done, ahead, ratio = done + 1, new < cost, (cost - new) / predicted
            if abs(cost - new) < tolerance * cost and ratio > _POOR:
                message = f"a step changed the cost by less than {tolerance:g} of it"
            elif size < _SHORT * np.abs(lengths * x).max(initial=0.0):
                message = f"a step was shorter than {_SHORT:g}"
            if ratio < _POOR:
                radius = _SHRINK * size
            elif ratio > _GOOD and size > _HELD * radius:
                radius *= _GROW
        if not ahead:
            break
        x, here, cost = moved, there, new
        del jacobian  # not two at once
    return Minimum(
        x=x,
        residual=here[: len(here) - len(mean)],
        jacobian=jacobian,
        gradient=-triangle.transposed_times(turned),
        cost=cost,
        evaluations=done,
        status="converged" if message else "stopped",
        message=message or f"the most evaluations were used, {evaluations}",
    )


def _step(
    triangle: BlockAngular, turned: FloatArray, lengths: FloatArray, radius: float, low: FloatArray, high: FloatArray
) -> FloatArray:
    """Return the step s (p,) that minimises |Q'e - R s|^2 within bounds and the radius."""
    scaled = triangle.scaled(columns=1.0 / lengths)
    within = np.maximum(low * lengths, -radius), np.minimum(high * lengths, radius)
    if len(lengths) <= _DENSE:
        solved = optimize.lsq_linear(scaled.dense(), turned, bounds=within, method="bvls")
    else:
        rows, most = scaled.sparse(len(turned)), 10 * len(lengths)
        solved = optimize.lsq_linear(rows, turned, bounds=within, lsmr_tol=_EXACTLY, lsmr_maxiter=most)
    if not np.isfinite(solved.x).all():
        raise FloatingPointError("a step of the fit is not finite")
    return np.asarray(solved.x / lengths)


def weights_of(loss: Loss, loss_scale: float, residual: FloatArray) -> FloatArray:
    """Return the weights (n,) of rows with which a loss counts at a residual (n,): rho'(z)^(1/2)."""
    return np.asarray(np.sqrt(LOSSES[loss][1]((residual / loss_scale) ** 2)))


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
class End:
    """Where an optimiser ended; the rest of a `Fit` follows from the problem.

    Attributes:
        x: estimates (p,) of the free parameters.
        ended: (p,) where the optimiser ended: there derivatives are taken.
        at_bound: (p,) whether the estimate rests on a bound.
        status: ``converged`` or ``stopped`` (too many evaluations), ``diverged``, or ``failed``: an error was raised.
        message: of the optimiser; which trial diverged, when and with which parameters, where one did; the error.
        evaluations: of the residual.
        cost: what was minimised: the sum of squares, or its robust form.
    """

    x: FloatArray
    ended: FloatArray
    at_bound: BoolArray
    status: Literal["converged", "stopped", "diverged", "failed"]
    message: str
    evaluations: int
    cost: float


@dataclass(frozen=True, eq=False)
class Fit(End):
    """Result of a fit.

    Attributes:
        parameters: the free parameters (p,).
        sse: sum of squared whitened residuals, those of the data.
        residuals: returns `residual`: it may have to be made again.
        linearised: returns `jacobian` and `covariance`.
        reach: (p,) standard errors were no parameter held by its bound: how far one that is might lie from it.
        penalty: what priors add to `sse`.
        count: n, number of whitened residuals.
        lengths: (p,) of the columns of `jacobian`.
        errors: (p,) standard errors; 0 where the estimate rests on a bound.
    """

    parameters: tuple[Parameter, ...]
    sse: float
    residuals: Callable[[], FloatArray]
    linearised: Callable[[], Linearised]
    reach: FloatArray
    penalty: float = 0.0
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
    """Minimise the sum of squared whitened residuals within the bounds (`minimise`).

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
        x, at_bound = _onto_bounds(found.x, low, high, found.gradient)
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
        return plain if self.loss == "linear" else plain * weights_of(self.loss, self.loss_scale, plain)

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
            jacobian = jacobian.scaled(rows=weights_of(self.loss, self.loss_scale, plain()))
        triangle = jacobian.above(self.problem.prior_root).factorised().triangle
        every = covariance(triangle, np.zeros_like(at_bound))
        own = covariance(triangle, at_bound) if at_bound.any() else every
        return Linearised(jacobian, own), np.sqrt(np.diag(every))


def _fit_at(ended: _Ended, plain: FloatArray, jacobian: BlockAngular) -> Fit:
    problem, end = ended.problem, ended.end
    if end.at_bound.any():
        plain = ended.plain()
    divergence = problem.divergence(end.x) if np.abs(plain).max(initial=0.0) >= LOST else ""
    residual, (linearised, reach) = ended.weighted(plain), ended.seen(jacobian, always(plain))
    if divergence:
        end = replace(end, status="diverged", message=divergence)
    return Fit(
        **vars(end),
        parameters=problem.parameters,
        sse=float(residual @ residual),
        residuals=Recomputable(ended.residual, residual),
        linearised=Recomputable(ended.linearised, linearised),
        reach=reach,
        penalty=float(np.sum((problem.prior_root @ end.x - problem.prior_mean) ** 2)),
    )


def _failed(problem: Problem, x: FloatArray, reason: str) -> Fit:
    """Return a fit that failed, at its start: as far off as one that diverged, and no derivative known."""
    residual, unknown = np.full(problem.measured + len(problem.with_priors), LOST), np.full(len(x), _UNKNOWN)
    cost = float(residual @ residual)
    return Fit(
        **vars(End(x, np.zeros(0), np.zeros(len(x), dtype=np.bool_), "failed", reason, 0, cost)),
        parameters=problem.parameters,
        sse=cost,
        residuals=always(residual),
        linearised=always(Linearised(BlockAngular.of(np.zeros((len(residual), len(x)))), np.diag(unknown))),
        reach=np.sqrt(unknown),
    )


def _onto_bounds(
    x: FloatArray, low: FloatArray, high: FloatArray, gradient: FloatArray
) -> tuple[FloatArray, BoolArray]:
    """Put estimates that the fit pushes against a bound onto it (the fit itself stays strictly inside)."""
    near = _AT_BOUND * (high - low)
    at_low, at_high = (x - low < near) & (gradient > 0.0), (high - x < near) & (gradient < 0.0)
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
    optima, costs, evaluations = (np.array(column) for column in zip(*scouts, strict=True))
    order = int(np.argmin(costs))
    best = fit(problem, optima[order], **robust)  # type: ignore[arg-type]
    costs[order] = min(costs[order], _cost(best))
    return MultiStart(
        best=replace(best, evaluations=best.evaluations + int(evaluations.sum())),
        costs=costs,
        optima=optima,
        reached=float(np.mean(np.isfinite(costs) & (costs <= costs.min() + max(SAME * float(costs.min()), 1.0)))),
    )


def scouted(problem: Problem, start: FloatArray, **settings: Any) -> tuple[FloatArray, float, int]:
    """Return where a `fit` from a start, with these settings, ends (p,), its cost, and its evaluations.

    One that failed is as bad as one that diverged: its cost is infinite.
    """
    found = fit(problem, start, **settings)
    return found.x, _cost(found), found.evaluations


def hypercube(problem: Problem, count: int, seed: int) -> FloatArray:
    """Return starts (count, p): nuisance parameters of trials stay at their own, which the data give.

    A parameter with a prior is drawn from it, any other evenly between its bounds.
    """
    x = np.tile(problem.start(), (count, 1))
    shared = [(i, p) for i, p in enumerate(problem.parameters) if ":" not in p.name]
    if count and shared:
        shares = qmc.LatinHypercube(len(shared), rng=np.random.default_rng(seed)).random(count)
        for (i, p), share in zip(shared, shares.T, strict=True):
            if p.sd is None:
                x[:, i] = p.low + (p.high - p.low) * share
            else:
                x[:, i] = np.clip([p.at_deviation(float(z)) for z in special.ndtri(share)], p.low, p.high)
    return x


def _cost(fit_: Fit) -> float:
    return np.inf if fit_.lost else fit_.cost
