"""What a fit leaves free, where it starts, how it weighs: by patterns of parameters' names."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from typing import Literal, TypeVar, get_args

import numpy as np

from mjfish.errors import InputError, UnknownNameError
from mjfish.numerics.arrays import FloatArray
from mjfish.parameters import Parameter

Loss = Literal["linear", "soft_l1", "huber", "cauchy", "arctan"]
Weights = Literal["noise", "paper"]
#: sigma (3,) that is W^(-1/2) of [Yu2016], sec. V-B: deviations count in cm/s and degrees a second.
PAPER_SIGMA = (0.01, 0.01, math.pi / 180.0)
Bounds = tuple[float | None, float | None]
T = TypeVar("T")
#: Starts beyond this number would take years.
_MOST_STARTS = 1_000_000


@dataclass(frozen=True)
class Settings:
    """Settings of a fit; every pattern is one of `fnmatch`, such as ``c_m.*`` or ``*.tail``.

    Attributes:
        free: patterns of parameters that are fitted; the others stay at their values.
        fixed: values of parameters that are not fitted, by pattern; None: the fish's own value.
        bounds: low and high by pattern; None: as declared.
        start: where the fit starts, by pattern.
        loss: of a whitened residual, see `scipy.optimize.least_squares`; all but ``linear`` bear outliers.
        loss_scale: residual, in sigmas, from which on a robust loss grows more slowly than its square.
        weights: ``noise``: each channel by its sigma; ``paper``: by the weight matrix of [Yu2016].
        starts: fits from a Latin hypercube over the bounds, the declared start among them; 1: from that alone.
        seed: of the hypercube.
    """

    free: Sequence[str] = ("*",)
    fixed: Mapping[str, float | None] = field(default_factory=dict)
    bounds: Mapping[str, Bounds] = field(default_factory=dict)
    start: Mapping[str, float] = field(default_factory=dict)
    loss: Loss = "linear"
    loss_scale: float = 2.0
    weights: Weights = "noise"
    starts: int = 16
    seed: int = 0

    def __post_init__(self) -> None:
        """Refuse names of what there is not."""
        for kind, name, known in (("loss", self.loss, get_args(Loss)), ("weights", self.weights, get_args(Weights))):
            if name not in known:
                raise UnknownNameError(kind, name, known)
        if not 1 <= self.starts <= _MOST_STARTS:
            raise InputError(f"starts is {self.starts}, expected 1 to {_MOST_STARTS}; correct it")
        if not (math.isfinite(self.loss_scale) and self.loss_scale > 0.0):
            raise InputError(f"loss_scale is {self.loss_scale:g}, expected a positive number of sigmas")

    def sigma(self, noise: FloatArray) -> FloatArray:
        """Return the sigma (3,) that residuals are divided by, from that of the noise."""
        return np.array(PAPER_SIGMA) if self.weights == "paper" else noise

    def choose(self, parameters: Sequence[Parameter]) -> tuple[dict[str, float], dict[str, Parameter]]:
        """Return the values of parameters that are not fitted, and other declarations of those that are.

        Raises:
            UnknownNameError: a pattern that fits no parameter.
            InputError: two patterns say different things of one parameter; nothing is left free.
            ParameterError: a start or a value outside its bounds, or empty bounds.
        """
        names = [p.name for p in parameters]
        bounds = _by_name("bounds", self.bounds, names)
        start = _by_name("start", self.start, names)
        given = _by_name("fix", self.fixed, names)
        free = {name for pattern in self.free for name in _matched("free", pattern, names)}
        both = sorted(set(given) & (set(start) | set(bounds)))
        if both:
            raise InputError(f"{both[0]} is fixed, and given a start or bounds too; drop one of the two")
        declared, fixed = {}, {}
        for p in parameters:
            low, high = bounds.get(p.name, (None, None))
            if p.name in given or p.name not in free:
                value = given.get(p.name)
                fixed[p.name] = p.check(p.default if value is None else value, "fixed value")
            elif p.name in bounds or p.name in start:
                rebound = p.rebound(low=low, high=high)
                at = min(max(p.start, rebound.low), rebound.high) if p.name not in start else start[p.name]
                declared[p.name] = rebound.rebound(start=rebound.check(at, "start"))
        if len(fixed) == len(names):
            raise InputError("every parameter is fixed; leave one free at least")
        return fixed, declared


def _matched(what: str, pattern: str, names: Sequence[str]) -> list[str]:
    found = [name for name in names if fnmatchcase(name, pattern)]
    if not found:
        raise UnknownNameError(f"parameter of {what}", pattern, names)
    return found


def _by_name(what: str, given: Mapping[str, T], names: Sequence[str]) -> dict[str, T]:
    """Return what is given by pattern as given by name; two patterns may overlap where they say the same."""
    said: dict[str, tuple[str, T]] = {}
    for pattern, value in given.items():
        for name in _matched(what, pattern, names):
            other = said.setdefault(name, (pattern, value))
            if other[1] != value:
                raise InputError(
                    f"{what}: '{other[0]}' and '{pattern}' say different things of {name}; drop one of them"
                )
    return {name: value for name, (_, value) in said.items()}
