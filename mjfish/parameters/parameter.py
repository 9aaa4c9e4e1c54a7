"""The declaration of a number that can be fitted: name, unit, default, bounds. Declared once, read everywhere."""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from numbers import Real

import numpy as np

from mjfish.errors import ParameterError
from mjfish.errors.arguments import check
from mjfish.numerics.arrays import FloatArray

#: Ratio of positive bounds above which they are far apart.
_WIDE = 5.0
#: Least value whose logarithm is taken.
_TINY = 1e-300
#: Largest power of e that is taken.
_HUGE = 600.0


@dataclass(frozen=True)
class Parameter:
    """A number that can be fitted.

    Attributes:
        name: full address, e.g. ``c_d.head`` or ``servo_lag.time_constant``.
        unit: SI unit, ``-`` for a dimensionless number.
        default: value where nobody gives one; of a cause: its null value, at which it does nothing.
        low: smallest allowed value.
        high: largest allowed value.
        start: where a fit starts.
        scale: a change that is neither negligible nor large, used to scale fits and finite differences.
        about: one line for tables and reports.
        shape: of a cause: matters only where an amplitude of the cause is off its null (e.g. a damping).
        sd: how well the number is known beforehand, in its own unit; None: only its bounds are known. See `deviation`.
        mean: what it is known to be; None: the default.

    Raises:
        ParameterError: bounds, start, default and scale contradict each other.

    Example:
        >>> import mjfish
        >>> drag = mjfish.Parameter("c_d.head", "-", default=1.0, low=0.1, high=4.0, start=1.0, scale=0.1)
        >>> drag.check(2.0)
        2.0
    """

    name: str
    unit: str
    default: float
    low: float
    high: float
    start: float
    scale: float
    about: str = ""
    shape: bool = False
    sd: float | None = None
    mean: float | None = None

    def __post_init__(self) -> None:
        """Refuse declarations that contradict themselves."""
        check("Parameter: name", self.name, str)
        for field in ("default", "low", "high", "start", "scale"):
            if not _finite(getattr(self, field)):
                raise ParameterError(f"{self.name}: {field} is {getattr(self, field)!r}, expected a finite number")
        if not self.low < self.high:
            raise ParameterError(f"{self.name}: bounds [{self.low:g}, {self.high:g}] are empty; low must be below high")
        if not self.scale > 0.0:
            raise ParameterError(f"{self.name}: scale is {self.scale:g}, expected a positive number")
        self.check(self.default, "default")
        self.check(self.start, "start")
        if self.mean is not None:
            self.check(self.mean, "mean")
        if self.sd is not None and not (_finite(self.sd) and self.sd > 0.0):
            raise ParameterError(
                f"{self.name}: sd is {self.sd!r} {self.unit}, expected a positive number; leave it out where nothing "
                "is known"
            )

    @property
    def expected(self) -> float:
        """What the number is known to be: its mean, or else the default."""
        return self.default if self.mean is None else self.mean

    @property
    def log_normal(self) -> bool:
        """Whether what is known is a factor: of numbers that cannot be negative."""
        return self.sd is not None and self.low >= 0.0 and self.expected > 0.0

    def deviation(self, value: float) -> float:
        """Return how far a value is from the expected one, in units of the sd; 0 where no sd is given.

        (value - expected) / sd; of numbers that cannot be negative log(value / expected) / log(1 + sd / expected): one
        sd more is expected + sd, and zero is infinitely far.
        """
        if self.sd is None:
            return 0.0
        if self.log_normal:
            return math.log(max(value, _TINY) / self.expected) / math.log1p(self.sd / self.expected)
        return (value - self.expected) / self.sd

    def at_deviation(self, deviation: float) -> float:
        """Return the value that is so many sds from the expected one, the inverse of `deviation`."""
        if self.sd is None:
            return self.expected
        if self.log_normal:
            return self.expected * math.exp(min(deviation * math.log1p(self.sd / self.expected), _HUGE))
        return self.expected + deviation * self.sd

    def deviation_rate(self, value: float) -> float:
        """Return the derivative of `deviation` [1/unit]."""
        if self.sd is None:
            return 0.0
        return 1.0 / (max(value, _TINY) * math.log1p(self.sd / self.expected)) if self.log_normal else 1.0 / self.sd

    @functools.cached_property
    def group(self) -> str:
        """The part before the dot: a coefficient (``c_d``) or the name of an effect."""
        return self.name.partition(".")[0]

    @functools.cached_property
    def short(self) -> str:
        """The part after the dot."""
        return self.name.partition(".")[2]

    @property
    def wide(self) -> bool:
        """Whether its bounds are positive and far apart, so that its values are compared by ratios."""
        return self.low > 0.0 and self.high > _WIDE * self.low

    def check(self, value: float, what: str = "value") -> float:
        """Return `value`, or raise `ParameterError` where it lies outside the bounds."""
        if not (_finite(value) and self.low <= value <= self.high):
            shown = f"{value:g} {self.unit}" if isinstance(value, Real) else repr(value)
            raise ParameterError(
                f"{self.name}: {what} {shown} is outside its bounds [{self.low:g}, {self.high:g}]; "
                "choose a value inside, or widen the bounds where they are declared"
            )
        return value

    def rebound(self, *, low: float | None = None, high: float | None = None, start: float | None = None) -> Parameter:
        """Return the same parameter with other bounds or start; a default left outside moves to the nearest bound."""
        low = self.low if low is None else low
        high = self.high if high is None else high
        return replace(
            self,
            low=low,
            high=high,
            start=min(max(self.start, low), high) if start is None else start,
            default=min(max(self.default, low), high),
        )


def _finite(value: object) -> bool:
    return isinstance(value, Real) and math.isfinite(value)


def bounds(parameters: Sequence[Parameter]) -> tuple[FloatArray, FloatArray]:
    """Return the lower and the upper bounds (p,) of parameters."""
    return np.array([p.low for p in parameters]), np.array([p.high for p in parameters])
