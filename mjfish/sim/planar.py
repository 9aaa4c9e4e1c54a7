"""The MuJoCo model of a planar fish: the hand-written MJCF of a shipped fish, or the same built from any fish."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Literal

import mujoco
import numpy as np

from mjfish import fish as fishes
from mjfish.errors import InputError, UnknownNameError
from mjfish.fish import COEFFICIENTS, KINDS, Fish, Link, Servo
from mjfish.hydro.outline import LinkOutline, outlines
from mjfish.sim.compatible import Coupling
from mjfish.sim.fluid import StripFluid
from mjfish.sim.layout import compile_aside
from mjfish.sim.strip_link import StripLink

Integrator = Literal["RK4", "Euler", "implicitfast", "implicit", "discrete"]
INTEGRATORS = {
    "RK4": mujoco.mjtIntegrator.mjINT_RK4,
    "Euler": mujoco.mjtIntegrator.mjINT_EULER,
    "implicitfast": mujoco.mjtIntegrator.mjINT_IMPLICITFAST,
    "implicit": mujoco.mjtIntegrator.mjINT_IMPLICIT,
    "discrete": mujoco.mjtIntegrator.mjINT_DISCRETE,
}
#: Servos of a fish that names none: decay of their fastest mode [1/s], and kp / kv [1/s]. RK4 is stable at 2 ms.
_SERVO_DECAY = 1000.0
_SERVO_RATIO = 400.0
#: Degrees of freedom of the root: x, y, yaw.
ROOT = 3
_SKIN = (0.33, 0.47, 0.37, 1.0)


def xml(name: str) -> Traversable:
    """Return a file of ``models/xml``, from the installed package or from the source tree.

    Raises:
        UnknownNameError: no such file; the message lists those there are.
    """
    installed = resources.files("mjfish") / "models" / "xml"
    folder: Traversable = installed if installed.is_dir() else Path(__file__).parents[2] / "models" / "xml"
    if not (folder / name).is_file():
        known = [entry.name for entry in folder.iterdir()] if folder.is_dir() else []
        raise UnknownNameError("MuJoCo model file", name, known)
    return folder / name


def swimmer(
    fish: Fish,
    *,
    values: Mapping[str, float] | None = None,
    step: float = 0.001,
    integrator: Integrator = "RK4",
    coupling: Coupling | None = None,
) -> StripFluid:
    """Compile the fish and put it into water; its servos read their commands from userdata (`mjfish.sim.rollout`).

    Args:
        fish: the fish.
        values: coefficients by name that replace the fish's.
        step: time step [s].
        integrator: of MuJoCo.
        coupling: see `mjfish.sim.coupling`; None: the one that is right.

    Returns:
        The water; its `model` is the fish.
    """
    specification = prepared(fish, spec(fish), step, integrator)
    return StripFluid(
        compile_aside(specification), strips(fish, values), density=fish.density, coupling=coupling, commanded=True
    )


def prepared(fish: Fish, specification: mujoco.MjSpec, step: float, integrator: Integrator) -> mujoco.MjSpec:
    """Set step, integrator and room for the commands; refuse what MuJoCo's fish does not have."""
    if integrator not in INTEGRATORS:
        raise UnknownNameError("integrator", integrator, INTEGRATORS)
    if fish.tail_compliance > 0.0:
        raise InputError(
            f"{fish.name}: tail_compliance is {fish.tail_compliance:g} rad/(N m), but a flexible tail exists in the "
            "ODE only; set tail_compliance = 0 for MuJoCo"
        )
    specification.option.timestep = step
    specification.option.integrator = INTEGRATORS[integrator]
    specification.nuserdata = 1 + 3 * fish.joints
    return specification


