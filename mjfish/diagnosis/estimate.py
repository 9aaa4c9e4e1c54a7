"""Estimates of a fitted model with their intervals, and what was known of them beforehand."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from mjfish.arrays import FloatArray
from mjfish.estimation import Fit
from mjfish.estimation.fit import Z95
from mjfish.formats import fixed, number, unit
from mjfish.model import Model
from mjfish.parameter import Parameter


@dataclass(frozen=True)
class Estimate:
    """An estimate with its 95 % interval.

    Attributes:
        estimate, low, high: it, and the ends of the interval.
        unit: of all.
        at_bound: whether it rests on a bound.
        known: what was known of it beforehand; None: its bounds alone.
        settled: whether the data say anything of it: its interval does not reach from bound to bound.
    """

    estimate: float
    low: float
    high: float
    unit: str
    at_bound: bool = False
    known: KnownNumber | None = None
    settled: bool = True

    @property
    def rounded(self) -> str:
        """The estimate to the places its interval deserves (two digits of its half width); a bound as it is."""
        return f"{self.estimate:g}" if self.at_bound else self._rounded(self.estimate)

    @property
    def interval(self) -> str:
        """The interval to the same places; that there is none where the data say nothing; empty without a width."""
        if not self.settled:
            return "these runs do not settle it"
        return f"{self._rounded(self.low)} to {self._rounded(self.high)}" if self.high > self.low else ""

    def _rounded(self, value: float) -> str:
        half = 0.5 * (self.high - self.low)
        if not (math.isfinite(half) and half > 0.0) or not 1e-4 <= max(abs(self.low), abs(self.high)) < 1e6:
            return number(value)
        return fixed(value, min(1 - math.floor(math.log10(half)), 9))

    @property
    def told(self) -> str:
        """The estimate with its unit and its interval, or that it rests on a bound without one."""
        return f"{self.rounded} {unit(self.unit)}".rstrip() + f" ({self.interval or 'on its bound'})"


@dataclass(frozen=True)
class KnownNumber:
    """What was known of a number: its mean and sd, and how many sds the estimate is away (`Parameter.deviation`)."""

    mean: float
    sd: float
    deviation: float


def linearised(
    found: Fit, parameters: Iterable[Parameter], at: Callable[[Mapping[str, float]], FloatArray]
) -> tuple[FloatArray, FloatArray, dict[str, FloatArray]]:
    """Return a function y (n,) of fitted numbers, half the width of its 95 % band (n,), and its derivatives by name.

    The band is that of the linearised fit, 1.96 sqrt(g' C g) with the derivatives g of y by the parameters.

    Args:
        found: the fit.
        parameters: on which y depends; those that were not fitted have no error.
        at: returns y at values by name.
    """
    index, values = {p.name: i for i, p in enumerate(found.parameters)}, found.values
    y, slopes = at(values), {}
    for p in (p for p in parameters if p.name in index):
        h = 1e-3 * p.scale
        ahead, behind = (at({**values, p.name: values[p.name] + step}) for step in (h, -h))
        slopes[p.name] = (ahead - behind) / (2.0 * h)
    rows, along = [index[name] for name in slopes], np.array([*slopes.values()]).reshape(len(slopes), len(y))
    variance = np.einsum("ji,jk,ki->i", along, found.covariance[np.ix_(rows, rows)], along)
    return y, Z95 * np.sqrt(np.maximum(variance, 0.0)), slopes


def estimates(found: Fit, model: Model) -> dict[str, Estimate]:
    """Return the model's estimates by name, without parameters of single trials.

    A refit keeps an amplitude that cannot be negative slightly above zero; an interval that reaches this bound reaches
    zero. A shape parameter to which these data are insensitive has its default.
    """
    result = {}
    declared = {p.name: p for p in model.parameters}
    for p, at_bound, length in zip(found.parameters, found.at_bound, found.lengths, strict=True):
        if ":" not in p.name:
            low, high = found.interval(p.name, Z95)
            settled = low > p.low or high < p.high
            low = declared.get(p.name, p).low if low <= p.low else low
            value = p.default if p.shape and length == 0.0 else found.values[p.name]
            known = None if p.sd is None else KnownNumber(p.expected, p.sd, float(p.deviation(value)))
            result[p.name] = Estimate(value, low, high, p.unit, bool(at_bound), known, settled)
    return result
