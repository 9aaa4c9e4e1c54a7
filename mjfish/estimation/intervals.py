"""Intervals of estimates: plain, of correlated residuals (the sandwich), and by profile likelihood; the posterior.

    plain     (J'J)^-1
    sandwich  (J'J)^-1 J' Omega J (J'J)^-1  =  A' Omega A,   A = J (J'J)^-1

[White1982] with the residuals' own covariance Omega (`mjfish.estimation.serial_correlation`) in the middle. Estimates
move by A' e: each variance is a quadratic form of the residual, and its degrees of freedom give the quantile of
Student's t.

The profile likelihood of a parameter says how much worse the best fit gets as that parameter is held elsewhere.

    SSE_p(v) = min over the others of SSE with p = v;    interval: SSE_p(v) - SSE <= chi2_1(level) * scale

With white noise of the stated size `scale` is 1. In general it is the squared inflation of the standard error of that
parameter: where the sum of squares is a parabola the profile then gives the
sandwich's interval ([Kent1982] for one parameter), and where it is not, an interval that a parabola cannot give.

**Posterior.** Mean, covariance and scatter of the parameters that all runs share. With the whitened Jacobian J of all
free parameters and the roots P of their priors, errors have the covariance

    B = (J'J + P'P)^-1,    or where residuals are correlated in time    B (J' Omega J + P'P) B,

the first as the intervals of a diagnosis, whose noise model whitens the residuals, the second as those of an
identification. Estimates on a bound count as free: how far they may lie from it, and
how the others then follow, is in the covariance. Every parameter has a Gaussian prior about its estimate, as wide as
its bounds are apart: what the data do not say stays finite. Of one that they know to a tenth of its range this takes
0.5 % off the standard error.

A coefficient that a learned curve scales, as in c_d exp(curve), is known in its product with it alone. A Gaussian of
both is wide along that hyperbola and leaves it. So the coefficient is held, and the curve has all of the error.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Literal

import numpy as np
from scipy import stats

from mjfish.errors import InputError, UnknownNameError
from mjfish.estimation.fit import Fit, covariance, fit
from mjfish.estimation.problem import Problem
from mjfish.estimation.serial_correlation import Block, Serial, middle, satterthwaite, serial, serial_blocks
from mjfish.execution import mapped
from mjfish.fish import Fish
from mjfish.model.posterior import Posterior
from mjfish.numerics.arrays import BoolArray, FloatArray
from mjfish.numerics.block_angular import BlockAngular, span
from mjfish.parameters import bounds


@dataclass(frozen=True, eq=False)
class Intervals:
    """Intervals of the estimates of a fit.

    Attributes:
        names: of the free parameters (p,).
        level: of the intervals.
        x: estimates (p,).
        low: (p,) of the interval, cut at the bounds; one-sided where the estimate rests on a bound.
        high: (p,).
        covariance: (p, p) of the sandwich; rows and columns of parameters at a bound are zero.
        sigma: (p,) standard errors of the sandwich; at a bound, were it not there.
        degrees_of_freedom: (p,) degrees of freedom of those.
        plain_low: (p,) of the interval that takes the residuals for white noise of the stated size.
        plain_high: (p,).
        plain_sigma: (p,) standard errors of that.
        windows: (3,) longest lag [s] at which residuals of surge, sway, yaw rate are correlated.
        at_bound: (p,) whether the estimate rests on a bound.
    """

    names: tuple[str, ...]
    level: float
    x: FloatArray
    low: FloatArray
    high: FloatArray
    covariance: FloatArray
    sigma: FloatArray
    degrees_of_freedom: FloatArray
    plain_low: FloatArray
    plain_high: FloatArray
    plain_sigma: FloatArray
    windows: FloatArray
    at_bound: BoolArray

    @property
    def inflation(self) -> FloatArray:
        """How many times wider (p,) a standard error is than the plain one."""
        return np.asarray(self.sigma / np.maximum(self.plain_sigma, 1e-300))

    def interval(self, name: str) -> tuple[float, float]:
        """Return the interval of one estimate."""
        index = self.names.index(name)
        return float(self.low[index]), float(self.high[index])

    def to_dict(self) -> dict[str, Any]:
        """Return the intervals as plain data."""
        return {
            "level": self.level,
            "windows": self.windows.tolist(),
            "parameters": {
                name: {
                    "estimate": float(self.x[i]),
                    "low": float(self.low[i]),
                    "high": float(self.high[i]),
                    "standard_error": float(self.sigma[i]),
                    "degrees_of_freedom": float(self.degrees_of_freedom[i]),
                    "plain_low": float(self.plain_low[i]),
                    "plain_high": float(self.plain_high[i]),
                    "plain_standard_error": float(self.plain_sigma[i]),
                    "at_bound": bool(self.at_bound[i]),
                }
                for i, name in enumerate(self.names)
            },
        }


def intervals(problem: Problem, fit: Fit, *, level: float = 0.95) -> Intervals:
    """Return the intervals of a fit that has converged.

    Args:
        problem: that was fitted.
        fit: of it.
        level: of the intervals.
    """
    blocks, found = _serial_of(problem, fit)
    own, degrees_of_freedom = _sandwich(found, blocks, problem.measured, fit.jacobian, ~fit.at_bound)
    sigma, plain = np.sqrt(np.diag(own)), np.sqrt(np.diag(fit.covariance))
    if np.any(fit.at_bound):
        all_free, loose = _sandwich(found, blocks, problem.measured, fit.jacobian, np.ones_like(fit.at_bound))
        sigma = np.where(fit.at_bound, np.sqrt(np.diag(all_free)), sigma)
        degrees_of_freedom = np.where(fit.at_bound, loose, degrees_of_freedom)
        plain = np.where(fit.at_bound, fit.reach, plain)
    low, high = _cut(fit, stats.t.ppf(0.5 + 0.5 * level, degrees_of_freedom) * sigma)
    plain_low, plain_high = _cut(fit, stats.norm.ppf(0.5 + 0.5 * level) * plain)
    return Intervals(
        names=tuple(p.name for p in fit.parameters),
        level=level,
        x=fit.x,
        low=low,
        high=high,
        covariance=own,
        sigma=sigma,
        degrees_of_freedom=degrees_of_freedom,
        plain_low=plain_low,
        plain_high=plain_high,
        plain_sigma=plain,
        windows=found.windows,
        at_bound=fit.at_bound,
    )


def coefficient_rows(fit: Fit, known: Intervals | None = None) -> list[dict[str, Any]]:
    """Return a row a free parameter: estimate, 95 % interval, standard error, and how it was declared.

    Args:
        fit: the estimates; of it are the columns ``plain_..``, which take the residuals for white noise.
        known: intervals that hold for correlated residuals; None: no columns for them.
    """
    interval_of = known.to_dict()["parameters"] if known is not None else {}
    return [
        {
            "parameter": p.name,
            "unit": p.unit,
            "estimate": fit.values[p.name],
            "at_bound": bool(at_bound),
            "plain_low": fit.interval(p.name)[0],
            "plain_high": fit.interval(p.name)[1],
            "plain_standard_error": fit.sigma[p.name],
            **interval_of.get(p.name, {}),
            "start": p.start,
            "lower_bound": p.low,
            "upper_bound": p.high,
            "about": p.about,
        }
        for p, at_bound in zip(fit.parameters, fit.at_bound, strict=True)
    ]


def _serial_of(problem: Problem, fit: Fit) -> tuple[tuple[Block, ...], Serial]:
    """Return the residuals of a fit, and their covariance in time."""
    blocks = serial_blocks(problem, fit.residual)
    return blocks, serial(blocks, fit.jacobian.chosen(~fit.at_bound).top(problem.measured).factors.basis)


def _sandwich(
    found: Serial, blocks: Sequence[Block], measured: int, jacobian: BlockAngular, free: BoolArray
) -> tuple[FloatArray, FloatArray]:
    """Return A' Omega A (p, p) and the freedom (p,) of its diagonal; zero and one where a parameter is not free.

    A = Q U S^-1 V' with J = Q R, R = U S V': a direction that nothing moves gets a huge variance, not none. Omega is 1
    in the rows behind the `measured` ones, of what is known of the parameters. The degrees of freedom of a parameter
    of one run are those of its rows.
    """
    own = jacobian.chosen(free)
    factors = own.factors
    left, singular, right = np.linalg.svd(factors.triangle.dense(), full_matrices=False)
    floor = np.maximum(singular, 1e-10 * max(singular.max(initial=0.0), 1e-100))
    turned = (left / floor) @ right
    covariance, degrees_of_freedom = np.zeros((len(free), len(free))), np.ones(len(free))
    index = np.flatnonzero(free)
    covariance[np.ix_(index, index)] = turned.T @ middle(found, blocks, factors.basis, measured) @ turned
    moments = np.zeros((2, len(index)))
    for r, block in enumerate(blocks):
        run, q, shared = factors.basis.at(block.rows)
        rows = np.concatenate([factors.basis.places_of(run), factors.basis.places_of(None)])
        columns = np.concatenate([own.parts[run].columns if run >= 0 else own.places[:0], own.places])
        moments[:, columns] += found.moments(r, block.on_grid(np.hstack([q, shared]) @ turned[np.ix_(rows, columns)]))
    degrees_of_freedom[index] = np.maximum(satterthwaite(*moments), 1.0)
    return covariance, degrees_of_freedom


def _cut(fit: Fit, half: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return estimates less and plus `half`, cut at the bounds."""
    low, high = bounds(fit.parameters)
    return np.maximum(fit.x - half, low), np.minimum(fit.x + half, high)


