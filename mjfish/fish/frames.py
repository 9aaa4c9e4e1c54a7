"""The one place where the model's frame meets the frame that users see.

Inside the model, ``x_0`` runs from the nose to the TAIL ([Yu2016], Fig. 2), so forward swimming is
``V_0x < 0``. Everything a user sees is in the forward frame at the nose (REP-103): x forward, y to port, z up.
The two differ by half a turn about z: translations change sign, yaw, yaw rate and joint angles do not.
"""

from __future__ import annotations

import numpy as np

from mjfish.numerics.arrays import FloatArray

#: Channels of a measured or simulated velocity, in the order used by every array.
CHANNELS = ("surge", "sway", "yaw_rate")
#: Their units, as in the headers of data files.
UNITS = {"surge": "m/s", "sway": "m/s", "yaw_rate": "rad/s"}

_FLIP = np.array([-1.0, -1.0, 1.0])


def flip(planar: FloatArray) -> FloatArray:
    """Convert planar vectors between the model's frame and the forward frame (the map is its own inverse).

    Args:
        planar: (..., 3) velocities (u, v, w) [m/s, m/s, rad/s], poses (x, y, yaw) or wrenches (Fx, Fy, Mz).
    """
    return np.asarray(planar * _FLIP, dtype=np.float64)


def to_body(world: FloatArray, yaw: FloatArray) -> FloatArray:
    """Rotate world vectors (..., 2) into the body frame that is turned by `yaw` (...) [rad]."""
    cos, sin = np.cos(yaw), np.sin(yaw)
    return np.stack([cos * world[..., 0] + sin * world[..., 1], cos * world[..., 1] - sin * world[..., 0]], axis=-1)


def to_world(body: FloatArray, yaw: FloatArray) -> FloatArray:
    """Rotate body vectors (..., 2) into the world frame; inverse of `to_body`."""
    return to_body(body, -np.asarray(yaw))
