"""Gaussian priors of parameters: what keeps a learned curve smooth, and what is known beforehand."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mjfish.arrays import FloatArray


@dataclass(frozen=True, eq=False)
class Prior:
    """A Gaussian prior of parameters a: rows @ a ~ N(0, sd^2 I).

    Attributes:
        name: of the prior.
        parameters: full names of the parameters (k,).
        rows: (m, k).
        sd: at the start where it is learned, else for good.
        learned: whether its sd is found by marginal likelihood: a smoothness.
    """

    name: str
    parameters: tuple[str, ...]
    rows: FloatArray
    sd: float
    learned: bool = False


def smooth_curve(name: str, knots: Sequence[str], pinned: int, sd: float, slope: float) -> tuple[Prior, Prior]:
    """Return the priors of a curve given by its values at equally spaced knots, one of which is zero.

    Second differences have an sd that is learned, first differences one that is given.

    Args:
        name: of the curve.
        knots: full names of the values, without the pinned one.
        pinned: which of the knots that is.
        sd: of second differences, at the start.
        slope: sd of first differences.
    """
    count = len(knots) + 1
    kept = [k for k in range(count) if k != pinned]
    identity = np.eye(count)
    first, second = np.diff(identity, axis=0)[:, kept], np.diff(identity, n=2, axis=0)[:, kept]
    names = tuple(knots)
    return Prior(f"{name}.curvature", names, second, sd, learned=True), Prior(f"{name}.slope", names, first, slope)
