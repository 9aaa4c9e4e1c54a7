"""What the camera reads of what happened: clock, axes, scale, marker, roll, moving water."""

from __future__ import annotations

import itertools
from collections.abc import Mapping

import numpy as np
from scipy.integrate import cumulative_simpson

from mjfish.numerics.arrays import FloatArray
from studies.battery.generator import rolling
from studies.battery.generator.plans import Run
from studies.battery.generator.world import Motion

#: The current grows by this share across its own direction, within a metre or so.
SHEAR = 0.1
#: A camera that tracks positions takes this many frames for each sample that is kept.
FINER = 4
#: Poses that are not differentiated are integrated at steps of this at most [s].
FINEST = 0.001
#: So long before a change of the drive is before it [s].
_BEFORE = 1e-8


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
    """Return the pose (finer (n - 1) + 1, 3) whose rate the camera reads: its readings, integrated by Simpson.

    Where the drive changes the rate jumps: it is integrated up to there, and on from there.
    """
    fine = np.linspace(time[0], time[-1], finer * (len(time) - 1) + 1)
    changes = np.array([nodes[0] for nodes, _ in motion.stretches]) - psi.get("time_offset.offset", 0.0)
    inside = changes[(changes > fine[0] + _BEFORE) & (changes < fine[-1] - _BEFORE)]
    found, now = np.empty((len(fine), 3)), np.array(run.start)
    for begin, end in itertools.pairwise([fine[0], *inside, fine[-1]]):
        here = (fine >= begin) & (fine <= end)
        nodes = np.unique([begin, *fine[here], end])
        read = velocity(motion, run, psi, np.minimum(nodes, end - _BEFORE))
        yaw = now[2] + cumulative_simpson(read[:, 2], x=nodes, initial=0.0)
        place = now[:2] + cumulative_simpson(_into_body(read[:, :2], -yaw), x=nodes, axis=0, initial=0.0)
        along = np.column_stack([place, yaw])
        found[here], now = along[np.searchsorted(nodes, fine[here])], along[-1]
    return found


def places(motion: Motion, run: Run, psi: Mapping[str, float], time: FloatArray) -> FloatArray:
    """Return the pose (n, 3) that an ideal camera reads at its times, evenly apart."""
    finer = int(np.ceil(float(time[1] - time[0]) / FINEST))
    found = pose(motion, run, {**psi, "roll.height": 0.0}, time, finer)[::finer]
    if height := psi.get("roll.height"):  # the marker leans, which its sway alone does not say in a turn
        angle = rolling.rolled(motion, psi).at(time + psi.get("time_offset.offset", 0.0))[:, 0]
        found[:, :2] += _into_body(np.outer(angle, [0.0, -height]), -found[:, 2])
    return found
