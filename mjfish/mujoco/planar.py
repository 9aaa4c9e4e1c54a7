"""The MuJoCo model of a planar fish: the hand-written MJCF of a shipped fish, or the same built from any fish."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import mujoco
import numpy as np

from mjfish.fish import Fish, Servo
from mjfish.hydro.load import Load
from mjfish.mujoco.compatible import Coupling
from mjfish.mujoco.fluid import StripFluid
from mjfish.mujoco.layout import compile_aside
from mjfish.mujoco.mjcf import Integrator, chain, prepared, strips, written, xml

__all__ = ["ROOT", "Integrator", "build", "default_servo", "prepared", "spec", "strips", "swimmer", "xml"]

#: Servos of a fish that names none: decay of their fastest mode [1/s], and kp / kv [1/s]. RK4 is stable at 2 ms.
_SERVO_DECAY = 1000.0
_SERVO_RATIO = 400.0
#: Degrees of freedom of the root: x, y, yaw.
ROOT = 3


def swimmer(
    fish: Fish,
    *,
    values: Mapping[str, float] | None = None,
    step: float = 0.001,
    integrator: Integrator = "RK4",
    coupling: Coupling | None = None,
    loads: Sequence[tuple[Load, Sequence[float]]] = (),
) -> StripFluid:
    """Compile the fish and put it into water; its servos read their commands from userdata (`mjfish.mujoco.rollout`).

    Args:
        fish: the fish.
        values: coefficients by name that replace the fish's.
        step: time step [s].
        integrator: of MuJoCo.
        coupling: see `mjfish.mujoco.coupling`; None: the one that is right.
        loads: extra forces on every link, with their parameters.

    Returns:
        The water; its `model` is the fish.
    """
    specification = prepared(fish, spec(fish), step, integrator)
    return StripFluid(
        compile_aside(specification),
        strips(fish, values),
        density=fish.density,
        coupling=coupling,
        commanded=True,
        loads=loads,
    )


def spec(fish: Fish) -> mujoco.MjSpec:
    """Return the MJCF of the fish without water: hand-written where its body is that of a shipped fish, else built."""
    return written(fish, "planar") or build(fish)


def build(fish: Fish, servo: Servo | None = None) -> mujoco.MjSpec:
    """Build the MJCF of the fish, the same as the hand-written one but for looks; `servo` replaces the fish's."""
    made = chain(fish, servo or fish.servo or default_servo(fish))
    made.modelname = f"{fish.name}_planar"
    made.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_GRAVITY
    made.option.gravity = (0.0, 0.0, 0.0)
    head = made.body(fish.links[0].name)
    head.add_joint(name="x", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=(1, 0, 0))
    head.add_joint(name="y", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=(0, 1, 0))
    head.add_joint(name="yaw", type=mujoco.mjtJoint.mjJNT_HINGE, axis=(0, 0, 1))
    return made


def default_servo(fish: Fish) -> Servo:
    """Return a servo for a fish that names none, as stiff as explicit integration at a step of 2 ms can bear.

    The joints alone, straight and still: kv W, with W the joint block of (M + sum_i J_i^T A_i J_i)^-1, has the decay
    rates of the fastest modes.
    """
    bare = compile_aside(build(fish, servo=Servo(kp=1.0, kv=1.0)))
    water = StripFluid(bare, strips(fish), density=fish.density, coupling="inertia")
    data = mujoco.MjData(bare)
    with water.installed():
        mujoco.mj_forward(bare, data)
    inertia = np.zeros((bare.nv, bare.nv))
    mujoco.mj_fullM(bare, data, inertia)
    fastest = np.linalg.eigvalsh(np.linalg.inv(inertia)[ROOT:, ROOT:]).max()
    kv = _SERVO_DECAY / fastest
    return Servo(kp=_SERVO_RATIO * kv, kv=kv)