#: Of half the interval that a parabola has: the first step, and the longest share that a step may be of the next.
_FIRST = 0.25
_GROWTH = 1.5
#: Refits on one side, at most.
_POINTS = 16
#: A refit this much below the fit, in units of the threshold, has found a better optimum.
_BETTER = 0.01

Side = Literal["crossed", "bound", "stopped"]


@dataclass(frozen=True, eq=False)
class Profile:
    """Profile of one parameter.

    Attributes:
        name: of the parameter.
        unit: of it.
        estimate: of the fit.
        sigma: its standard error: the rise of a parabola would be ((value - estimate) / sigma)^2.
        values: (k,) at which it was held, ascending, the estimate among them.
        rise: (k,) of the sum of squares above that of the fit, in units of `scale`: -2 log likelihood ratio.
        others: estimates (k, p - 1) of the other free parameters, in the order of the fit.
        scale: by which rises were divided.
        level: of the interval.
        threshold: of `rise`.
        low: end of the interval, or the bound that was reached before.
        high: likewise.
        low_side: ``crossed``: the threshold was found; ``bound``: the bound was reached below it; ``stopped``: neither,
            because refits diverged or were too many.
        high_side: likewise.
        status: ``ok``, ``open`` (a side that is not ``crossed``) or ``better_optimum`` (a refit found a lower sum of
            squares: start the fit again from there).
        better: parameters of that better optimum by name; empty where there is none.
    """

    name: str
    unit: str
    estimate: float
    sigma: float
    values: FloatArray
    rise: FloatArray
    others: FloatArray
    scale: float
    level: float
    threshold: float
    low: float
    high: float
    low_side: Side
    high_side: Side
    status: Literal["ok", "open", "better_optimum"]
    better: dict[str, float]


