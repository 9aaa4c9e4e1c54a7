"""Intervals that hold when residuals are correlated in time: the sandwich, beside the plain ones.

    plain     (J'J)^-1
    sandwich  (J'J)^-1 J' Omega J (J'J)^-1  =  A' Omega A,   A = J (J'J)^-1

[White1982] with the residuals' own covariance Omega (`mjfish.estimation.serial_correlation`) in the middle. Estimates
move by A' e: each variance is a quadratic form of the residual, and its degrees of freedom give the quantile of
Student's t.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import stats

from mjfish.arrays import BoolArray, FloatArray
from mjfish.estimation.fit import Fit
from mjfish.estimation.problem import Problem
from mjfish.estimation.serial_correlation import Block, Serial, blocks_of, by_trial, serial, stacked
from mjfish.parameter import bounds


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
    blocks = blocks_of(problem, fit)
    found = serial(blocks, ~fit.at_bound)
    own, degrees_of_freedom = _sandwich(found, blocks, ~fit.at_bound)
    sigma, plain = np.sqrt(np.diag(own)), np.sqrt(np.diag(fit.covariance))
    if np.any(fit.at_bound):
        all_free, loose = _sandwich(found, blocks, np.ones_like(fit.at_bound))
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


def _sandwich(found: Serial, blocks: Sequence[Block], free: BoolArray) -> tuple[FloatArray, FloatArray]:
    """Return A' Omega A (p, p) and the freedom (p,) of its diagonal; zero and one where a parameter is not free.

    A = U S^-1 V' of the singular value decomposition: a direction that nothing moves gets a huge variance, not none.
    """
    index = np.flatnonzero(free)
    left, singular, right = np.linalg.svd(stacked(blocks, free), full_matrices=False)
    floor = np.maximum(singular, 1e-10 * max(singular.max(initial=0.0), 1e-100))
    columns = by_trial((left / floor) @ right, blocks)
    covariance, degrees_of_freedom = np.zeros((len(free), len(free))), np.ones(len(free))
    covariance[np.ix_(index, index)] = found.quadratic(columns)
    degrees_of_freedom[index] = np.maximum(found.degrees_of_freedom(columns), 1.0)
    return covariance, degrees_of_freedom


def _cut(fit: Fit, half: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return estimates less and plus `half`, cut at the bounds."""
    low, high = bounds(fit.parameters)
    return np.maximum(fit.x - half, low), np.minimum(fit.x + half, high)
