"""Models to prove things on, built from parts: so that a model can be mirrored, turned or described in another way."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any, Literal

import mujoco
import numpy as np

from mjfish.mujoco import StripFluid, mjcf
from mjfish.mujoco.coupling_choice import Coupling
from mjfish.numerics.arrays import FloatArray
from proofs import reference

Joint = Literal["free", "ball", "hinge", "slide", "none"]

#: Of MuJoCo, in the order of the tables.
INTEGRATORS = {name: mjcf.INTEGRATORS[name] for name in ("Euler", "implicitfast", "implicit", "discrete", "RK4")}
#: Every coupling with every integrator that it is right under, where nothing damps.
VALID: tuple[tuple[Coupling, str], ...] = (
    *(("inertia", name) for name in INTEGRATORS),
    ("xfrc", "Euler"),
    ("xfrc", "RK4"),
)
_MIRROR = np.array([1.0, -1.0, 1.0])


@dataclass(frozen=True)
class Part:
    """One body of a tree and the water on it.

    Attributes:
        name: of the body.
        parent: name of the body it hangs on; empty: the world.
        pos, quat: in the parent.
        joint, axis: what it may do against the parent, about its own origin.
        mass, com: [kg], [m] in the body's frame.
        inertia: (3, 3) about the com [kg m2].
        strips: what `StripLink` takes besides the body's name; empty: dry.
        hull: radius of a sphere at the com that touches others [m]; 0: none.
    """

    name: str
    parent: str = ""
    pos: tuple[float, ...] = (0.0, 0.0, 0.0)
    quat: tuple[float, ...] = (1.0, 0.0, 0.0, 0.0)
    joint: Joint = "hinge"
    axis: tuple[float, ...] = (0.0, 0.0, 1.0)
    mass: float = 1.0
    com: tuple[float, ...] = (0.0, 0.0, 0.0)
    inertia: tuple[tuple[float, ...], ...] = ((1e-3, 0.0, 0.0), (0.0, 2e-3, 0.0), (0.0, 0.0, 2e-3))
    strips: tuple[dict[str, Any], ...] = ()
    hull: float = 0.0

    def mirrored(self) -> Part:
        """Return the part as a mirror in the x-z plane shows it; joint angles change sign."""
        w, x, y, z = self.quat
        return replace(
            self,
            pos=_flip(self.pos),
            quat=(w, -x, y, -z),
            axis=_flip(self.axis),
            com=_flip(self.com),
            inertia=tuple(map(tuple, _MIRROR[:, None] * np.array(self.inertia) * _MIRROR)),
            strips=tuple(
                {key: _flip(value) if key in ("origin", "axis", "up") else value for key, value in strip.items()}
                for strip in self.strips
            ),
        )


def _flip(vector: Sequence[float]) -> tuple[float, ...]:
    return tuple(float(x) for x in _MIRROR * np.array(vector))


def spec(parts: Sequence[Part], *, integrator: str = "RK4", step: float = 1e-3) -> mujoco.MjSpec:
    """Return the MJCF of a tree of parts: no gravity, no damping."""
    made = mujoco.MjSpec()
    made.option.integrator = INTEGRATORS[integrator]
    made.option.timestep = step
    made.option.gravity = (0.0, 0.0, 0.0)
    made.compiler.inertiafromgeom = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_FALSE
    bodies = {"": made.worldbody}
    for part in parts:
        i = np.array(part.inertia)
        body = bodies[part.parent].add_body(
            name=part.name,
            pos=part.pos,
            quat=part.quat,
            explicitinertial=True,
            mass=part.mass,
            ipos=part.com,
            fullinertia=[i[0, 0], i[1, 1], i[2, 2], i[0, 1], i[0, 2], i[1, 2]],
        )
        bodies[part.name] = body
        if part.joint == "free":
            body.add_freejoint(name=part.name)
        elif part.joint != "none":
            kind = getattr(mujoco.mjtJoint, f"mjJNT_{part.joint.upper()}")
            body.add_joint(name=part.name, type=kind, axis=part.axis)
        if part.hull:
            body.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[part.hull] * 3, pos=part.com, mass=0.0)
    return made


def with_water(parts: Sequence[Part], **replaced: float) -> tuple[Part, ...]:
    """Return the parts with other coefficients of every link."""
    return tuple(replace(part, strips=tuple({**strip, **replaced} for strip in part.strips)) for part in parts)


def wet(model: mujoco.MjModel, parts: Sequence[Part], coupling: Coupling | None = "inertia") -> StripFluid:
    """Put the water of the parts on a model."""
    return StripFluid(
        model, [{"body": part.name, **strip} for part in parts for strip in part.strips], coupling=coupling
    )


@contextmanager
def plain_water() -> Iterator[None]:
    """Let the water act by the plain callback: coupling ``xfrc``, which asks nobody whether it is right here."""
    mujoco.set_mjcb_control(reference.control)
    try:
        yield
    finally:
        mujoco.set_mjcb_control(None)


def stir(model: mujoco.MjModel, data: mujoco.MjData, seed: int = 7, speed: float = 1.0) -> None:
    """Set a random pose and velocity; angles of joints stay moderate."""
    random = np.random.default_rng(seed)
    mujoco.mj_resetData(model, data)
    mujoco.mj_integratePos(model, data.qpos, 0.8 * random.normal(size=model.nv), 1.0)
    data.qvel[:] = speed * random.normal(size=model.nv)


def states(model: mujoco.MjModel, data: mujoco.MjData, count: int, speed: float = 1.0) -> Iterator[int]:
    """Stir `data` anew, `count` times."""
    for seed in range(count):
        stir(model, data, seed, speed)
        yield seed


def relative(found: FloatArray, expected: FloatArray) -> float:
    """Return the largest difference, as a part of the largest number."""
    return float(np.abs(found - expected).max() / np.abs(expected).max())
