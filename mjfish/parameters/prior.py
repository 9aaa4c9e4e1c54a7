"""Gaussian priors of parameters: what keeps a learned curve smooth, and what is known beforehand."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mjfish.numerics.arrays import FloatArray

#: Sd of the mean of a curve: of a logarithm, a factor of e.
_LEVEL = 1.0


@dataclass(frozen=True, eq=False)
class Prior:
    """A Gaussian prior of parameters a: rows @ a ~ N(mean, sd^2 I).

    Attributes:
        name: of the prior.
        parameters: full names of the parameters (k,).
        rows: (m, k).
        sd: at the start where it is learned, else for good.
        learned: whether its sd is found by marginal likelihood: a smoothness.
        mean: of every row.
    """

    name: str
    parameters: tuple[str, ...]
    rows: FloatArray
    sd: float
    learned: bool = False
    mean: float = 0.0


def about(name: str, parameters: Sequence[str], mean: float, sd: float) -> Prior:
    """Return the prior of independent parameters, by full names, that all have this mean and sd."""
    return Prior(name, tuple(parameters), np.eye(len(parameters)), sd, mean=mean)


def smooth_curve(name: str, knots: Sequence[str], sd: float, slope: float) -> tuple[Prior, ...]:
    """Return the priors of a curve about zero, given by numbers at equally spaced knots.

    Second differences have an sd that is learned, first differences and the mean have one that is given.

    Args:
        name: of the curve.
        knots: full names of the values.
        sd: of second differences, at the start.
        slope: sd of first differences.
    """
    count, names = len(knots), tuple(knots)
    identity = np.eye(count)
    return (
        Prior(f"{name}.curvature", names, np.diff(identity, n=2, axis=0), sd, learned=True),
        Prior(f"{name}.slope", names, np.diff(identity, axis=0), slope),
        Prior(f"{name}.level", names, np.full((1, count), 1.0 / count), _LEVEL),
    )
