"""What is observed of the coordinates, frame by frame."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from mjfish.arrays import FloatArray

IntArray = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Linearised:
    """Predicted points and their derivatives.

    Attributes:
        value: (n, points, d).
        own: (n, points, d, coordinates) by the coordinates of the frame.
        shared: (n, points, d, shared) by what all frames share.
    """

    value: FloatArray
    own: FloatArray
    shared: FloatArray


class Observation(Protocol):
    """Points that are seen in every frame, as a function of the frame's coordinates and of what all frames share."""

    @property
    def measured(self) -> FloatArray:
        """(n, points, d); what was not seen is NaN."""
        ...

    @property
    def coordinates(self) -> int:
        """Number of coordinates a frame."""
        ...

    @property
    def kinds(self) -> IntArray:
        """(coordinates,) numbers; coordinates of a number are equally smooth."""
        ...

    @property
    def belief(self) -> FloatArray:
        """(shared,) standard deviations about zero that are believed of what all frames share."""
        ...

    @property
    def form(self) -> FloatArray:
        """(coordinates, coordinates) precision believed of the coordinates, about zero, once for every look."""
        ...

    def at(self, coordinates: FloatArray, shared: FloatArray) -> Linearised:
        """Return the points for coordinates (n, coordinates) and shared (shared,)."""
        ...


@dataclass(frozen=True, eq=False)
class Itself:
    """The coordinates themselves are measured, each a point of its own.

    Attributes:
        measured: (n, coordinates, 1).
    """

    measured: FloatArray

    @property
    def coordinates(self) -> int:
        """Number of coordinates a frame."""
        return int(self.measured.shape[1])

    @property
    def kinds(self) -> IntArray:
        """The first two are x and y, then yaw, then joint angles."""
        return np.minimum(np.maximum(np.arange(self.coordinates) - 1, 0), 2)

    @property
    def belief(self) -> FloatArray:
        """Nothing is shared."""
        return np.zeros(0)

    @property
    def form(self) -> FloatArray:
        """Nothing is believed of the coordinates."""
        return np.zeros((self.coordinates, self.coordinates))

    def at(self, coordinates: FloatArray, shared: FloatArray) -> Linearised:
        """Return the coordinates."""
        n, k = coordinates.shape
        own = np.broadcast_to(np.eye(k)[:, None, :], (n, k, 1, k))
        return Linearised(coordinates[:, :, None], own, np.zeros((n, k, 1, len(shared))))
