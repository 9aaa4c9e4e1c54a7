"""What the MuJoCo models of a fish share, planar or free: hand-written files, the chain of links, servos, strips."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Literal

import mujoco
import numpy as np

from mjfish import fish as fishes
from mjfish.errors import UnknownNameError
from mjfish.fish import COEFFICIENTS, KINDS, Fish, Link, Servo, load_fish
from mjfish.hydro.outline import LinkOutline, outlines
from mjfish.mujoco.strip_link import StripLink

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


def written(fish: Fish, kind: Literal["planar", "free"]) -> mujoco.MjSpec | None:
    """Return the hand-written MJCF of a fish whose body is that of a shipped one, else None."""
    text = hand_written(fish, kind)
    return None if text is None else mujoco.MjSpec.from_string(text)


def hand_written(fish: Fish, kind: Literal["planar", "free"]) -> str | None:
    """Return the text of that MJCF, else None."""
    if fish.tail_compliance > 0.0 or fish.name not in fishes.shipped() or _body(fish) != _body(load_fish(fish.name)):
        return None
    try:
        return xml(f"{fish.name}_{kind}.xml").read_text(encoding="utf-8")
    except UnknownNameError:
        return None  # shipped as TOML only


def _body(fish: Fish) -> object:
    return fish.links, fish.sections, fish.servo


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
    of the link about the joint. Where its motion is prescribed that changes nothing. Its damping is explicit.
    """
    last = fish.links[-1]
    driven = specification.joint(f"joint_{fish.joints}")
    driven.armature += last.inertia + last.mass * last.com**2
    bent = specification.body(last.name).add_joint(name=DEFLECTION, type=mujoco.mjtJoint.mjJNT_HINGE, axis=(0, 0, 1))
    specification.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_EULERDAMP
    bent.stiffness[0], bent.damping[0] = 1.0 / fish.tail_compliance, fish.tail_damping


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


def chain(fish: Fish, servo: Servo) -> mujoco.MjSpec:
    """Build the links with hinges and servos between them; the head has no joint yet. Only I_zz of a link is right."""
    made = mujoco.MjSpec()
    made.compiler.inertiafromgeom = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_FALSE
    bits = mujoco.mjtDisableBit
    made.option.disableflags = bits.mjDSBL_CONTACT | bits.mjDSBL_AUTORESET
    made.worldbody.add_light(pos=(0.0, 0.0, 3.0))
    parent = made.worldbody
    front = 0.0  # length of the link in front
    for index, (link, outline) in enumerate(zip(fish.links, outlines(fish), strict=True)):
        parent = _add_link(parent, link, outline, front)
        if index > 0:
            parent.add_joint(name=f"joint_{index}", type=mujoco.mjtJoint.mjJNT_HINGE, axis=(0, 0, 1))
            _add_servo(made, index, servo)
        front = link.length
    return made


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


def _add_servo(made: mujoco.MjSpec, index: int, servo: Servo) -> None:
    actuator = made.add_actuator(name=f"servo_{index}", target=f"joint_{index}", trntype=mujoco.mjtTrn.mjTRN_JOINT)
    actuator.set_to_position(kp=servo.kp, kv=servo.kv)
