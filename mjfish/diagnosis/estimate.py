"""Estimates of a fitted model with their intervals, and what was known of them beforehand."""

from __future__ import annotations

from dataclasses import dataclass

from mjfish.estimation import Fit
from mjfish.estimation.fit import Z95
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
    """

    estimate: float
    low: float
    high: float
    unit: str
    at_bound: bool = False
    known: KnownNumber | None = None


@dataclass(frozen=True)
class KnownNumber:
    """What was known of a number: its mean and sd, and how many sds the estimate is away (`Parameter.deviation`)."""

    mean: float
    sd: float
    deviation: float

    @classmethod
    def of(cls, p: Parameter, value: float) -> KnownNumber | None:
        """Return what was known of a parameter, and how far a value is from it."""
        return None if p.sd is None else cls(p.expected, p.sd, float(p.deviation(value)))


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
            low = declared.get(p.name, p).low if low <= p.low else low
            value = p.default if p.shape and length == 0.0 else found.values[p.name]
            result[p.name] = Estimate(value, low, high, p.unit, bool(at_bound), KnownNumber.of(p, value))
    return result
