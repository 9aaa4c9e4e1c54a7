"""What keeps the swimming in view: a point that glides along with the fish, and a floor that shows how far it swims."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import gaussian_filter1d

from mjfish.arrays import FloatArray
from mjfish.fish import Fish
from mjfish.reporting.log.body import link_poses
from mjfish.reporting.log.scene import Run, Swim

#: The camera's point ignores what is faster than this [s], so that it does not wag with the fish.
_SMOOTHING = 0.3
#: Spacing of the floor's lines, its depth and its margin, in lengths of the fish.
_SPACING, _DEPTH, _MARGIN = 0.5, 0.25, 3.0


def camera_path(swim: Swim, fish: Fish) -> FloatArray:
    """Return the point that the camera looks at (n, 3) [m]: the middle of the body, its wagging smoothed away."""
    middle = swim.nose
    if swim.joint_angle is not None:
        middle = link_poses(fish, swim.pose, swim.joint_angle, swim.attitude)[0].mean(axis=1)
    if len(swim.time) < 2:
        return middle
    step = float(np.median(np.diff(swim.time)))
    return np.asarray(gaussian_filter1d(middle, _SMOOTHING / step, axis=0, mode="nearest"))


def floor_lines(run: Run) -> list[FloatArray]:
    """Return the lines of a square grid below everything that swims in the run, each (2, 3) [m]."""
    length = run.fish.length
    spacing = _SPACING * length
    places = np.concatenate([swim.pose[:, :2] for swim in run.swims])
    low = np.floor((places.min(axis=0) - _MARGIN * length) / spacing)
    high = np.ceil((places.max(axis=0) + _MARGIN * length) / spacing)
    z = min(float(swim.nose[:, 2].min()) for swim in run.swims) - _DEPTH * length
    (x0, y0), (x1, y1) = spacing * low, spacing * high
    along = [np.array([[x0, y, z], [x1, y, z]]) for y in spacing * np.arange(low[1], high[1] + 1)]
    across = [np.array([[x, y0, z], [x, y1, z]]) for x in spacing * np.arange(low[0], high[0] + 1)]
    return along + across