@dataclass(frozen=True)
class _Point:
    """One refit."""

    value: float
    rise: float
    others: FloatArray


def profile(
    problem: Problem,
    fitted: Fit,
    name: str,
    *,
    level: float = 0.95,
    known: Intervals | None = None,
) -> Profile:
    """Profile a parameter: refit all others with it held at values stepping outwards until the threshold or a bound.

    Args:
        problem: that was fitted.
        fitted: its fit, converged.
        name: of a free parameter.
        level: of the interval.
        known: intervals of the fit, made here where they are not given.

    Raises:
        UnknownNameError: no free parameter has that name.
        InputError: the problem does not let it be held.
    """
    names = [p.name for p in fitted.parameters]
    if name not in names:
        raise UnknownNameError("free parameter", name, names)
    index = names.index(name)
    known = known or intervals(problem, fitted, level=level)
    scale = float(known.inflation[index]) ** 2
    threshold = float(stats.chi2.ppf(level, 1))
    walk = _Walk(problem, fitted, index, scale, threshold, float(known.sigma[index]))
    start = _Point(float(fitted.x[index]), 0.0, np.delete(fitted.x, index))
    down, low, low_side = walk.outwards(start, -1.0)
    up, high, high_side = walk.outwards(start, 1.0)
    points = [*down[::-1], start, *up]
    best = min(points, key=lambda point: point.rise)
    better = best.rise < -_BETTER * threshold
    return Profile(
        name=name,
        unit=fitted.parameters[index].unit,
        estimate=start.value,
        sigma=float(known.sigma[index]),
        values=np.array([point.value for point in points]),
        rise=np.array([point.rise for point in points]),
        others=np.array([point.others for point in points]),
        scale=scale,
        level=level,
        threshold=threshold,
        low=low,
        high=high,
        low_side=low_side,
        high_side=high_side,
        status="better_optimum" if better else ("ok" if low_side == high_side == "crossed" else "open"),
        better=dict(zip(names, np.insert(best.others, index, best.value).tolist(), strict=True)) if better else {},
    )


def profiles(
    problem: Problem, fitted: Fit, names: Sequence[str], *, known: Intervals | None = None, level: float = 0.95
) -> Iterator[Profile]:
    """Yield the `profile` of each of these parameters, side by side."""
    known = known or intervals(problem, fitted, level=level)
    return mapped(partial(profile, problem, fitted, known=known, level=level), names, sent=True)


