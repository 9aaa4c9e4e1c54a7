"""A step of every integrator with damping, springs and servos, against a dense matrix; all end at one trajectory."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np

from mjfish.mujoco.coupling_choice import Coupling
from mjfish.numerics.arrays import FloatArray
from proofs import parts, trees
from proofs.dense_equation import dried, equation, state_of
from proofs.parts import Part

#: Integrators whose step is the solution of one linear equation.
ONE_STEP = ("Euler", "implicitfast", "implicit", "discrete")
#: Couplings and integrators that are right where joints are damped; xfrc needs Euler's implicit damping off.
DAMPED: tuple[tuple[Coupling, str, bool], ...] = (
    *(("inertia", name, True) for name in parts.INTEGRATORS),
    ("inertia", "Euler", False),
    ("xfrc", "Euler", False),
    ("xfrc", "RK4", True),
)
_DAMPING, _STIFFNESS, _KP, _KV = 0.05, 0.8, 1.5, 0.1
_SERVED = ("waist", "tail")
_DURATION = 0.24


def model(tree: Sequence[Part], integrator: str, step: float, *, euler_damp: bool = True) -> mujoco.MjModel:
    """Return a tree whose hinges and balls are damped, its hinges sprung, two of them served."""
    made = parts.spec(tree, integrator=integrator, step=step)
    for part in tree:
        if part.joint in ("hinge", "ball"):
            made.joint(part.name).damping[0] = _DAMPING
        if part.joint == "hinge":
            made.joint(part.name).stiffness[0] = _STIFFNESS
        if part.name in _SERVED:
            servo = made.add_actuator(name=part.name, target=part.name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
            servo.set_to_position(kp=_KP, kv=_KV)
    if not euler_damp:
        made.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_EULERDAMP
    compiled = made.compile()
    compiled.opt.wind[:] = (0.2, -0.1, 0.15)
    return compiled


def step_difference(tree: Sequence[Part], integrator: str, states: int = 5, step: float = 2e-3) -> float:
    """Return the largest relative difference of (v+ - v) / h from the dense solution, coupling ``inertia``."""
    one = model(tree, integrator, step)
    fluid = parts.wet(one, tree)
    data = mujoco.MjData(one)
    worst = 0.0
    for seed in parts.states(one, data, states, speed=2.0):
        data.ctrl[:] = np.random.default_rng(seed).normal(size=one.nu)
        expected = _dense(one, data, integrator)
        with fluid.installed():
            worst = max(worst, _one_step(one, data, expected))
    return worst


def _one_step(mj_model: mujoco.MjModel, data: mujoco.MjData, expected: FloatArray) -> float:
    """Take a step in the water that is installed; return the relative difference of (v+ - v) / h from `expected`."""
    before = data.qvel.copy()
    mujoco.mj_step(mj_model, data)
    return parts.relative((data.qvel - before) / mj_model.opt.timestep, expected)


def _dense(mj_model: mujoco.MjModel, data: mujoco.MjData, integrator: str) -> FloatArray:
    """Return (v+ - v) / h of the integrator's equation, see MuJoCo's documentation, "Numerical integration"."""
    h = mj_model.opt.timestep
    exact = equation(mj_model, data)
    damping = np.array(mj_model.dof_damping)
    stiffness = np.array([mj_model.jnt_stiffness[j] for j in mj_model.dof_jntid])
    served = np.isin(
        np.arange(mj_model.nv), [mj_model.jnt_dofadr[mj_model.actuator_trnid[k, 0]] for k in range(mj_model.nu)]
    )
    implicit = np.diag(damping + (served * _KV if integrator != "Euler" else 0.0))
    force = exact.force.copy()
    if integrator == "implicit" or (integrator != "Euler" and mj_model.nbody == 2):  # a body alone is always treated so
        implicit += _bias_slope(mj_model, data) * _reached(mj_model)
    inertia = exact.inertia + h * implicit
    if integrator == "discrete":
        springs = stiffness * (mj_model.dof_jntid >= 0) + served * _KP
        inertia += h * h * np.diag(springs)
        force -= h * springs * data.qvel
    return np.asarray(np.linalg.solve(inertia, force))


def _bias_slope(mj_model: mujoco.MjModel, data: mujoco.MjData) -> FloatArray:
    """Return d qfrc_bias / d qvel (nv, nv): the bias is quadratic in the velocity, so that differences are exact."""
    dry = dried(mj_model)
    columns = []
    for dof in range(mj_model.nv):
        ends = []
        for sign in (1.0, -1.0):
            alone = state_of(dry, data)
            alone.qvel[dof] += sign
            mujoco.mj_fwdVelocity(dry, alone)
            ends.append(alone.qfrc_bias.copy())
        columns.append(0.5 * (ends[0] - ends[1]))
    return np.column_stack(columns)


def _reached(mj_model: mujoco.MjModel) -> FloatArray:
    """Return 1 where two dofs lie on one branch (nv, nv): MuJoCo keeps no other slope."""
    on_branch = np.eye(mj_model.nv)
    for dof in range(mj_model.nv):
        above = mj_model.dof_parentid[dof]
        while above >= 0:
            on_branch[dof, above] = on_branch[above, dof] = 1.0
            above = mj_model.dof_parentid[above]
    return on_branch


def _end(tree: Sequence[Part], coupling: Coupling, integrator: str, step: float, *, euler_damp: bool) -> FloatArray:
    """Return the velocities at the end of a run; its servos are asked for a constant angle."""
    one = model(tree, integrator, step, euler_damp=euler_damp)
    fluid = parts.wet(one, tree, coupling)
    data = mujoco.MjData(one)
    parts.stir(one, data, seed=2, speed=0.7)
    data.ctrl[:] = 0.3
    with fluid.installed():
        mujoco.mj_step(one, data, round(_DURATION / step))
    return data.qvel.copy()


def convergence(
    coupling: Coupling, integrator: str, *, euler_damp: bool = True, smooth: bool = False
) -> tuple[float, float]:
    """Return the observed order, and the error at a step of 1 ms relative to the largest velocity.

    Against RK4 at a sixteenth of the smallest step, coupling ``inertia``.

    Args:
        coupling, integrator, euler_damp: of the run.
        smooth: without drag.
    """
    tree = parts.with_water(trees.chain(), c_d=0.0, c_f=0.0) if smooth else trees.chain()
    steps = np.array([4e-3, 2e-3, 1e-3] if integrator == "RK4" else [1e-3, 5e-4, 2.5e-4])
    true = _end(tree, "inertia", "RK4", 1.25e-4, euler_damp=True)
    ends = [_end(tree, coupling, integrator, step, euler_damp=euler_damp) for step in steps]
    errors = np.array([parts.relative(end, true) for end in ends])
    order = np.polyfit(np.log(steps), np.log(errors), 1)[0]
    return float(order), float(errors[steps == 1e-3][0])


def refused_difference(integrator: str, states: int = 5, step: float = 2e-3) -> float:
    """Return how far a step of coupling ``xfrc`` would be from the dense solution, had it not been refused."""
    chain = trees.chain()
    one = model(chain, integrator, step)
    parts.wet(one, chain)
    data = mujoco.MjData(one)
    worst = 0.0
    for _ in parts.states(one, data, states, speed=2.0):
        expected = _dense(one, data, integrator)
        with parts.plain_water():
            worst = max(worst, _one_step(one, data, expected))
    return worst
