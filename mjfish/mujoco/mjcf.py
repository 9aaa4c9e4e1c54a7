"""The MuJoCo model of a fish, in the plane or free in space: hand-written for a shipped fish, built for any other.

Both have the same chain of links, hinges and servos; they differ in the root. In the plane it has three joints (x, y,
yaw) and no gravity. In space it has a free joint, gravity, and buoyancy.

A fish's TOML has the moment of inertia about z only ([Yu2016], Table I). In space, the others are those of a body whose
mass is spread evenly over its ellipse sections, and along x so that I_zz comes out right: with a, b the half axes and
< > the mean over the volume,

    I_xx = m <a^2 + b^2> / 4      I_yy = I_zz + m (<a^2> - <b^2>) / 4

There each link is trimmed neutral for itself: it displaces its mass of water, whatever its outline (ballast is
assumed), and its centre of buoyancy is straight above its centre of mass. So the fish hovers level in every shape.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import resources
from importlib.resources.abc import Traversable
from itertools import accumulate
from pathlib import Path
from typing import Any, Literal

import mujoco
import numpy as np

from mjfish import fish as fishes
from mjfish.errors import InputError, UnknownNameError
from mjfish.fish import KINDS, Fish, Link, Servo, load_fish
from mjfish.fish.outline import LinkOutline, outlines
from mjfish.hydro.load import Load, memory_of
from mjfish.mujoco.coupling_choice import Coupling
from mjfish.mujoco.fluid import StripFluid
from mjfish.mujoco.layout import compile_aside
from mjfish.mujoco.links import StripLink
from mjfish.mujoco.memory import make_room
from mjfish.numerics.arrays import FloatArray

Integrator = Literal["RK4", "Euler", "implicitfast", "implicit", "discrete"]
INTEGRATORS = {
    "RK4": mujoco.mjtIntegrator.mjINT_RK4,
    "Euler": mujoco.mjtIntegrator.mjINT_EULER,
    "implicitfast": mujoco.mjtIntegrator.mjINT_IMPLICITFAST,
    "implicit": mujoco.mjtIntegrator.mjINT_IMPLICIT,
    "discrete": mujoco.mjtIntegrator.mjINT_DISCRETE,
}
#: Hinge of a flexible tail; its coordinate is the last.
DEFLECTION = "deflection"
#: Springs of the tail by the square of its deflection, to either side; slack so far to the other [rad].
_SIDES, _SLACK = ((f"{DEFLECTION}_left", 1.0), (f"{DEFLECTION}_right", -1.0)), 1e3
#: Degrees of freedom of the root in the plane: x, y, yaw.
ROOT = 3
#: Of the earth [m/s2].
GRAVITY = 9.81
_SKIN = (0.33, 0.47, 0.37, 1.0)
#: Servos of a fish that names none: decay of their fastest mode [1/s], and kp / kv [1/s]. RK4 is stable at 2 ms.
_SERVO_DECAY = 1000.0
_SERVO_RATIO = 400.0


@dataclass(frozen=True)
class Trim:
    """Where the mass of every link of a fish in space is, in height.

    Attributes:
        arm: height of the centre of buoyancy above the centre of mass [m]; what rights the fish.
        drop: depth of the centre of mass below the axis of the strips [m]; what lets forces across the fish roll it.
            None: the same, so that the centre of buoyancy is on that axis, in the middle of the sections.
        roll_damping: drag in roll, of that of turning plates (see `mjfish.hydro.spatial_force`).
    """

    arm: float = 0.004
    drop: float | None = None
    roll_damping: float = 1.0

    def __post_init__(self) -> None:
        """Refuse what is no number."""
        for name, value in (("arm", self.arm), ("drop", self.depth)):
            if not math.isfinite(value):
                raise InputError(f"trim: {name} is {value:g} m; expected a finite number; correct it")

    @property
    def depth(self) -> float:
        """The centre of mass is so far below the axis of the strips [m]."""
        return self.arm if self.drop is None else self.drop


def swimmer(
    fish: Fish,
    *,
    values: Mapping[str, float] | None = None,
    free: Trim | None = None,
    step: float = 0.001,
    integrator: Integrator = "RK4",
    coupling: Coupling | None = None,
    loads: Sequence[tuple[Load, Sequence[float]]] = (),
) -> StripFluid:
    """Compile the fish and put it into water; its servos read their commands from userdata (`mjfish.mujoco.rollout`).

    Args:
        fish: the fish.
        values: coefficients by name that replace the fish's.
        free: None: in the plane; else free in space, trimmed like that.
        step: time step [s].
        integrator: of MuJoCo.
        coupling: see `mjfish.mujoco.coupling`; None: the one that is right.
        loads: extra forces on every link in its plane of x and y, with their parameters.

    Returns:
        The water; its `model` is the fish. In space ``qpos[:3]`` is the nose, ``qpos[3:7]`` the head's quaternion.
    """
    specification = prepared(fish, spec(fish, free), step, integrator)
    make_room(specification, memory_of(loads, len(fish.links)))
    return StripFluid(
        compile_aside(specification),
        strips(fish, values, free),
        density=fish.density,
        coupling=coupling,
        commanded=True,
        loads=loads,
    )


def spec(fish: Fish, free: Trim | None = None) -> mujoco.MjSpec:
    """Return the MJCF of the fish without water: hand-written where its body is that of a shipped fish, else built."""
    text = hand_written(fish, free=free is not None)
    found = build(fish, free=free is not None) if text is None else mujoco.MjSpec.from_string(text)
    if free is not None:
        for link in fish.links:
            found.body(link.name).ipos[2] = -free.depth
    return found


def hand_written(fish: Fish, *, free: bool = False) -> str | None:
    """Return the text of the hand-written MJCF of a fish whose body is that of a shipped one, else None."""
    if fish.tail_compliance > 0.0 or fish.name not in fishes.shipped() or _body(fish) != _body(load_fish(fish.name)):
        return None
    try:
        return xml(f"{fish.name}_{'free' if free else 'planar'}.xml").read_text(encoding="utf-8")
    except UnknownNameError:
        return None  # shipped as TOML only


def _body(fish: Fish) -> object:
    return fish.links, fish.sections, fish.servo


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


def prepared(fish: Fish, specification: mujoco.MjSpec, step: float, integrator: Integrator) -> mujoco.MjSpec:
    """Set step, integrator and room for the commands; let the tail give way where it is flexible."""
    if integrator not in INTEGRATORS:
        raise UnknownNameError("integrator", integrator, INTEGRATORS)
    specification.option.timestep = step
    specification.option.integrator = INTEGRATORS[integrator]
    specification.nuserdata = 1 + 3 * fish.joints
    if fish.tail_compliance > 0.0:
        _add_deflection(fish, specification)
    return specification


def _add_deflection(fish: Fish, specification: mujoco.MjSpec) -> None:
    """Let the last link bend back about its joint: a second hinge there, passive, behind the driven one.

    Between the two there is no mass. The driven joint gets an armature, such as the rotor of its servo is: the inertia
    of the link about the joint. Where its motion is prescribed that changes nothing. Its damping is explicit. A joint's
    stiffness by x^2 pulls to one side; x |x| is made of two tendons instead, springs that are slack on one side each.
    """
    last = fish.links[-1]
    specification.joint(f"joint_{fish.joints}").armature += last.inertia + last.mass * last.com**2
    bent = specification.body(last.name).add_joint(name=DEFLECTION, type=mujoco.mjtJoint.mjJNT_HINGE, axis=(0, 0, 1))
    specification.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_EULERDAMP
    bent.stiffness[0], bent.damping[0] = 1.0 / fish.tail_compliance, fish.tail_damping
    bent.stiffness[2] = fish.tail_hardening / fish.tail_compliance
    for name, side in _SIDES if fish.tail_quadratic != 0.0 else ():
        tendon = specification.add_tendon(name=name)
        tendon.wrap_joint(DEFLECTION, side)
        tendon.springlength = (-_SLACK, 0.0)
        tendon.stiffness[1] = fish.tail_quadratic / fish.tail_compliance


def strips(fish: Fish, values: Mapping[str, float] | None = None, free: Trim | None = None) -> tuple[StripLink, ...]:
    """Return the strips of the fish's links; in space each is neutral, with its own centre of buoyancy.

    Args:
        fish: the fish.
        values: coefficients by name that replace the fish's.
        free: None: in the plane; else free in space, trimmed like that.

    Raises:
        UnknownNameError: a name in `values` is no coefficient.
    """
    for name in values or {}:
        if name not in fish.coefficient_names:
            raise UnknownNameError("coefficient", name, fish.coefficient_names)
    coefficients = {**fish.values, **(values or {})}
    links = []
    starts = accumulate((link.length for link in fish.links), initial=0.0)
    for link, start in zip(fish.links, starts, strict=False):
        keys: dict[str, Any] = {kind: float(coefficients[f"{kind}.{link.group}"]) for kind in KINDS}
        if free is not None:
            keys["volume"] = link.mass / fish.density
            keys["buoyancy_center"] = (-link.com, 0.0, free.arm - free.depth)
            keys["roll_damping"] = free.roll_damping
        links.append(
            StripLink(
                body=link.name,
                length=link.length,
                sections=fish.sections,
                start=start,
                munk_moment=fish.munk_moment,
                **keys,
            )
        )
    return tuple(links)


def build(fish: Fish, *, free: bool = False, servo: Servo | None = None) -> mujoco.MjSpec:
    """Build the MJCF of the fish, the same as the hand-written one but for looks; `servo` replaces the fish's."""
    built = _chain(fish, servo or fish.servo or default_servo(fish))
    built.modelname = f"{fish.name}_{'free' if free else 'planar'}"
    head = built.body(fish.links[0].name)
    if not free:
        built.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_GRAVITY
        built.option.gravity = (0.0, 0.0, 0.0)
        head.add_joint(name="x", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=(1, 0, 0))
        head.add_joint(name="y", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=(0, 1, 0))
        head.add_joint(name="yaw", type=mujoco.mjtJoint.mjJNT_HINGE, axis=(0, 0, 1))
        return built
    built.option.gravity = (0.0, 0.0, -GRAVITY)
    head.add_freejoint(name="root")
    for link, outline in zip(fish.links, outlines(fish), strict=True):
        body = built.body(link.name)
        body.inertia = inertia(link, outline)
        body.ipos[2] = -Trim().depth
    return built


