"""MuJoCo's derivatives of the step with the water in it, and its inverse dynamics."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from mjfish.mujoco.coupling_choice import Coupling
from mjfish.numerics.arrays import FloatArray
from proofs import integrator_steps, parts, trees
from proofs.dense_equation import equation

_STEP = 2e-3


def transition_difference(coupling: Coupling, integrator: str, *, euler_damp: bool = True) -> float:
    """Return the largest difference of A and B of `mjd_transitionFD` from differences of `mj_step`, over the largest.

    Both are centred differences, of unlike widths; states are in the tangent space of the pose. MuJoCo has none of RK4.
    """
    tree = trees.chain()
    model = integrator_steps.model(tree, integrator, _STEP, euler_damp=euler_damp)
    fluid = parts.wet(model, tree, coupling)
    data = mujoco.MjData(model)
    parts.stir(model, data, seed=5)
    data.ctrl[:] = (0.3, -0.2)
    size = 2 * model.nv
    A, B = np.zeros((size, size)), np.zeros((size, model.nu))
    with fluid.installed():
        mujoco.mjd_transitionFD(model, data, 1e-6, True, A, B, None, None)
        found = _differences(model, data, 1e-5)
    return parts.relative(np.hstack([A, B]), found)


def _differences(model: mujoco.MjModel, data: mujoco.MjData, width: float) -> FloatArray:
    """Return the derivative (2 nv, 2 nv + nu) of the state after `mj_step`."""
    nv = model.nv
    after = _after(model, data, np.zeros(2 * nv + model.nu))
    columns = []
    for k in range(2 * nv + model.nu):
        nudge = np.zeros(2 * nv + model.nu)
        nudge[k] = width
        ends = []
        for sign in (1.0, -1.0):
            moved = _after(model, data, sign * nudge)
            turned = np.zeros(nv)
            mujoco.mj_differentiatePos(model, turned, 1.0, after[0], moved[0])
            ends.append(np.concatenate([turned, moved[1]]))
        columns.append((ends[0] - ends[1]) / (2.0 * width))
    return np.column_stack(columns)


def _after(model: mujoco.MjModel, data: mujoco.MjData, nudge: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return qpos and qvel one step after a nudged state."""
    nv = model.nv
    moved = mujoco.MjData(model)
    moved.qpos[:], moved.qvel[:], moved.ctrl[:] = data.qpos, data.qvel, data.ctrl
    mujoco.mj_integratePos(model, moved.qpos, nudge[:nv], 1.0)
    moved.qvel += nudge[nv : 2 * nv]
    moved.ctrl += nudge[2 * nv :]
    mujoco.mj_step(model, moved)
    return moved.qpos.copy(), moved.qvel.copy()


@dataclass(frozen=True)
class Inverse:
    """Inverse dynamics after `mj_forward`; relative to the largest number expected.

    Attributes:
        applied: how far `qfrc_inverse` is from the forces applied: the water is in it.
        corrected: the same less the wrenches that `StripFluid.wrenches` returns.
        rigid, wet: how far the slope of `mjd_inverseFD` against the acceleration is from M, from M + M_a.
    """

    applied: float
    corrected: float
    rigid: float
    wet: float


def inverse(coupling: Coupling) -> Inverse:
    """Measure inverse dynamics: MuJoCo never calls the control callback there, so that nobody tells it of the water."""
    chain = trees.chain()
    model = parts.spec(chain, integrator="Euler").compile()
    fluid = parts.wet(model, chain, coupling)
    data = mujoco.MjData(model)
    parts.stir(model, data, seed=5)
    data.qfrc_applied[:] = 3.0 * np.random.default_rng(8).normal(size=model.nv)
    exact = equation(model, data)
    slope = np.zeros((model.nv, model.nv))
    with fluid.installed():
        mujoco.mj_forward(model, data)
        mujoco.mj_inverse(model, data)
        water = np.zeros(model.nv)
        for link, wrench in zip(fluid.links, fluid.wrenches(data)["total"], strict=True):
            body = model.body(link.body).id
            mujoco.mj_applyFT(model, data, wrench[:3], wrench[3:], data.xipos[body], body, water)
        found = data.qfrc_inverse.copy()
        mujoco.mjd_inverseFD(model, data, 1e-6, False, None, None, slope, None, None, None, None)
    return Inverse(
        parts.relative(found, data.qfrc_applied),
        parts.relative(found - water, data.qfrc_applied),
        parts.relative(slope, exact.rigid),
        parts.relative(slope, exact.inertia),
    )
