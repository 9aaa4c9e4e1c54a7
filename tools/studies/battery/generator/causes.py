"""A cause: a direction in its parameters; its size s multiplies it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

Draw = Callable[[np.random.Generator], dict[str, float]]


@dataclass(frozen=True)
class Cause:
    """One cause.

    Attributes:
        name: of the cause.
        draw: direction in the parameters at a size that is well seen; also shapes, which size does not scale.
        low, high: of the size, a factor on the direction; some causes are well seen however small.
        exact: whether the solver's form of the cause is the generator's.
        listed: whether the solver knows it.
        shapes: parameters that the size does not scale.
        needs_pose: whether it shows only where the pose is recorded.
        series: those shapes that are numbers of a free function.
        twins: of a form that is not listed, the names that the solver has for the same law.
    """

    name: str
    draw: Draw
    low: float
    high: float
    exact: bool = True
    listed: bool = True
    shapes: tuple[str, ...] = ()
    needs_pose: bool = False
    series: tuple[str, ...] = ()
    twins: tuple[str, ...] = ()

    def sized(self, direction: Mapping[str, float], size: float) -> dict[str, float]:
        """Return the parameters at a size."""
        return {key: value if key in self.shapes else size * value for key, value in direction.items()}
