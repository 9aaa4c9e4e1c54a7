"""MuJoCo's fish with prescribed joint motion: what the head-frame model assumes, for comparison with it.

Each joint carries a flywheel, an armature so large that nothing in the water disturbs it, driven by a torque of
armature times asked acceleration. A jump of the joints' rate sets the root off as momentum demands: no force acts from
outside.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import mujoco
import numpy as np

from mjfish.drive.motion import JointMotion
from mjfish.fish import Fish, frames
from mjfish.hydro.load import Load, memory_of
from mjfish.mujoco.coupling_choice import Coupling
from mjfish.mujoco.fluid import StripFluid
from mjfish.mujoco.layout import compile_aside
from mjfish.mujoco.memory import make_room
from mjfish.mujoco.mjcf import ROOT, Integrator, prepared, spec, strips
from mjfish.mujoco.rollout import DIVERGED
from mjfish.numerics.arrays import FloatArray
from proofs import dense_inertia

#: Inertia of a flywheel [kg m2]: torques of the water, below 10 N m, change the asked acceleration by 1e-8 rad/s2.
_FLYWHEEL = 1e9


@dataclass(frozen=True, eq=False)
class Prescribed:
    """A run with prescribed joints.

    Attributes:
        time: (n,) boundaries of the steps [s].
        velocity: (n, 3) surge, sway [m/s], yaw rate [rad/s] of the nose in the forward frame.
        status: ``ok`` or ``diverged``.
    """

    time: FloatArray
    velocity: FloatArray
    status: Literal["ok", "diverged"]


def specification(fish: Fish, integrator: Integrator = "RK4", step: float = 0.001) -> mujoco.MjSpec:
    """Return the MJCF without water of the planar fish with a flywheel and a motor on every joint."""
    changed = prepared(fish, spec(fish), step, integrator)
    for actuator in changed.actuators:
        actuator.set_to_motor()
        actuator.gear[0] = _FLYWHEEL
        changed.joint(actuator.target).armature = _FLYWHEEL
    return changed


def simulate(
    fish: Fish,
    motion: JointMotion,
    *,
    values: Mapping[str, float] | None = None,
    integrator: Integrator = "RK4",
    coupling: Coupling | None = None,
    loads: Sequence[tuple[Load, Sequence[float]]] = (),
) -> Prescribed:
    """Run the fish in MuJoCo from rest, its joints moving as `motion` has it, exactly so at every boundary of a step.

    Args:
        fish: the fish.
        motion: joint motion on the half-step grid; its grid gives the steps.
        values: coefficients by name that replace the fish's.
        integrator: of MuJoCo.
        coupling: of the water; None: the one that is right.
        loads: extra forces on every link, with their parameters.
    """
    driven = specification(fish, integrator)
    make_room(driven, memory_of(loads, len(fish.links)))
    fluid = StripFluid(
        compile_aside(driven),
        strips(fish, values),
        density=fish.density,
        coupling=coupling,
        commanded=True,
        loads=loads,
    )
    model, data = fluid.model, mujoco.MjData(fluid.model)
    speed = np.empty((len(motion.time), ROOT))
    heading = np.empty(len(motion.time))
    joints = slice(ROOT, ROOT + fish.joints)
    data.qpos[joints], data.qvel[joints] = motion.angle[0, 0], motion.rate[0, 0]
    done = 0
    with fluid.installed():
        for step, width in enumerate(np.diff(motion.time)):
            if step and np.any(motion.rate[step, 0] != motion.rate[step - 1, 2]):
                _jump(model, data, joints, motion.rate[step, 0])
            speed[step], heading[step] = data.qvel[:ROOT], data.qpos[ROOT - 1]
            model.opt.timestep = width
            data.userdata[0] = data.time
            data.userdata[1:] = motion.acceleration[step].ravel()
            mujoco.mj_step(model, data)
            data.qpos[joints], data.qvel[joints] = motion.angle[step, 2], motion.rate[step, 2]
            done = step + 1
            if not np.abs(data.qvel).max() < DIVERGED:
                break
    speed[done], heading[done] = data.qvel[:ROOT], data.qpos[ROOT - 1]
    kept = slice(done + 1)
    nose = frames.to_body(speed[kept, :2], heading[kept])
    good = done == len(motion.time) - 1 and np.abs(speed[done]).max() < DIVERGED
    return Prescribed(
        time=motion.time[kept],
        velocity=np.column_stack([nose, speed[kept, 2]]),
        status="ok" if good else "diverged",
    )


def _jump(model: mujoco.MjModel, data: mujoco.MjData, joints: slice, rate: FloatArray) -> None:
    """Set the joints to a new rate; the momentum of all else (root, tail) stays: dq_f = -H_ff^-1 H_fj dq_joints."""
    mujoco.mj_fwdPosition(model, data)
    inertia = dense_inertia.inertia(model, data)
    free = np.ones(model.nv, dtype=np.bool_)
    free[joints] = False
    change = rate - data.qvel[joints]
    data.qvel[free] -= np.linalg.solve(inertia[np.ix_(free, free)], inertia[free, joints] @ change)
    data.qvel[joints] = rate
