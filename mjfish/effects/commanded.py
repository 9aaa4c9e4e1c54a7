"""What the causes of family ``drive`` have in common: they stand between the command and the joints."""

from __future__ import annotations

import numpy as np

from mjfish.arrays import FloatArray
from mjfish.compiled import inlined
from mjfish.data import Dataset
from mjfish.drive.motion import JointMotion


def undetectable_behind_measured_joints(dataset: Dataset) -> str:
    """Say why no servo can be detected, where every trial has measured joint angles."""
    if all(trial.joint_angle is not None for trial in dataset.trials):
        return "the joint angles were measured, so no servo stands between them and the model"
    return ""


def balanced(time: FloatArray, angle: FloatArray, rate: FloatArray, acceleration: FloatArray) -> JointMotion:
    """Return a joint motion whose rates and accelerations in mid-step carry what happens between the nodes.

    A joint that meets a flank or a limit changes its rate within a few milliseconds, at any time within a step. By
    Simpson's rule, which a Runge-Kutta step of a known input is, the integral of the acceleration must be the change of
    rate, and that of the rate the change of angle; else the head gets a wrong impulse. Solved for the values in the
    middle: f_1 = (6 INT f dt / h - f_0 - f_2) / 4.

    Args:
        time: (n + 1,) boundaries of the steps [s].
        angle, rate, acceleration: (n, 3, joints); those in mid-step of rate and acceleration are replaced.
    """
    steps = np.diff(time)[:, None]
    rate, acceleration = rate.copy(), acceleration.copy()
    acceleration[:, 1] = 1.5 * (rate[:, 2] - rate[:, 0]) / steps - 0.25 * (acceleration[:, 0] + acceleration[:, 2])
    rate[:, 1] = 1.5 * (angle[:, 2] - angle[:, 0]) / steps - 0.25 * (rate[:, 0] + rate[:, 2])
    return JointMotion(time=time, angle=angle, rate=rate, acceleration=acceleration)


@inlined
def cubic(left: float, slope: float, right: float, slope_right: float, d: float) -> tuple[float, float]:
    """Return a_2, a_3 of the cubic left + slope s + a_2 s^2 + a_3 s^3 through values and slopes at 0 and d."""
    rise = (right - left - slope * d) / (d * d)
    bend = (slope_right - slope) / d
    return 3.0 * rise - bend, (bend - 2.0 * rise) / d
