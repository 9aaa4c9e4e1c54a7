"""Points that are not what they are called: exchanged with a neighbour, or not where they belong at all."""

from __future__ import annotations

from itertools import combinations

import numpy as np
from scipy.ndimage import median_filter

from mjfish.arrays import BoolArray, FloatArray
from mjfish.data.importers.smooth.batch import Fit

#: A point is off where it is this many sigma from where it belongs.
_OFF = 4.0
#: Frames of the running median.
_MEDIAN_FRAMES = 9


def steadied(measured: FloatArray) -> FloatArray:
    """Return points (n, points, 2) without jumps and gaps, to start a fit from."""
    filled = measured.copy()
    frames = np.arange(len(measured))
    for point in range(measured.shape[1]):
        good = np.isfinite(measured[:, point]).all(axis=1)
        for axis in range(2):
            if good.any():
                filled[:, point, axis] = np.interp(frames, frames[good], measured[good, point, axis])
    return np.asarray(median_filter(filled, size=(_MEDIAN_FRAMES, 1, 1), mode="nearest"))


def exchanged(measured: FloatArray, fit: Fit) -> tuple[FloatArray, BoolArray]:
    """Put points back that were exchanged with another one.

    Where two points are off and each lies where the other belongs, they were exchanged.

    Args:
        measured: (n, points, 2).
        fit: of them.

    Returns:
        The points with exchanges undone, and in which frames (n,) there was one.
    """
    belongs = measured - fit.residual
    reach = _OFF * np.maximum(fit.sigma, np.median(fit.sigma))
    off = ~fit.kept & np.isfinite(measured).all(axis=2)
    mended, found = measured.copy(), np.zeros(len(measured), dtype=np.bool_)
    for a, b in combinations(range(measured.shape[1]), 2):
        crossed = off[:, a] & off[:, b]
        crossed &= np.hypot(*(measured[:, a] - belongs[:, b]).T) < reach[b]
        crossed &= np.hypot(*(measured[:, b] - belongs[:, a]).T) < reach[a]
        mended[crossed, a], mended[crossed, b] = measured[crossed, b], measured[crossed, a]
        found |= crossed
    return mended, found
