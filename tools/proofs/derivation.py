"""The force on a strip link in space against slices that share no formula with it, and a whole chain against them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from mjfish.hydro.force import crossflow
from mjfish.hydro.spatial_force import added_momentum, spatial_drag, spatial_gyroscopic, spatial_munk
from mjfish.mujoco.block import records
from mjfish.mujoco.coupling_choice import Coupling
from mjfish.mujoco.links import StripLink
from mjfish.numerics.arrays import FloatArray, RecordArray
from proofs import parts, trees
from proofs.dense_equation import dried, state_of
from proofs.slices import Motion, Strips, drag_wrench, inertial_wrench, strips

#: A link that tapers differently in height and width; the strips' frame is the body's.
TAPERED: Mapping[str, Any] = {
    "length": 0.3,
    "station": (0.0, 0.11, 0.3),
    "height": (0.03, 0.12, 0.06),
    "width": (0.06, 0.07, 0.01),
    "axis": (1.0, 0.0, 0.0),
    "c_m": 0.8,
    "c_d": 1.6,
    "c_f": 0.03,
    "roll_damping": 0.7,
}


def record(link: Mapping[str, Any]) -> RecordArray:
    """Return the record of a link, as compiled code reads it."""
    return records([StripLink(body="link", **link)], 1000.0)[0]


def inertial_difference(kappa: float, states: int = 40) -> float:
    """Return the largest difference of added-mass, gyroscopic and Munk force from the slices, of the largest force."""
    link, one = record({**TAPERED, "munk_moment": kappa}), strips(TAPERED)
    random = np.random.default_rng(3)
    worst = 0.0
    for _ in range(states):
        v, w, dv, dw = random.normal(size=(4, 3)) * [[1.0], [4.0], [5.0], [20.0]]
        turned = Rotation.random(rng=random).as_matrix()
        motion = _moving(turned, v, w, dv, dw)
        expected = inertial_wrench(one, motion, kappa)
        found = np.array(spatial_gyroscopic(link, v[1], v[2], *w))
        found[3:] += spatial_munk(link, *v, w[1], w[2])
        found[1:] -= added_momentum(link, dv[1], dv[2], *dw)
        found = np.concatenate([turned @ found[:3], turned @ found[3:]])
        worst = max(worst, parts.relative(found[:3], expected[:3]), parts.relative(found[3:], expected[3:]))
    return worst


def _moving(
    turned: FloatArray, v: FloatArray, w: FloatArray, dv: FloatArray, dw: FloatArray
) -> Callable[[float], Motion]:
    """Return a motion with these velocities and their rates, in the link's own axes, at time zero."""

    def motion(t: float) -> Motion:
        axes = turned @ Rotation.from_rotvec(w * t).as_matrix()
        return Motion(turned @ v * t, axes, axes @ (v + dv * t), axes @ (w + dw * t))

    return motion


def drag_differences(roots: int, states: int = 40) -> FloatArray:
    """Return the differences (states,) of drag and friction from adaptive quadrature, of the largest in each state.

    Args:
        roots: how many of the two components across change sign inside the link.
        states: how many.
    """
    link, one = record(TAPERED), strips(TAPERED)
    random = np.random.default_rng(4)
    worst = []
    for _ in range(states):
        w = 6.0 * random.normal(size=3)
        inside, outside = random.uniform(0.02, 0.28, size=2), random.uniform(0.35, 0.8, size=2)
        at = np.where(np.arange(2) < roots, inside, outside)
        v = np.array([random.normal(), -w[2] * at[0], w[1] * at[1]])
        expected = drag_wrench(one, Motion(np.zeros(3), np.eye(3), v, w))
        found = np.array(spatial_drag(link, *v, *w))
        worst.append(max(parts.relative(found[:3], expected[:3]), parts.relative(found[3:], expected[3:])))
    return np.array(worst)


def planar_difference() -> float:
    """Return the largest difference from the planar force where nothing moves up, pitches or rolls: none."""
    link = record(TAPERED)
    random = np.random.default_rng(5)
    worst = 0.0
    for _ in range(40):
        u, v, w = random.normal(size=3) * (1.0, 1.0, 6.0)
        fx, fy, fz, mx, my, mz = spatial_drag(link, u, v, 0.0, 0.0, 0.0, w)
        force, moment = crossflow(v, w, link["length"], link["node_height"], link["height_moment"])
        across = -0.5 * link["density"] * link["c_d"]
        along = -0.5 * link["density"] * link["c_f"] * link["wetted"]
        planar = (along * abs(u) * u, across * force, 0.0, 0.0, 0.0, across * moment)
        worst = max(worst, float(np.abs(np.subtract((fx, fy, fz, mx, my, mz), planar)).max()))
    return worst


def balance(coupling: Coupling, states: int = 3, **replaced: float) -> float:
    """Return what is left of M q'' + c - tau = J^T F of a free chain in a current, F of slices, q'' of MuJoCo.

    The slices are differentiated along the motion that MuJoCo's acceleration gives; relative to the largest force.
    `replaced` coefficients count for every link.
    """
    chain = parts.with_water(trees.chain(), **replaced)
    model = parts.spec(chain).compile()
    model.opt.wind[:] = (0.4, -0.3, 0.2)
    fluid = parts.wet(model, chain, coupling)
    dry = dried(model)
    data = mujoco.MjData(model)
    worst = 0.0
    for _ in parts.states(model, data, states):
        with fluid.installed():
            mujoco.mj_forward(model, data)
        alone = state_of(dry, data)
        left = alone.qfrc_bias - alone.qfrc_passive
        inertia = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(dry, alone, inertia)
        left += inertia @ data.qacc
        largest = np.abs(left).max()
        for part in chain:
            for link in part.strips:
                left -= _pulled(dry, alone, data.qacc, part.name, strips(link))
        worst = max(worst, float(np.abs(left).max() / largest))
    return worst


def motion_of(dry: mujoco.MjModel, data: mujoco.MjData, body: str, one: Strips) -> Motion:
    """Return the motion of strips on a body relative to the water, `data` being placed and its velocities known."""
    index = dry.body(body).id
    turned = data.xmat[index].reshape(3, 3)
    point = data.xpos[index] + turned @ one.origin
    twist = np.zeros(6)
    mujoco.mj_objectVelocity(dry, data, mujoco.mjtObj.mjOBJ_XBODY, index, twist, 0)
    velocity = twist[3:] + np.cross(twist[:3], point - data.xpos[index])
    drifted = point - dry.opt.wind * data.time
    return Motion(drifted, turned @ one.frame, velocity - dry.opt.wind, twist[:3])


def _pulled(dry: mujoco.MjModel, start: mujoco.MjData, acceleration: FloatArray, body: str, one: Strips) -> FloatArray:
    """Return the generalised force (nv,) of one link's slices."""
    moved = mujoco.MjData(dry)

    def motion(t: float) -> Motion:
        moved.time = t
        moved.qpos[:] = start.qpos
        mujoco.mj_integratePos(dry, moved.qpos, start.qvel, t)
        moved.qvel[:] = start.qvel + t * acceleration
        mujoco.mj_fwdPosition(dry, moved)
        mujoco.mj_fwdVelocity(dry, moved)
        return motion_of(dry, moved, body, one)

    now = motion(0.0)
    wrench = inertial_wrench(one, motion, one.kappa) + drag_wrench(one, now)
    linear, angular = np.zeros((3, dry.nv)), np.zeros((3, dry.nv))
    mujoco.mj_jac(dry, start, linear, angular, now.point, dry.body(body).id)
    return np.asarray(linear.T @ wrench[:3] + angular.T @ wrench[3:])
