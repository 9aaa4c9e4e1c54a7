"""Headless runs of the MuJoCo fish: commanded joint angles in; realised joints, velocity and pose of the nose out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import mujoco
import numpy as np

from mjfish.drive.motion import JointMotion
from mjfish.errors import InputError
from mjfish.fish import Fish, frames
from mjfish.hydro.load import Load
from mjfish.mujoco.coupling_choice import Coupling
from mjfish.mujoco.fluid import StripFluid
from mjfish.mujoco.mjcf import ROOT, Integrator, Trim, swimmer
from mjfish.numerics.arrays import FloatArray, readonly

#: A run has diverged once a velocity passes this [m/s or rad/s]: no fish does.
DIVERGED = 1e3

#: The second half of MuJoCo's step, by integrator.
_ADVANCE = {
    mujoco.mjtIntegrator.mjINT_EULER: mujoco.mj_Euler,
    mujoco.mjtIntegrator.mjINT_RK4: lambda model, data: mujoco.mj_RungeKutta(model, data, 4),
    mujoco.mjtIntegrator.mjINT_IMPLICIT: mujoco.mj_implicit,
    mujoco.mjtIntegrator.mjINT_IMPLICITFAST: mujoco.mj_implicit,
    mujoco.mjtIntegrator.mjINT_DISCRETE: mujoco.mj_step,  # does the first half once more
}


@dataclass(frozen=True, eq=False)
class SimRollout:
    """A run in MuJoCo, at the boundaries of its steps; n samples.

    Attributes:
        command: joint motion that the servos were asked for; they see its angles only.
        time: (n,) [s].
        velocity: (n, 3) surge, sway [m/s], yaw rate [rad/s] of the nose in the forward frame.
        pose: (n, 3) x, y [m], yaw [rad] of the nose in the world.
        attitude: (n, 3) roll, pitch [rad] of the head and heave [m] of the nose, see `euler_angles`; zero
            in the plane. `velocity` is that of the horizontal pose also of a fish that rolls: what a camera above sees.
        joint_angle: (n, joints) realised [rad]; the deflection of a flexible tail comes on top.
        joint_rate: (n, joints) [rad/s].
        joint_acceleration: (n, joints) [rad/s2].
        status: ``ok`` or ``diverged``.
        message: when and with which parameters it diverged, else empty.
    """

    command: JointMotion
    time: FloatArray
    velocity: FloatArray
    pose: FloatArray
    attitude: FloatArray
    joint_angle: FloatArray
    joint_rate: FloatArray
    joint_acceleration: FloatArray
    status: Literal["ok", "diverged"]
    message: str

    def __post_init__(self) -> None:
        """Make the arrays read-only."""
        for name in ("time", "velocity", "pose", "attitude", "joint_angle", "joint_rate", "joint_acceleration"):
            object.__setattr__(self, name, readonly(getattr(self, name)))

    def motion(self) -> JointMotion:
        """Return the realised joint motion on the half-step grid.

        Middles come from the quintic polynomial through angle, rate and acceleration at both ends of a step: right to
        sixth order in the angle, fourth in the acceleration.
        """
        h = np.diff(self.time)[:, None]
        q0, q1 = self.joint_angle[:-1], self.joint_angle[1:]
        v0, v1 = self.joint_rate[:-1], self.joint_rate[1:]
        a0, a1 = self.joint_acceleration[:-1], self.joint_acceleration[1:]
        angle = 0.5 * (q0 + q1) + 5.0 / 32.0 * h * (v0 - v1) + h**2 / 64.0 * (a0 + a1)
        rate = 15.0 / 8.0 * (q1 - q0) / h - 7.0 / 16.0 * (v0 + v1) + h / 32.0 * (a1 - a0)
        acceleration = 1.5 * (v1 - v0) / h - 0.25 * (a0 + a1)
        return JointMotion(
            time=self.time,
            angle=np.stack([q0, angle, q1], axis=1),
            rate=np.stack([v0, rate, v1], axis=1),
            acceleration=np.stack([a0, acceleration, a1], axis=1),
        )


def simulate(
    fish: Fish,
    command: JointMotion,
    *,
    values: Mapping[str, float] | None = None,
    velocity: FloatArray | None = None,
    integrator: Integrator = "RK4",
    coupling: Coupling | None = None,
    free: Trim | None = None,
    loads: Sequence[tuple[Load, Sequence[float]]] = (),
) -> SimRollout:
    """Run the fish in MuJoCo, its servos following `command`, from rest or from `velocity`.

    The command is read at the start, middle and end of each step, where RK4 asks for it: it is continuous in time, and
    the run converges at the order of the integrator. Its grid gives the steps. The joints start where they are asked
    to be, and still.

    Args:
        fish: the fish.
        command: asked joint motion on the half-step grid.
        values: coefficients by name that replace the fish's.
        velocity: (3,) surge, sway [m/s], yaw rate [rad/s] at the start; None: at rest.
        integrator: of MuJoCo.
        coupling: of the water, see `mjfish.mujoco.coupling`; None: the one that is right.
        free: None: in the plane; else free to roll, pitch and heave, trimmed like that; it starts level.
        loads: extra forces on every link, with their parameters.

    Returns:
        The run; one that diverges has ``status == "diverged"`` and ends there.
    """
    if command.joints != fish.joints:
        raise InputError(
            f"the command has {command.joints} joints, {fish.name} has {fish.joints}; give an angle a joint"
        )
    if not np.all(np.isfinite(command.angle)):
        raise InputError("the command has angles that are no finite numbers; check the drive")
    fluid = swimmer(fish, values=values, free=free, integrator=integrator, coupling=coupling, loads=loads)
    data = mujoco.MjData(fluid.model)
    driven = fish.joints + (fish.tail_compliance > 0.0)  # the joints, and what may bend behind the last
    angles, rates = (slice(size - driven, size - driven + fish.joints) for size in (fluid.model.nq, fluid.model.nv))
    data.qpos[angles] = command.angle[0, 0]
    if velocity is not None:
        data.qvel[[0, 1, 2 if free is None else 5]] = velocity
    position, speed, acceleration = _steps(fluid, data, command)
    kept = len(speed)
    message = ""
    if kept < len(command.time) or not _swims(speed[-1]):
        named = ", ".join(f"{name} = {value:g}" for name, value in {**fish.values, **(values or {})}.items())
        message = (
            f"diverged at {command.time[kept - 1]:.3f} s with {named}; take a shorter step, softer servos, "
            "or check the coefficients and the drive"
        )
    root, pose, attitude = _root(position[:, : angles.start], speed[:, : rates.start])
    return SimRollout(
        command=command,
        time=command.time[:kept],
        velocity=root,
        pose=pose,
        attitude=attitude,
        joint_angle=position[:, angles],
        joint_rate=speed[:, rates],
        joint_acceleration=acceleration[:, rates],
        status="diverged" if message else "ok",
        message=message,
    )


def _root(position: FloatArray, speed: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return velocity, pose and attitude (n, 3) from position and speed of the root, planar or free."""
    attitude = np.zeros((len(speed), 3))
    yaw, yaw_speed = position[:, 2], speed[:, 2]
    if speed.shape[1] > ROOT:
        angles = euler_angles(position[:, 3:7])
        attitude[:, :2], attitude[:, 2] = angles[:, :2], position[:, 2]
        yaw, yaw_speed = angles[:, 2], yaw_rate(angles, speed[:, 3:6])
    velocity = np.column_stack([frames.to_body(speed[:, :2], yaw), yaw_speed])
    return velocity, np.column_stack([position[:, :2], yaw]), attitude