def strips(fish: Fish, values: Mapping[str, float] | None = None) -> tuple[StripLink, ...]:
    """Return the strips of the fish's links; `values` replaces coefficients by name.

    Raises:
        UnknownNameError: a name in `values` is no coefficient.
    """
    for name in values or {}:
        if name not in COEFFICIENTS:
            raise UnknownNameError("coefficient", name, COEFFICIENTS)
    given = {**fish.values, **(values or {})}
    front = np.cumsum([0.0, *(link.length for link in fish.links)])
    return tuple(
        StripLink(
            body=link.name,
            length=link.length,
            sections=fish.sections,
            start=float(start),
            munk_moment=fish.munk_moment,
            **{kind: float(given[f"{kind}.{link.group}"]) for kind in KINDS},
        )
        for link, start in zip(fish.links, front, strict=False)
    )


def spec(fish: Fish) -> mujoco.MjSpec:
    """Return the MJCF of the fish without water: hand-written where its body is that of a shipped fish, else built."""
    shipped = fishes.shipped()
    if fish.name in shipped and _body(fish) == _body(fishes.load(fish.name)):
        try:
            return mujoco.MjSpec.from_string(xml(f"{fish.name}_planar.xml").read_text(encoding="utf-8"))
        except UnknownNameError:
            pass  # shipped as TOML only
    return build(fish)


def _body(fish: Fish) -> object:
    return fish.links, fish.sections, fish.servo


def build(fish: Fish, servo: Servo | None = None) -> mujoco.MjSpec:
    """Build the MJCF of the fish, the same as the hand-written one but for looks; `servo` replaces the fish's."""
    made = mujoco.MjSpec()
    made.modelname = f"{fish.name}_planar"
    made.compiler.inertiafromgeom = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_FALSE
    bits = mujoco.mjtDisableBit
    made.option.disableflags = bits.mjDSBL_GRAVITY | bits.mjDSBL_CONTACT | bits.mjDSBL_AUTORESET
    made.option.gravity = (0.0, 0.0, 0.0)
    made.worldbody.add_light(pos=(0.0, 0.0, 3.0))
    parent = made.worldbody
    front = 0.0  # length of the link in front
    servo = servo or fish.servo or default_servo(fish)
    for index, (link, outline) in enumerate(zip(fish.links, outlines(fish), strict=True)):
        parent = _add_link(parent, link, outline, front)
        if index == 0:
            _add_root(parent)
        else:
            parent.add_joint(name=f"joint_{index}", type=mujoco.mjtJoint.mjJNT_HINGE, axis=(0, 0, 1))
            _add_servo(made, index, servo)
        front = link.length
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


def _add_link(parent: mujoco.MjsBody, link: Link, outline: LinkOutline, front: float) -> mujoco.MjsBody:
    body = parent.add_body(
        name=link.name,
        pos=(-front, 0, 0),
        explicitinertial=True,
        mass=link.mass,
        ipos=(-link.com, 0, 0),
        inertia=(link.inertia,) * 3,
    )
    body.add_geom(
        name=link.name,
        type=mujoco.mjtGeom.mjGEOM_ELLIPSOID,
        pos=(-0.5 * link.length, 0, 0),
        size=(0.6 * link.length, 0.5 * outline.strip_width.mean(), 0.5 * outline.strip_height.mean()),
        mass=0.0,
        contype=0,
        conaffinity=0,
        rgba=_SKIN,
    )
    return body


def _add_root(head: mujoco.MjsBody) -> None:
    head.add_joint(name="x", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=(1, 0, 0))
    head.add_joint(name="y", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=(0, 1, 0))
    head.add_joint(name="yaw", type=mujoco.mjtJoint.mjJNT_HINGE, axis=(0, 0, 1))


def _add_servo(made: mujoco.MjSpec, index: int, servo: Servo) -> None:
    actuator = made.add_actuator(name=f"servo_{index}", target=f"joint_{index}", trntype=mujoco.mjtTrn.mjTRN_JOINT)
    actuator.set_to_position(kp=servo.kp, kv=servo.kv)
