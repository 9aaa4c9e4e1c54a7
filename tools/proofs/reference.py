"""The force of the water once more, in plain NumPy and MuJoCo's own functions: slow, but to be read.

Install `control` by ``mujoco.set_mjcb_control``; its coupling is ``xfrc``. The compiled one is
`mjfish.mujoco.coupling`; a test holds both together.
"""

from __future__ import annotations

import mujoco
import numpy as np

from mjfish.hydro.blunt_force import blunt_drag
from mjfish.hydro.load import ANSWER, LoadBuffers, loads_on
from mjfish.hydro.spatial_force import spatial_drag, spatial_gyroscopic, spatial_munk
from mjfish.mujoco.block import block_of
from mjfish.numerics.arrays import FloatArray, RecordArray
from proofs.dense_inertia import axes_of, inertia, inertia_of, jacobian_of, origin_of


def control(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Write each link's wrench into ``xfrc_applied``; the commands in ``ctrl`` are the caller's."""
    water = block_of(model).links
    data.xfrc_applied[np.unique(water["body"]).astype(int)] = 0.0
    acceleration = solve(model, data)
    for index, link in enumerate(water):
        J, b, A = jacobian_of(model, data, link), bias_of(model, data, link), inertia_of(link)
        wrench = force_of(model, data, link) + load_of(model, data, index) - A @ (J @ acceleration + b)
        data.xfrc_applied[int(link["body"])] += _applied(data, link, wrench)


def solve(model: mujoco.MjModel, data: mujoco.MjData) -> FloatArray:
    """Return q'' (nv,) of (M + sum J^T A J) q'' = tau - c + sum J^T (f - A b), dense."""
    mujoco.mj_fwdActuation(model, data)  # qfrc_actuator is that of the step before
    force = data.qfrc_passive + data.qfrc_actuator + data.qfrc_applied - data.qfrc_bias
    for index, link in enumerate(block_of(model).links):
        J, b, A = jacobian_of(model, data, link), bias_of(model, data, link), inertia_of(link)
        force += J.T @ (force_of(model, data, link) + load_of(model, data, index) - A @ b)
    return np.linalg.solve(inertia(model, data), force)


def bias_of(model: mujoco.MjModel, data: mujoco.MjData, link: RecordArray) -> FloatArray:
    """Return b (6,) with J q'' + b the rate of the velocity relative to the water, in the turning strips' frame.

    There, the rate of v - c is the acceleration in the world less w x (v - c), the current c being steady.
    """
    linear, angular = np.zeros((3, model.nv)), np.zeros((3, model.nv))
    body, origin, axes = int(link["body"]), origin_of(data, link), axes_of(data, link)
    mujoco.mj_jac(model, data, linear, angular, origin, body)
    velocity, omega = linear @ data.qvel, angular @ data.qvel
    mujoco.mj_jacDot(model, data, linear, angular, origin, body)
    turning = np.cross(omega, velocity - model.opt.wind)
    return np.concatenate([axes.T @ (linear @ data.qvel - turning), axes.T @ (angular @ data.qvel)])


def velocity_of(model: mujoco.MjModel, data: mujoco.MjData, link: RecordArray) -> FloatArray:
    """Return velocity relative to the water and angular velocity (6,) of the strips' origin, in their frame."""
    current = np.append(axes_of(data, link).T @ model.opt.wind, np.zeros(3))
    return np.asarray(jacobian_of(model, data, link) @ data.qvel - current)


def load_of(model: mujoco.MjModel, data: mujoco.MjData, index: int) -> FloatArray:
    """Return the force (6,) of all loads on a link, in the strips' frame; write the rates of hidden states to ctrl."""
    water = block_of(model)
    force = np.zeros(6)
    if len(water.loads.addresses):
        link, head = water.links[index], water.header[0]
        seen = water.planes[index : index + 1].copy()
        vx, vy, _, _, _, wz = velocity_of(model, data, link)
        seen["u"], seen["v"], seen["w"] = vx, vy, wz
        seen["x"], seen["y"], _ = origin_of(data, link)
        ahead = -axes_of(data, link)[:, 0]
        seen["heading"] = np.arctan2(ahead[1], ahead[0])
        first = -axes_of(data, water.links[0])[:, 0]
        seen["bend"] = np.arctan2(first[0] * ahead[1] - first[1] * ahead[0], first[:2] @ ahead[:2])
        buffers = LoadBuffers(np.zeros(ANSWER), data.act[head["activation"] :], data.ctrl[head["control"] :])
        force[[0, 1, 5]] = loads_on(seen, 0, index, water.loads, False, buffers)
    return force


def force_of(model: mujoco.MjModel, data: mujoco.MjData, link: RecordArray) -> FloatArray:
    """Return drag, gyroscopic, Munk and buoyancy force (6,) in the strips' frame, about their origin."""
    axes = axes_of(data, link)
    vx, vy, vz, wx, wy, wz = velocity_of(model, data, link)
    if link["blunt"]:
        v, w = (vx, vy, vz), (wx, wy, wz)
        p, turned = np.split(inertia_of(link) @ [*v, *w], 2)
        force = np.concatenate([-np.cross(w, p), -np.cross(w, turned) - link["munk"] * np.cross(v, p)])
        force += blunt_drag(link, v, w)
    else:
        force = np.add(spatial_drag(link, vx, vy, vz, wx, wy, wz), spatial_gyroscopic(link, vy, vz, wx, wy, wz))
        force[3:] += spatial_munk(link, vx, vy, vz, wy, wz)
    if not model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_GRAVITY:
        body = int(link["body"])
        lift = -link["density"] * link["volume"] * model.opt.gravity
        arm = data.xmat[body].reshape(3, 3) @ (link["center"] - link["origin"])
        force += np.concatenate([axes.T @ lift, axes.T @ np.cross(arm, lift)])
    return force


def _applied(data: mujoco.MjData, link: RecordArray, wrench: FloatArray) -> FloatArray:
    """Return a wrench in the strips' frame as MuJoCo takes it: at the body's centre of mass, in the world's axes."""
    axes = axes_of(data, link)
    force = axes @ wrench[:3]
    arm = origin_of(data, link) - data.xipos[int(link["body"])]
    return np.concatenate([force, axes @ wrench[3:] + np.cross(arm, force)])