def _steps(fluid: StripFluid, data: mujoco.MjData, command: JointMotion) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return qpos (n, nq), qvel and qacc (n, nv) at the boundaries of the steps, until the first that has diverged."""
    model = fluid.model
    widths = np.diff(command.time)
    asked = command.angle.reshape(len(widths), -1)
    history = tuple(np.empty((len(widths) + 1, size)) for size in (model.nq, model.nv, model.nv))
    advance = _ADVANCE[mujoco.mjtIntegrator(model.opt.integrator)]
    with fluid.installed():
        for step in range(len(widths) + 1):
            if step < len(widths):
                model.opt.timestep = widths[step]
                data.userdata[0] = data.time
                data.userdata[1:] = asked[step]
            # The two halves of mj_step: between them, the accelerations are those at the start of the step.
            mujoco.mj_forward(model, data)
            for rows, now in zip(history, (data.qpos, data.qvel, data.qacc), strict=True):
                rows[step] = now
            if step == len(widths) or not _swims(data.qvel):
                break
            advance(model, data)
    position, speed, acceleration = (rows[: step + 1] for rows in history)
    return position, speed, acceleration


def _swims(speed: FloatArray) -> bool:
    return bool(np.abs(speed).max() < DIVERGED)  # false for NaN


def euler_angles(quaternion: FloatArray) -> FloatArray:
    """Return roll, pitch and yaw (n, 3) [rad] of quaternions w, x, y, z (n, 4) in time; yaw does not jump by a turn.

    Yaw about z, then pitch about y, then roll about x (REP-103). With x forward, y to port and z up, roll is positive
    with the port side up, pitch with the nose down, yaw to port. They are not defined where the nose points straight
    up or down.
    """
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
