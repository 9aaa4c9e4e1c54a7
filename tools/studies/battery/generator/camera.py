"""What the camera reads of what happened: clock, axes, scale, marker, roll, moving water."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.integrate import cumulative_simpson

from mjfish.arrays import FloatArray
from studies.battery.generator import rolling
from studies.battery.generator.plans import Run
from studies.battery.generator.world import Motion

#: The current grows by this share across its own direction, within a metre or so.
SHEAR = 0.1
#: A camera that tracks positions takes this many frames for each sample that is kept.
FINER = 4
#: Poses that are not differentiated are integrated at steps of this at most [s].
FINEST = 0.0025


def velocity(motion: Motion, run: Run, psi: Mapping[str, float], time: FloatArray) -> FloatArray:
    """Return surge, sway, yaw rate (n, 3) that an ideal camera reads at its times `time`."""
    seen = motion.at(time + psi.get("time_offset.offset", 0.0))
    read = seen[:, :3].copy()
    current = np.array([psi.get("ambient_current.x", 0.0), psi.get("ambient_current.y", 0.0)])
    if np.any(current):
        read[:, :2] += _into_body(_sheared(current, seen[:, 3:5]), seen[:, 5])
    if psi.get("roll.height"):
        rate = rolling.rolled(motion, psi).at(time + psi.get("time_offset.offset", 0.0))[:, 1]
        read[:, 1] -= psi["roll.height"] * rate
    turn, along = read[:, 2].copy(), psi.get("marker_offset.along", 0.0)
    read[:, 0] -= psi.get("marker_offset.across", 0.0) * turn
    read[:, 1] += along * turn
    if psi.get("frame_misalignment.angle"):
        read[:, :2] = _into_body(read[:, :2], np.full(len(read), psi["frame_misalignment.angle"]))
    read[:, :2] *= 1.0 + psi.get("velocity_scale.error", 0.0)
    return read


def _sheared(current: FloatArray, place: FloatArray) -> FloatArray:
    """Return the current (n, 2) at places in the tank: faster on one side of its direction."""
    across = np.array([-current[1], current[0]]) / np.hypot(*current)
    return np.asarray(current * (1.0 + SHEAR * np.tanh(place @ across))[:, None])


def _into_body(world: FloatArray, yaw: FloatArray) -> FloatArray:
    c, s = np.cos(yaw), np.sin(yaw)
    return np.stack([c * world[:, 0] + s * world[:, 1], c * world[:, 1] - s * world[:, 0]], axis=1)


def pose(motion: Motion, run: Run, psi: Mapping[str, float], time: FloatArray, finer: int = FINER) -> FloatArray:
    """Return the pose (finer (n - 1) + 1, 3) whose rate the camera reads: its readings, integrated by Simpson."""
    fine = np.linspace(time[0], time[-1], finer * (len(time) - 1) + 1)
    read = velocity(motion, run, psi, fine)
    yaw = run.start[2] + cumulative_simpson(read[:, 2], x=fine, initial=0.0)
    world = _into_body(read[:, :2], -yaw)
    place = cumulative_simpson(world, x=fine, axis=0, initial=0.0) + np.array(run.start[:2])
    return np.asarray(np.column_stack([place, yaw]))


def places(motion: Motion, run: Run, psi: Mapping[str, float], time: FloatArray) -> FloatArray:
    """Return the pose (n, 3) that an ideal camera reads at its times, evenly apart."""
    finer = int(np.ceil(float(time[1] - time[0]) / FINEST))
    return pose(motion, run, psi, time, finer)[::finer]
