"""The force of the water once more, in plain NumPy and MuJoCo's own functions: slow, but to be read.

Install `control` by ``mujoco.set_mjcb_control``. The compiled one is in `mjfish.sim.fluid`; a test holds both together.
"""

from __future__ import annotations

import mujoco
import numpy as np

from mjfish import frames
from mjfish.arrays import FloatArray, RecordArray
from mjfish.hydro.force import added_mass, drag, gyroscopic
from mjfish.sim import parameters


def control(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Write each link's wrench into ``xfrc_applied``; the commands in ``ctrl`` are the caller's."""
    bodies, water = parameters.read(model)
    jacobians = [jacobian_of(model, data, body) for body in bodies]
    biases = [_bias(model, data, body) for body in bodies]
    masses = [inertia_of(link) for link in water]
    inertia = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, inertia)
    mujoco.mj_fwdActuation(model, data)  # qfrc_actuator is that of the step before
    force = data.qfrc_passive + data.qfrc_actuator + data.qfrc_applied - data.qfrc_bias
    forces = []
    for index, (J, b, A) in enumerate(zip(jacobians, biases, masses, strict=True)):
        water["u"][index], water["v"][index], water["w"][index] = J @ data.qvel
        forces.append(np.add(drag(water[index]), gyroscopic(water[index])))
        inertia += J.T @ A @ J
        force += J.T @ (forces[-1] - A @ b)
    acceleration = np.linalg.solve(inertia, force)
    for body, J, b, A, f in zip(bodies, jacobians, biases, masses, forces, strict=True):
        _apply(data, body, f - A @ (J @ acceleration + b))


def inertia_of(link: RecordArray) -> FloatArray:
    """Return the added mass (3, 3) of a link about its joint; none along the body."""
    a0, a1, a2 = added_mass(link)
    return np.array([[0.0, 0.0, 0.0], [0.0, a0, a1], [0.0, a1, a2]])


def _to_link(data: mujoco.MjData, body: int, linear: FloatArray, angular: FloatArray) -> FloatArray:
    """Return world vectors (3, ...) as (u, v, w) of the link: its plane is that of the body's x and y."""
    turn = data.xmat[body].reshape(3, 3)
    planar = np.stack([turn[:, 0] @ linear, turn[:, 1] @ linear, turn[:, 2] @ angular], axis=-1)
    return frames.flip(planar).T


def jacobian_of(model: mujoco.MjModel, data: mujoco.MjData, body: int) -> FloatArray:
    """Return J (3, nv) with (u, v, w) = J qvel at the link's origin."""
    linear, angular = np.zeros((3, model.nv)), np.zeros((3, model.nv))
    mujoco.mj_jac(model, data, linear, angular, data.xpos[body], body)
    return _to_link(data, body, linear, angular)


def _bias(model: mujoco.MjModel, data: mujoco.MjData, body: int) -> FloatArray:
    """Return b (3,) with (u', v', w') = J qacc + b; u' and v' are taken in the turning frame, hence omega x v."""
    linear, angular = np.zeros((3, model.nv)), np.zeros((3, model.nv))
    mujoco.mj_jac(model, data, linear, angular, data.xpos[body], body)
    velocity, omega = linear @ data.qvel, angular @ data.qvel
    mujoco.mj_jacDot(model, data, linear, angular, data.xpos[body], body)
    return _to_link(data, body, linear @ data.qvel - np.cross(omega, velocity), angular @ data.qvel)


def _apply(data: mujoco.MjData, body: int, wrench: FloatArray) -> None:
    """Assign a wrench about the link's origin, in the link's frame; MuJoCo takes it at the body's com, in the world."""
    turn = data.xmat[body].reshape(3, 3)
    fx, fy, mz = frames.flip(wrench)
    force = turn @ [fx, fy, 0.0]
    arm = data.xpos[body] - data.xipos[body]
    data.xfrc_applied[body, :3] = force
    data.xfrc_applied[body, 3:] = turn @ [0.0, 0.0, mz] + np.cross(arm, force)
