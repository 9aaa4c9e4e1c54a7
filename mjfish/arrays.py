"""Array types and the one way an array becomes read-only."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
RecordArray = NDArray[Any]


def readonly(values: ArrayLike) -> FloatArray:
    """Return a contiguous float64 copy that cannot be written to."""
    array = np.array(values, dtype=np.float64, order="C")
    array.flags.writeable = False
    return array
