"""Attitude of a body from its quaternion: yaw about z, then pitch about y, then roll about x (REP-103).

With x forward, y to port and z up, roll is positive with the port side up, pitch with the nose down, yaw to port. They
are not defined where the nose points straight up or down.
"""

from __future__ import annotations

import numpy as np

from mjfish.arrays import FloatArray


def euler_angles(quaternion: FloatArray) -> FloatArray:
    """Return roll, pitch and yaw (n, 3) [rad] of quaternions w, x, y, z (n, 4) in time; yaw does not jump by a turn."""
    w, x, y, z = quaternion.T
    roll = np.arctan2(2.0 * (w * x + y * z), w * w - x * x - y * y + z * z)
    pitch = np.arcsin(np.clip(2.0 * (w * y - z * x) / (quaternion**2).sum(axis=1), -1.0, 1.0))
    yaw = np.arctan2(2.0 * (w * z + x * y), w * w + x * x - y * y - z * z)
    return np.column_stack([roll, pitch, np.unwrap(yaw)])


def yaw_rate(angles: FloatArray, rate: FloatArray) -> FloatArray:
    """Return yaw' = (q sin roll + r cos roll) / cos pitch (n,) [rad/s].

    Args:
        angles: (n, 3) roll, pitch, yaw [rad].
        rate: (n, 3) angular velocity p, q, r in the body's frame [rad/s].
    """
    roll, pitch, _ = angles.T
    return np.asarray((rate[:, 1] * np.sin(roll) + rate[:, 2] * np.cos(roll)) / np.cos(pitch))
