"""Which frames to keep: those at which motion is known nearly as well as in the middle of the run.

In a gap the smooth part of a motion is soon unknown and its periodic part is not, so that this rule bridges gaps of
periodic motion, with the uncertainty that the fit states, and cuts all others; it trims the ends too.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mjfish.arrays import BoolArray, FloatArray

#: Sigma may be so many times its median.
_KNOWN = 2.0
#: Joint angles known better than this are good enough, whatever the median [rad].
_ANGLE = 0.02


def known(velocity: FloatArray, angle: FloatArray, seen: BoolArray) -> BoolArray:
    """Return the frames (n,) to keep.

    Args:
        velocity: (n, 3) sigma of the velocities.
        angle: (n, joints) sigma of the joint angles [rad]; no columns where there are none.
        seen: (n,) frames in which the points were seen; the medians are theirs.
    """
    seen = seen if seen.any() else np.ones_like(seen)
    keep = (velocity <= _KNOWN * np.median(velocity[seen], axis=0)).all(axis=1)
    if angle.shape[1]:
        keep &= (angle <= np.maximum(_KNOWN * np.median(angle[seen], axis=0), _ANGLE)).all(axis=1)
    return np.asarray(keep)


def runs(flags: BoolArray) -> list[tuple[int, int]]:
    """Return the stretches [start, end) in which `flags` (n,) is true."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def longest(candidates: Sequence[tuple[int, int]]) -> int:
    """Return the length of the longest stretch, 0 without any."""
    return max((b - a for a, b in candidates), default=0)
