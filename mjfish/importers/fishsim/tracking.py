"""Which markers are lost in which frames: tracking by bounding box loses markers, swaps them, or lets them jump."""

from __future__ import annotations

from itertools import combinations

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.ndimage import median_filter

from mjfish.arrays import BoolArray, FloatArray
from mjfish.importers.fishsim.markers import HEAD, STATIONS, TAIL

#: A marker is lost where it is this far from its running median [m]; it moves less than 10 mm a frame.
_JUMP = 0.012
_MEDIAN_FRAMES = 9
#: Largest relative change of a distance on the rigid head; parallax and a tilted camera make 5 %.
_HEAD_TOLERANCE = 0.12
#: Farthest that marker 1 leaves its place across the line from 0 to 2 [m]; parallax makes 7 mm.
_HEAD_ACROSS = 0.012
#: Largest relative change of a distance between tail markers; bending and parallax make 30 %, a lost marker 45 %.
_TAIL_TOLERANCE = 0.4
#: Sharpest turn at a tail marker [rad]; the robot bends by 0.7.
_TAIL_TURN = 1.0
#: Longest gap that is filled [frames]: a tenth of a second.
SHORT = 6


def lost(position: FloatArray) -> BoolArray:
    """Find lost markers by jumps, and by distances and turns that the robot cannot have.

    Args:
        position: (n, 9, 2) as tracked [m].

    Returns:
        (n, 9), true where a marker is not where it belongs.
    """
    running = median_filter(position, size=(_MEDIAN_FRAMES, 1, 1), mode="nearest")
    astray = np.hypot(*np.moveaxis(position - running, -1, 0)) > _JUMP
    found: BoolArray = np.array(astray, dtype=bool)
    found[:, list(HEAD)] |= _lost_on_head(position[:, list(HEAD)])
    found[:, list(TAIL)] |= _lost_on_tail(position[:, list(TAIL)], astray[:, list(TAIL)])
    return found


def _lost_on_head(position: FloatArray) -> BoolArray:
    """Blame the marker whose distances to both others are wrong; where that names nobody, blame all three."""
    accused = np.zeros(position.shape[:2], dtype=np.int64)
    for pair in combinations(range(len(HEAD)), 2):
        apart = np.hypot(*(position[:, pair[0]] - position[:, pair[1]]).T)
        wrong = np.abs(apart / np.median(apart) - 1.0) > _HEAD_TOLERANCE
        accused[:, pair] += wrong[:, None]
    twice = accused == 2
    line, middle = position[:, 2] - position[:, 0], position[:, 1] - position[:, 0]
    across = (line[:, 0] * middle[:, 1] - line[:, 1] * middle[:, 0]) / np.maximum(np.hypot(*line.T), 1e-9)
    broken = accused.any(axis=1) | (np.abs(across - np.median(across)) > _HEAD_ACROSS)
    return np.asarray(twice | (broken & ~twice.any(axis=1))[:, None])


def _lost_on_tail(position: FloatArray, astray: BoolArray) -> BoolArray:
    """Find the fewest markers without which every distance along the tail is one that it can have."""
    fin = float(np.median(np.hypot(*(position[:, -1] - position[:, -2]).T)))
    # The marker of the fin sits elsewhere from run to run: its distance is taken from the file.
    station = np.append(STATIONS[list(TAIL[:-1])], STATIONS[TAIL[-2]] + fin)
    found = np.zeros_like(astray)
    for frame in np.flatnonzero(astray.any(axis=1) | (_misfit(position, station) > 1.0)):
        found[frame] = _fewest(position[frame], station, astray[frame])
    return found


def _fewest(position: FloatArray, station: FloatArray, astray: BoolArray) -> BoolArray:
    """Search the smallest set of markers to leave out in one frame; all of them where two do not suffice."""
    for size in range(3):
        choices = []
        for left_out in combinations(range(len(TAIL)), size):
            keep = ~astray
            keep[list(left_out)] = False
            if keep.sum() >= 3:
                choices.append((float(_misfit(position[None, keep], station[keep])[0]), keep))
        if choices:
            misfit, keep = min(choices, key=lambda choice: choice[0])
            if misfit < 1.0:
                return ~keep
    return np.ones(len(TAIL), dtype=bool)


def _misfit(position: FloatArray, station: FloatArray) -> FloatArray:
    """Return the worst of the distances and turns along the tail (n,); 1 is what the robot can just have."""
    step = np.diff(position, axis=1)
    distance = np.abs(np.hypot(step[..., 0], step[..., 1]) / np.diff(station) - 1.0)
    before, after = step[:, :-1], step[:, 1:]
    sine = before[..., 0] * after[..., 1] - before[..., 1] * after[..., 0]
    turn = np.abs(np.arctan2(sine, (before * after).sum(axis=-1)))
    return np.asarray(np.maximum(distance.max(axis=1) / _TAIL_TOLERANCE, turn.max(axis=1) / _TAIL_TURN))


def runs(flags: BoolArray) -> list[tuple[int, int]]:
    """Return the stretches [start, end) in which `flags` (n,) is true."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def fill(position: FloatArray, gone: BoolArray) -> tuple[FloatArray, BoolArray]:
    """Fill gaps of up to `SHORT` frames by a cubic spline through the frames around.

    Args:
        position: (n, 9, 2) [m].
        gone: (n, 9) from `lost`.

    Returns:
        Positions with short gaps filled, and what is still lost (n, 9).
    """
    filled, still = position.copy(), gone.copy()
    for marker in range(position.shape[1]):
        good = np.flatnonzero(~gone[:, marker])
        gaps = [(a, b) for a, b in runs(gone[:, marker]) if b - a <= SHORT and a > 0 and b < len(gone)]
        if not gaps:
            continue
        spline = CubicSpline(good, position[good, marker])
        for a, b in gaps:
            filled[a:b, marker] = spline(np.arange(a, b))
            still[a:b, marker] = False
    return filled, still
