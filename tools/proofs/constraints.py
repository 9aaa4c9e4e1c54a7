"""Joint limits, frictionloss and contact in water: the equation of motion balances, with the added mass in it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import mujoco
import numpy as np

from mjfish.numerics.arrays import FloatArray
from proofs import parts, trees
from proofs.dense_equation import equation

#: What is active, by name.
CASES = ("limits", "frictionloss", "contact", "all")
SOLVERS = {"Newton": mujoco.mjtSolver.mjSOL_NEWTON, "CG": mujoco.mjtSolver.mjSOL_CG, "PGS": mujoco.mjtSolver.mjSOL_PGS}
_LIMIT = mujoco.mjtConstraint.mjCNSTR_LIMIT_JOINT
_RUBBING = mujoco.mjtConstraint.mjCNSTR_FRICTION_DOF


@dataclass(frozen=True)
class Balance:
    """How well a constrained state balances.

    Attributes:
        active: rows of constraints that push, in all states.
        balance: largest of |(M + M_a) q'' - force - J^T f| over the largest force.
        law: largest difference of f of limits and frictionloss from what MuJoCo's law gives for q'', over the largest.
        xfrc: largest difference of q'' under coupling ``xfrc``, had it not been refused, over the largest.
    """

    active: int
    balance: float
    law: float
    xfrc: float


def model(case: str, solver: str = "Newton") -> mujoco.MjModel:
    """Return the free chain with something that constrains it; a sphere of the tail lies on a floor."""
    chain = [replace(part, hull=0.06 if part.name == "tail" and case in ("contact", "all") else 0.0)
             for part in trees.chain()]  # fmt: skip
    made = parts.spec(chain)
    made.option.solver = SOLVERS[solver]
    made.option.tolerance = 1e-14
    made.option.iterations = 200
    made.option.ls_tolerance = 1e-8
    made.option.gravity = (0.0, 0.0, -9.81)
    for name in ("waist", "tail"):
        joint = made.joint(name)
        if case in ("limits", "all"):
            joint.limited = mujoco.mjtLimited.mjLIMITED_TRUE
            joint.range = (-0.2, 0.2)
        if case in ("frictionloss", "all"):
            joint.frictionloss = 0.05
    if case in ("contact", "all"):
        made.worldbody.add_geom(name="floor", type=mujoco.mjtGeom.mjGEOM_PLANE, size=(1, 1, 1))
    return made.compile()


def balance(case: str, solver: str, states: int = 6) -> Balance:
    """Measure the chain at random states in which the constraints are active."""
    one = model(case, solver)
    fluid = parts.wet(one, trees.chain())
    data = mujoco.MjData(one)
    active, worst, law, refused = 0, 0.0, 0.0, 0.0
    for _ in parts.states(one, data, states):
        _touch(one, data)
        exact = equation(one, data)
        with fluid.installed():
            mujoco.mj_forward(one, data)
        acceleration = data.qacc.copy()
        left = exact.inertia @ acceleration - exact.force - data.qfrc_constraint
        active += int(np.count_nonzero(data.efc_force))
        worst = max(worst, float(np.abs(left).max() / np.abs(exact.force).max()))
        law = max(law, _law(one, data))
        refused = max(refused, parts.relative(_under_xfrc(one, data), acceleration))
    return Balance(active, worst, law, refused)


def _touch(mj_model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Put the tail's sphere a millimetre into the floor."""
    mujoco.mj_kinematics(mj_model, data)
    data.qpos[2] -= data.xipos[mj_model.body("tail").id, 2] - 0.059


def _law(mj_model: mujoco.MjModel, data: mujoco.MjData) -> float:
    """Return how far limits and frictionloss are from f = -D (J q'' - a_ref), clipped to what each may do."""
    rows = data.nefc
    jacobian = np.zeros((rows, mj_model.nv))
    if mujoco.mj_isSparse(mj_model):
        mujoco.mju_sparse2dense(jacobian, data.efc_J, data.efc_J_rownnz, data.efc_J_rowadr, data.efc_J_colind)
    else:
        jacobian[:] = data.efc_J.reshape(rows, mj_model.nv)
    free = -data.efc_D * (jacobian @ data.qacc - data.efc_aref)
    limit, rubbing = data.efc_type == _LIMIT, data.efc_type == _RUBBING
    asked = np.where(limit, np.maximum(free, 0.0), np.clip(free, -data.efc_frictionloss, data.efc_frictionloss))
    kept = limit | rubbing
    if not np.any(kept):
        return 0.0
    return float(np.abs(data.efc_force - asked)[kept].max() / max(np.abs(asked[kept]).max(), 1e-300))


def _under_xfrc(mj_model: mujoco.MjModel, data: mujoco.MjData) -> FloatArray:
    """Return q'' with the wrenches of the unconstrained motion, as the plain callback writes them."""
    other = mujoco.MjData(mj_model)
    other.qpos[:], other.qvel[:] = data.qpos, data.qvel
    with parts.plain_water():
        mujoco.mj_forward(mj_model, other)
    return other.qacc.copy()


def pgs_error(case: str, states: int = 6) -> float:
    """Return the largest difference of q'' under PGS, had it not been refused, over the largest."""
    one = model(case)
    fluid = parts.wet(one, trees.chain())
    data = mujoco.MjData(one)
    worst = 0.0
    for _ in parts.states(one, data, states):
        _touch(one, data)
        found = []
        with fluid.installed():
            for solver in ("Newton", "PGS"):
                one.opt.solver = SOLVERS[solver]
                mujoco.mj_forward(one, data)
                found.append(data.qacc.copy())
        one.opt.solver = SOLVERS["Newton"]
        worst = max(worst, parts.relative(found[1], found[0]))
    return worst
