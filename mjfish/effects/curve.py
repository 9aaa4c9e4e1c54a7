"""A form as a curve: what depends on what, and what keeps a learned one smooth."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mjfish.arrays import FloatArray

#: u, v, w (n, links) of the links' origins in their frames, and the link's index, to the visited x and their weights.
Visits = Callable[[FloatArray, FloatArray, FloatArray], tuple[FloatArray, FloatArray]]


@dataclass(frozen=True)
class Quantity:
    """What stands at an axis.

    Attributes:
        name: of the quantity.
        unit: SI, ``-`` of a number.
    """

    name: str
    unit: str


@dataclass(frozen=True, eq=False)
class Curve:
    """A form as a function of one variable.

    Attributes:
        quantity: what the form gives, ``c_d`` say.
        group: of the links that have it.
        x, y: what stands at the axes.
        at: (n,) x at which it is drawn.
        value: returns y (n,) from the parameters of a model by full name.
        visits: returns values of x where runs have been, and their weights: how much they say of y; None where the
            variable is not of the links' velocities.
    """

    quantity: str
    group: str
    x: Quantity
    y: Quantity
    at: FloatArray
    value: Callable[[Mapping[str, float]], FloatArray]
    visits: Visits | None = None


@dataclass(frozen=True, eq=False)
class Penalty:
    """A Gaussian prior of parameters a: rows @ a ~ N(0, sd^2 I).

    Attributes:
        names: full names of the parameters (k,).
        rows: (m, k).
        sd: at the start where it is learned, else for good.
        learned: whether its sd is found by marginal likelihood: a smoothness.
    """

    names: tuple[str, ...]
    rows: FloatArray
    sd: float
    learned: bool


def smoothness(names: Sequence[str], pinned: int, sd: float, slope: float) -> tuple[Penalty, Penalty]:
    """Return the penalties of a curve given by its values at equally spaced knots, one of which is zero.

    Second differences have an sd that is learned, first differences one that is given.

    Args:
        names: of the values but the pinned one.
        pinned: which of the knots that is.
        sd: of second differences, at the start.
        slope: sd of first differences.
    """
    count = len(names) + 1
    kept = [k for k in range(count) if k != pinned]
    identity = np.eye(count)
    first, second = np.diff(identity, axis=0)[:, kept], np.diff(identity, n=2, axis=0)[:, kept]
    return Penalty(tuple(names), second, sd, True), Penalty(tuple(names), first, slope, False)
