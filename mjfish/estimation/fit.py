"""Bounded trust-region least squares ([Yu2016] eq. (21)) and what it says about its estimates.

Fits from many starts: is the optimum that was found the only one, and the best?
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np
from scipy import optimize, sparse, special
from scipy.stats import qmc
from threadpoolctl import threadpool_limits

from mjfish.arrays import BoolArray, FloatArray
from mjfish.block_angular import BlockAngular, IntArray
from mjfish.errors import NUMERIC, MjfishError, reason_of
from mjfish.estimation.problem import LOST, Problem
from mjfish.estimation.settings import Loss
from mjfish.parameter import Parameter, bounds
from mjfish.sized_cache import Remade, always

#: 97.5 % point of the standard normal distribution.
Z95 = 1.959963984540054
#: An estimate this close to a bound, as a share of the range, rests on it.
_AT_BOUND = 1e-4
_MAX_EVALUATIONS = 100
#: Variance of the estimates of a fit that failed.
_UNKNOWN = 1e200
#: Parameters up to which the step is by a singular value decomposition; by LSMR, whose time is linear in them, beyond.
_EXACT = 400
#: LSMR to the last digits: steps, and so their number, are then those of the exact solver.
_EXACTLY = {"atol": 1e-12, "btol": 1e-12, "regularize": False}


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
        status: ``converged`` or ``stopped`` (too many evaluations), ``diverged``, or ``failed``: the optimiser raised
            an error, or ended before it had converged or used up its evaluations.
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
    """Minimise the sum of squared whitened residuals within the bounds, by `scipy.optimize.least_squares` (trf).

    What scipy sees is the residual and its derivative turned by the Q of their factorisation
    (`mjfish.block_angular`), as many rows as parameters and one for what is left: the same steps, at a cost that is
    linear in runs. A robust loss is one of single residuals, which cannot be turned.

    Args:
        problem: the residuals.
        start: (p,) where to start; None: the declared starts.
        tolerance: relative change of the cost at which it stops.
        evaluations: of the residual, at most.
        loss, loss_scale: robust loss of each whitened residual; what the result says of the data (`residual`,
            `jacobian`, covariances) is then weighted as the loss weighs it at the optimum.
    """
    low, high = bounds(problem.parameters)
    inside = 1e-6 * (high - low)
    x0 = np.clip(problem.start() if start is None else start, low + inside, high - inside)
    try:
        return _minimised(problem, x0, tolerance, evaluations, loss, loss_scale)
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


def _minimised(
    problem: Problem, x0: FloatArray, tolerance: float, evaluations: int, loss: Loss, loss_scale: float
) -> Fit:
    scale = np.array([p.scale for p in problem.parameters])
    low, high = bounds(problem.parameters)
    large = loss == "linear" and len(scale) > _EXACT
    turned = _Turned(problem, scale, large) if loss == "linear" else _Rows(problem, scale)
    with threadpool_limits(1, "blas"):  # matrices of nine columns: more threads only wait for each other
        some = _Some.of(turned, x0 / scale)
        moving = some.moving
        solution = optimize.least_squares(
            some.residual,
            some.start[moving],
            jac=some.jacobian,
            bounds=((low / scale)[moving], (high / scale)[moving]),
            method="trf",
            x_scale="jac",
            tr_solver="lsmr" if large else "exact",
            tr_options={**_EXACTLY, "maxiter": 10 * len(scale)} if large else {},
            ftol=tolerance,
            xtol=1e-8,
            gtol=1e-10,
            max_nfev=evaluations,
            loss=loss,
            f_scale=loss_scale,
        )
    ended, gradient = some.whole(solution.x), np.zeros(len(scale))
    gradient[moving] = solution.grad
    x, at_bound = _settle(ended * scale, low, high, gradient)
    end = End(
        x,
        ended,
        at_bound,
        "converged" if solution.status > 0 else "failed" if solution.nfev < evaluations else "stopped",
        str(solution.message),
        int(solution.nfev),
        2.0 * float(solution.cost),
    )
    return _fit_at(turned, _Ended(problem, end, loss, loss_scale))


@dataclass(frozen=True, eq=False)
class End:
    """Where an optimiser ended; the rest of a `Fit`, whose attributes these are, follows from the problem."""

    x: FloatArray
    ended: FloatArray
    at_bound: BoolArray
    status: Literal["converged", "stopped", "failed"]
    message: str
    evaluations: int
    cost: float


def fit_at(problem: Problem, end: End) -> Fit:
    """Return the `fit` of a problem by squares that is known to have ended there, to the last bit."""
    return _fit_at(_Rows(problem, np.array([p.scale for p in problem.parameters])), _Ended(problem, end, "linear", 1.0))


@dataclass(frozen=True, eq=False)
class _Ended:
    """Where the fit of a problem ended: what is large of the fit is made of this, once and again."""

    problem: Problem
    end: End
    loss: Loss
    loss_scale: float

    @property
    def _derived_at(self) -> FloatArray:
        return np.asarray(self.end.ended * [p.scale for p in self.problem.parameters])

    def plain(self) -> FloatArray:
        """Return the residual; putting an estimate onto its bound is a move too small for a derivative."""
        return self.problem.residual(self.end.x if self.end.at_bound.any() else self._derived_at)

    def weighted(self, plain: FloatArray) -> FloatArray:
        """Return the residual as the loss weighs it."""
        return plain if self.loss == "linear" else plain * self._weight(plain)

    def residual(self) -> FloatArray:
        """Return the residual of the fit."""
        return self.weighted(self.plain())

    def linearised(self) -> Linearised:
        """Return derivatives and covariance of the fit."""
        return self.seen(self.problem.jacobian(self._derived_at), self.plain)[0]

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
        return np.asarray(np.sqrt(slope(self.loss, (plain / self.loss_scale) ** 2)))


def _fit_at(turned: _Rows, ended: _Ended) -> Fit:
    problem, end = ended.problem, ended.end
    plain, jacobian = turned.at(end.ended)
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
        penalty=float(np.sum((turned.prior @ end.x - turned.mean) ** 2)),
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


class _Rows:
    """Residual and its derivative by scaled parameters y = x / scale as they are, rows of priors below."""

    def __init__(self, problem: Problem, scale: FloatArray) -> None:
        self.problem, self.scale = problem, scale
        self.prior, self.mean = problem.prior_root, problem.prior_mean

    def residual(self, y: FloatArray) -> FloatArray:
        """Return the residual at y (p,); refuse one that is not finite, as no rollout gives it."""
        x = y * self.scale
        whole = np.concatenate([self.problem.residual(x), self.mean - self.prior @ x])
        if not np.isfinite(whole).all():
            raise FloatingPointError("the residual is not finite")
        return whole

    def jacobian(self, y: FloatArray) -> FloatArray | sparse.csr_array:
        """Return its derivative at y (p,)."""
        return -self.problem.jacobian(y * self.scale).above(self.prior).dense() * self.scale

    def at(self, y: FloatArray) -> tuple[FloatArray, BlockAngular]:
        """Return the residual and the derivative of the prediction, by x and without priors, at a point y (p,)."""
        return self.problem.residual(y * self.scale), self.problem.jacobian(y * self.scale)


#: A sum of squares above the least by this share cannot be below it but for rounding; and what is then added to it.
_ABOVE, _BEYOND_DOUBT = 1e-12, 1e-9


class _Turned(_Rows):
    """Residual e and derivative turned by Q', with J = Q R at the point.

    The residual has p + 1 numbers: Q'e, and the length of what is left of e. The derivative is -R, with a row of zeros.
    Both are computed at once. A point that is not below the least sum of squares gets no derivative: the optimiser
    never goes on from there, for the sum of squares of what it sees is that of e to the last digits. The last point
    that got one is kept: the optimiser asks for its derivative, and the fit mostly ends there.
    """

    def __init__(self, problem: Problem, scale: FloatArray, large: bool) -> None:
        super().__init__(problem, scale)
        self._large, self._least = large, np.inf
        self._kept: dict[bytes, tuple[FloatArray, BlockAngular, FloatArray, BlockAngular]] = {}

    def residual(self, y: FloatArray) -> FloatArray:
        """Return the residual at y (p,)."""
        if known := self._kept.get(y.tobytes()):
            return known[0]
        whole, turned = super().residual(y), np.zeros(len(y) + 1)
        square = float(whole @ whole)
        if square >= self._least * (1.0 + _ABOVE):
            turned[-1] = np.sqrt(square * (1.0 + _BEYOND_DOUBT))
            return turned
        self._kept = {}  # the derivative of an hour of samples is large: not two at once
        jacobian = self.problem.jacobian(y * self.scale)
        factors = jacobian.above(self.prior).factorised()
        inside = factors.basis.coordinates(whole)
        turned[: len(inside)], turned[-1] = inside, np.sqrt(max(square - float(inside @ inside), 0.0))
        self._least, triangle = min(square, self._least), factors.triangle.scaled(columns=-self.scale)
        self._kept[y.tobytes()] = turned, triangle, whole[: len(whole) - len(self.mean)], jacobian
        return turned

    def jacobian(self, y: FloatArray) -> FloatArray | sparse.csr_array:
        """Return its derivative at y (p,), the last point that got one; without its zeros if large."""
        _, rows, _, _ = self._kept[y.tobytes()]
        if self._large:
            return rows.sparse(len(y) + 1)
        return np.pad(rows.dense(), ((0, len(y) + 1 - len(rows.shared)), (0, 0)))

    def at(self, y: FloatArray) -> tuple[FloatArray, BlockAngular]:
        """Return the residual and the derivative of the prediction, by x and without priors, at a point y (p,)."""
        known = self._kept.get(y.tobytes())
        return super().at(y) if known is None else known[2:]


#: A column shorter than this share of the longest does nothing.
_IDLE = 1e-12


@dataclass(frozen=True, eq=False)
class _Some:
    """Residual and derivative by the parameters that move: all but shapes that do nothing where a fit begins.

    The optimiser would take those from bound to bound, and cut every step of the others short. Those of a cause that
    does nothing yet may do something later.

    Attributes:
        turned: of all parameters.
        start: (p,) y where the fit begins.
        moving: places of those that move.
    """

    turned: _Rows
    start: FloatArray
    moving: IntArray

    @classmethod
    def of(cls, turned: _Rows, start: FloatArray) -> _Some:
        """Return them for a fit that begins at y (p,)."""
        pairs = [*zip(turned.problem.parameters, start * turned.scale, strict=True)]
        acting = {p.group for p, value in pairs if not p.shape and value != p.default}
        shapes = np.array([p.shape and p.group in acting for p, _ in pairs], dtype=np.bool_)
        if not shapes.any():
            return cls(turned, start, np.arange(len(shapes)))
        turned.residual(start)
        lengths = np.sqrt(np.asarray(sparse.csr_array(turned.jacobian(start)).power(2).sum(axis=0)).ravel())
        return cls(turned, start, np.flatnonzero(~(shapes & (lengths <= _IDLE * lengths.max(initial=0.0)))))

    def whole(self, moved: FloatArray) -> FloatArray:
        """Return all parameters y (p,)."""
        y = self.start.copy()
        y[self.moving] = moved
        return y

    def residual(self, moved: FloatArray) -> FloatArray:
        """Return the residual."""
        return self.turned.residual(self.whole(moved))

    def jacobian(self, moved: FloatArray) -> Any:
        """Return its derivative."""
        return self.turned.jacobian(self.whole(moved))[:, self.moving]


def slope(loss: Loss, z: FloatArray) -> FloatArray:
    """Return rho'(z) of a loss rho of z = (r / scale)^2, as `scipy.optimize.least_squares` has them."""
    if loss == "soft_l1":
        return np.asarray(1.0 / np.sqrt(1.0 + z))
    if loss == "huber":
        return np.asarray(np.where(z > 1.0, 1.0 / np.sqrt(np.maximum(z, 1.0)), 1.0))
    if loss == "cauchy":
        return np.asarray(1.0 / (1.0 + z))
    return np.asarray(1.0 / (1.0 + z**2) if loss == "arctan" else np.ones_like(z))


def _settle(x: FloatArray, low: FloatArray, high: FloatArray, gradient: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Put estimates that the fit pushes against a bound onto it (trf itself stays strictly inside)."""
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
    short = {**robust, "tolerance": _SCOUT_TOLERANCE, "evaluations": _SCOUT}
    scouts = []
    for scout in problem.mapped(scouted, points, **short):
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