def _chain(fish: Fish, servo: Servo) -> mujoco.MjSpec:
    """Build the links with hinges and servos between them; the head has no joint yet. Only I_zz of a link is right."""
    built = mujoco.MjSpec()
    bits = mujoco.mjtDisableBit
    built.compiler.inertiafromgeom = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_FALSE
    built.option.disableflags = bits.mjDSBL_CONTACT | bits.mjDSBL_AUTORESET
    built.worldbody.add_light(pos=(0.0, 0.0, 3.0))
    parent = built.worldbody
    fronts = (0.0, *(link.length for link in fish.links[:-1]))  # lengths of the links in front
    for index, (link, outline, front) in enumerate(zip(fish.links, outlines(fish), fronts, strict=True)):
        parent = _add_link(parent, link, outline, front)
        if index > 0:
            parent.add_joint(name=f"joint_{index}", type=mujoco.mjtJoint.mjJNT_HINGE, axis=(0, 0, 1))
            driven = built.add_actuator(
                name=f"servo_{index}", target=f"joint_{index}", trntype=mujoco.mjtTrn.mjTRN_JOINT
            )
            driven.set_to_position(kp=servo.kp, kv=servo.kv)
    return built


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


def inertia(link: Link, outline: LinkOutline) -> FloatArray:
    """Return I_xx, I_yy, I_zz (3,) about the centre of mass [kg m2] by the rule at the top of this file.

    Where Table I's I_zz is less than that of the sections alone, their mass is drawn in until it is not.
    """
    area = outline.strip_weight * outline.strip_height * outline.strip_width
    high = link.mass * np.average(outline.strip_height**2, weights=area) / 16.0
    wide = link.mass * np.average(outline.strip_width**2, weights=area) / 16.0
    share = min(1.0, link.inertia / wide)
    return np.array([share * (high + wide), link.inertia + share * (high - wide), link.inertia])


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
    kv = _SERVO_DECAY / np.linalg.eigvalsh(np.linalg.inv(inertia)[ROOT:, ROOT:]).max()
    return Servo(kp=_SERVO_RATIO * kv, kv=kv)
