"""The log of one simulated run, of whichever engine."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.interpolate import make_interp_spline

from mjfish.arrays import FloatArray
from mjfish.drive.motion import JointMotion
from mjfish.fish import Fish
from mjfish.ode.forces import link_forces
from mjfish.reporting.log.recording import write_log
from mjfish.reporting.log.scene import Run, Swim


def write_rollout_log(
    path: Path,
    fish: Fish,
    time: FloatArray,
    velocity: FloatArray,
    pose: FloatArray,
    joint_angle: FloatArray,
    *,
    attitude: FloatArray | None = None,
    name: str = "run",
) -> None:
    """Write a simulated run to an .rrd file, with the forces on its links.

    The forces follow from velocity and joint motion by the equation of motion; rates and accelerations of the joints
    are those of the quintic spline through their angles, so the samples must be dense (100 a second will do).

    Args:
        path: of the file.
        fish: with the coefficients of the run.
        time: (n,) increasing [s], at least 6 samples; with fewer no forces are shown.
        velocity: (n, 3) surge, sway [m/s], yaw rate [rad/s].
        pose: (n, 3) x, y [m], yaw [rad].
        joint_angle: (n, joints) [rad].
        attitude: (n, 3) roll, pitch [rad] and heave [m] of a fish that is free in space; no forces are shown then.
        name: of the run in the log.
    """
    forces = None
    if len(time) > _DEGREE and attitude is None:
        forces = link_forces(fish, _interpolated(time, joint_angle), np.column_stack([velocity, pose]))
    swim = Swim("simulated", time, velocity, pose, joint_angle, forces, attitude)
    about = f"**{fish.name}**, {name}: mean surge {velocity[:, 0].mean():.3f} m/s over {time[-1] - time[0]:.1f} s."
    write_log(path, [Run(name, fish, (swim,))], about=about)


_DEGREE = 5


def _interpolated(time: FloatArray, angle: FloatArray) -> JointMotion:
    """Return the joint motion through `angle` (n, joints), with a step from each sample to the next."""
    spline = make_interp_spline(time, angle, k=_DEGREE)
    stages = np.stack([time[:-1], 0.5 * (time[:-1] + time[1:]), time[1:]], axis=1)
    return JointMotion(time, *(spline(stages, nu=order) for order in range(3)))
