"""The equation of motion with the water in it, dense, in plain NumPy: what both couplings must solve.

    (M + M_a) q'' = force,   M_a = sum J^T A J,   force = tau - c + sum J^T (f - A b)

M, tau and c come from a copy of the model without water, so that nothing of a coupling gets in.
"""

from __future__ import annotations

import copy
from dataclasses import dataclass

import mujoco
import numpy as np

from mjfish.mujoco.block import block_of
from mjfish.numerics.arrays import FloatArray
from proofs import reference


@dataclass(frozen=True, eq=False)
class Equation:
    """The equation of motion at one state.

    Attributes:
        rigid: (nv, nv) M.
        added: (nv, nv) M_a.
        force: (nv,) everything but constraints.
    """

    rigid: FloatArray
    added: FloatArray
    force: FloatArray

    @property
    def inertia(self) -> FloatArray:
        """M + M_a (nv, nv)."""
        return self.rigid + self.added

    def acceleration(self) -> FloatArray:
        """Return q'' (nv,) without constraints."""
        return np.asarray(np.linalg.solve(self.inertia, self.force))


def dried(model: mujoco.MjModel) -> mujoco.MjModel:
    """Return a copy of a model on which no water acts."""
    dry = copy.copy(model)
    dry.opt.o_solimp[:] = (0.9, 0.95, 0.001, 0.5, 2.0)
    return dry


def state_of(dry: mujoco.MjModel, data: mujoco.MjData) -> mujoco.MjData:
    """Return data of the dry model at the state and with the commands and generalised forces of `data`."""
    alone = mujoco.MjData(dry)
    for name in ("time", "qpos", "qvel", "act", "ctrl", "qfrc_applied"):
        if name == "time":
            alone.time = data.time
        else:
            getattr(alone, name)[:] = getattr(data, name)
    mujoco.mj_forward(dry, alone)
    return alone


def equation(model: mujoco.MjModel, data: mujoco.MjData) -> Equation:
    """Return the equation of motion of a model with water, at the state of `data`."""
    dry = dried(model)
    alone = state_of(dry, data)
    rigid = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(dry, alone, rigid)
    added = np.zeros_like(rigid)
    force = alone.qfrc_passive + alone.qfrc_actuator + alone.qfrc_applied - alone.qfrc_bias
    for link in block_of(model).links:
        J = reference.jacobian_of(model, alone, link)
        A = reference.inertia_of(link)
        added += J.T @ A @ J
        force += J.T @ (reference.force_of(model, alone, link) - A @ reference.bias_of(model, alone, link))
    return Equation(rigid, added, force)