@dataclass(frozen=True, eq=False)
class _Walk:
    """What both sides share."""

    problem: Problem
    fitted: Fit
    index: int
    scale: float
    threshold: float
    sigma: float

    def outwards(self, start: _Point, sign: float) -> tuple[list[_Point], float, Side]:
        """Return the points on one side, outwards, the end of the interval there and what it is."""
        p = self.fitted.parameters[self.index]
        bound = p.high if sign > 0.0 else p.low
        step = min(_FIRST * self.sigma * np.sqrt(self.threshold), abs(bound - start.value))
        points = [start]
        while len(points) <= _POINTS and points[-1].value != bound:
            new = self._at(float(np.clip(points[-1].value + sign * step, p.low, p.high)), points)
            if new is None:
                break
            points.append(new)
            done = new.value - points[-2].value
            if new.rise > self.threshold:  # its root is nearly straight in the value
                before, after = (np.sqrt(max(point.rise, 0.0)) for point in points[-2:])
                share = (np.sqrt(self.threshold) - before) / max(after - before, 1e-12)
                return points[1:], float(points[-2].value + share * done), "crossed"
            before, after = (np.sqrt(max(point.rise, 0.0) / self.threshold) for point in points[-2:])
            step = float(abs(done) * np.clip(_FIRST / max(after - before, 1e-12), 1.0 / _GROWTH, _GROWTH))
        reached = points[-1].value == bound and len(points) <= _POINTS
        return points[1:], points[-1].value, "bound" if reached else "stopped"

    def _at(self, value: float, points: list[_Point]) -> _Point | None:
        """Refit the others, from where the last two points lead; None where the fit diverges."""
        p = self.fitted.parameters[self.index]
        held = replace(self.problem, fixed={**self.problem.fixed, p.name: value})
        if p.name in {other.name for other in held.parameters}:
            raise InputError(f"'{p.name}' cannot be held fixed in this problem; profile a parameter of the model")
        others = points[-1].others + self._slope(points) * (value - points[-1].value)
        if len(others) == 0:
            residual = held.residual(others)
            return _Point(value, (float(residual @ residual) - self.fitted.sse) / self.scale, others)
        refit = fit(held, np.clip(others, *bounds(held.parameters)))
        return None if refit.lost else _Point(value, (refit.cost - self.fitted.cost) / self.scale, refit.x)

    def _slope(self, points: list[_Point]) -> FloatArray:
        """Return how the others follow: the secant of the last two points; at the start the fit's covariance."""
        if len(points) > 1 and points[-1].value != points[-2].value:
            return np.asarray((points[-1].others - points[-2].others) / (points[-1].value - points[-2].value))
        own = float(self.fitted.covariance[self.index, self.index])
        return np.delete(self.fitted.covariance[self.index], self.index) / own if own > 0.0 else np.zeros(1)


def posterior(problem: Problem, fit: Fit, fish: Fish, scatter: Mapping[str, float], *, correlated: bool) -> Posterior:
    """Return the posterior of a fit that did not diverge, without parameters of single trials.

    Args:
        problem: that was fitted.
        fit: of it.
        fish: with values and bounds of the fit (`mjfish.estimation.identification.identified_fish`).
        scatter: from run to run, by name (`mjfish.estimation.stability`); what is not named has none.
        correlated: whether the whitened residuals may be correlated in time.
    """
    low, high = bounds(fit.parameters)
    factors = fit.jacobian.above(np.concatenate([problem.prior_root, np.diag(1.0 / (high - low))])).factors
    errors = covariance(factors.triangle, _stood_in_for(problem, fit))
    if correlated:
        blocks, found = _serial_of(problem, fit)
        moves = factors.triangle @ errors
        errors = moves.T @ middle(found, blocks, factors.basis, problem.measured) @ moves
    own = {p.name for p in problem.model.parameters}
    shared = [k for k, p in enumerate(fit.parameters) if p.name in own]
    names = tuple(fit.parameters[k].name for k in shared)
    return Posterior(
        model=replace(problem.model, fish=fish),
        names=names,
        mean=fit.x[shared],
        covariance=errors[np.ix_(shared, shared)],
        scatter=np.array([scatter.get(name, 0.0) for name in names]),
        runs=len(problem.trials),
    )


def _stood_in_for(problem: Problem, fit: Fit) -> BoolArray:
    """Return which parameters (p,) are coefficients for which learned curves stand in.

    Those of a model with priors that the data without them know no better than to their own size, one after the other.
    """
    held = np.zeros_like(fit.at_bound)
    for k, p in enumerate(fit.parameters):
        if problem.priors and p.name in problem.model.fish.coefficient_names:
            others = ~held
            others[k] = False
            own = span(fit.jacobian.chosen(others)).off(fit.jacobian.of_columns([k])[:, 0])
            held[k] = float(own @ own) * fit.x[k] ** 2 < 1.0
    return held
