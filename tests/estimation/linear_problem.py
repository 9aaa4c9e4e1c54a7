"""A linear toy in place of the fish: measurements are rows times parameters, with noise of one."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from mjfish.effects import Effect
from mjfish.effects.effect import Values
from mjfish.effects.mechanism import Domain
from mjfish.estimation import Noise, Problem
from mjfish.fish import load_fish
from mjfish.model import Model
from mjfish.numerics.arrays import FloatArray, readonly
from mjfish.numerics.block_angular import BlockAngular
from mjfish.parameters import Parameter
from mjfish.parameters.prior import Prior


class Toy(Effect):
    """Parameters with priors, whatever they do."""

    name: ClassVar[str] = "toy"
    domain: ClassVar[Domain] = "data"
    summary: ClassVar[str] = "toy"
    parameters: ClassVar[tuple[Parameter, ...]] = (Parameter("toy.p0", "-", 0.0, -1.0, 1.0, 0.0, 0.1),)
    source: ClassVar[str] = "toy"
    signature: ClassVar[str] = "toy"
    confirm: ClassVar[str] = "toy"
    own: ClassVar[tuple[Prior, ...]] = ()

    def clock(self, time: FloatArray, values: Values) -> FloatArray:
        """Act, as every effect must."""
        return time + values["p0"]

    def priors(self) -> tuple[Prior, ...]:
        """Return what the toy was made with."""
        return self.own


@dataclass(frozen=True, eq=False)
class Linear(Problem):
    """Residual `data - design @ x`.

    Attributes:
        design: (n, p).
        data: (n,).
    """

    design: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))
    data: FloatArray = field(default_factory=lambda: np.zeros(0))

    def residual(self, x: FloatArray) -> FloatArray:
        """Return what is left."""
        return np.asarray(self.data - self.design @ x)

    def jacobian(self, x: FloatArray) -> BlockAngular:
        """Return the design."""
        del x
        return BlockAngular.of(self.design)


def names(count: int) -> tuple[str, ...]:
    """Return the names of the parameters of a toy."""
    return tuple(f"toy.p{k}" for k in range(count))


@functools.cache
def _nothing_else() -> dict[str, float]:
    """Return the coefficients of the fish, which are not free here."""
    return dict(load_fish("pike").values)


def linear(design: FloatArray, data: FloatArray, priors: Sequence[Prior], bound: float = 1e3) -> Linear:
    """Return the problem of `data` with these priors of its parameters `names(p)`."""
    declared = tuple(Parameter(name, "-", 0.0, -bound, bound, 0.0, 1.0) for name in names(design.shape[1]))
    effect = type("Toy", (Toy,), {"parameters": declared, "own": tuple(priors)})()
    noise = Noise.white(readonly(np.ones(3)))
    return Linear(Model(load_fish("pike"), (effect,)), (), noise, _nothing_else(), design=design, data=data)
