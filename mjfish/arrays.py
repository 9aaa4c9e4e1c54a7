"""Array types and the one way an array becomes read-only."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
RecordArray = NDArray[Any]


#: Standard deviation of normal errors over the median of their absolute values.
_MEDIAN = 1.4826


def robust_sigma(errors: FloatArray) -> FloatArray:
    """Return the standard deviation (...) of errors (n, ...) about zero by 1.4826 median |e|, whatever a few are."""
    return np.asarray(_MEDIAN * np.median(np.abs(errors), axis=0))


def readonly(values: ArrayLike) -> FloatArray:
    """Return a contiguous float64 copy that cannot be written to."""
    array = np.array(values, dtype=np.float64, order="C")
    array.flags.writeable = False
    return array
