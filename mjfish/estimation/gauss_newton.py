"""Least squares within bounds: Gauss-Newton steps in a trust region, each the exact minimum of its model there.

At x, with the residual e and the derivative J of the prediction, the step s minimises

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
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy import optimize

from mjfish.arrays import FloatArray
from mjfish.block_angular import BlockAngular
from mjfish.estimation.problem import Problem
from mjfish.estimation.settings import Loss

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
            radius = _next_radius(radius, size, ratio)
        if not ahead:
            break
        x, here, cost = moved, there, new
        del jacobian  # not two at once
    status: Literal["converged", "stopped"] = "converged" if message else "stopped"
    message = message or f"the most evaluations were used, {evaluations}"
    gradient = -triangle.transposed_times(turned)
    return Minimum(x, here[: len(here) - len(mean)], jacobian, gradient, cost, done, status, message)


def _next_radius(radius: float, size: float, ratio: float) -> float:
    """Return the radius after a step of a size whose fall of the cost was this ratio of the one that was predicted."""
    if ratio < _POOR:
        return _SHRINK * size
    return _GROW * radius if ratio > _GOOD and size > _HELD * radius else radius


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
