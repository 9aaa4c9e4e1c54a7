"""The MuJoCo model of a fish that is free in space: gravity and buoyancy, roll, pitch and heave.

Table I of [Yu2016] has the moment of inertia about z only. The others are those of a body whose mass is spread evenly
over its ellipse sections and along x so that I_zz comes out right: with a, b the half axes and < > the mean over the
volume,

    I_xx = m <a^2 + b^2> / 4      I_yy = I_zz + m (<a^2> - <b^2>) / 4

Each link is trimmed neutral for itself: it displaces its mass of water, whatever its outline (ballast is assumed), and
its centre of buoyancy is straight above its centre of mass. So the fish hovers level in every shape.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from mjfish.arrays import FloatArray
from mjfish.errors import InputError
from mjfish.fish import Fish, Link, Servo
from mjfish.hydro.load import Load
from mjfish.hydro.outline import LinkOutline, outlines
from mjfish.mujoco import mjcf
from mjfish.mujoco.compatible import Coupling
from mjfish.mujoco.fluid import StripFluid
from mjfish.mujoco.layout import compile_aside
from mjfish.mujoco.mjcf import Integrator
from mjfish.mujoco.planar import default_servo
from mjfish.mujoco.strip_link import StripLink

#: Of the earth [m/s2].
GRAVITY = 9.81


@dataclass(frozen=True)
class Trim:
    """Where the mass of every link is, in height.

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
                raise InputError(f"trim: {name} is {value:g} m; expected a finite number")

    @property
    def depth(self) -> float:
        """The centre of mass is so far below the axis of the strips [m]."""
        return self.arm if self.drop is None else self.drop


def swimmer(
    fish: Fish,
    *,
    values: Mapping[str, float] | None = None,
    trim: Trim | None = None,
    step: float = 0.001,
    integrator: Integrator = "RK4",
    coupling: Coupling | None = None,
    loads: Sequence[tuple[Load, Sequence[float]]] = (),
) -> StripFluid:
    """Compile the fish and put it into water, as `mjfish.mujoco.planar.swimmer` does, but free in space.

    Args:
        fish: the fish.
        values: coefficients by name that replace the fish's.
        trim: where its mass is, in height; None: as `Trim` has it.
        step: time step [s].
        integrator: of MuJoCo.
        coupling: see `mjfish.mujoco.coupling`; None: the one that is right.
        loads: extra forces on every link in its plane of x and y, with their parameters.

    Returns:
        The water; its `model` is the fish. ``qpos[:3]`` is the nose, ``qpos[3:7]`` the head's quaternion.
    """
    trim = trim or Trim()
    specification = mjcf.prepared(fish, spec(fish, trim), step, integrator)
    return StripFluid(
        compile_aside(specification),
        strips(fish, values, trim),
        density=fish.density,
        coupling=coupling,
        commanded=True,
        loads=loads,
    )


def strips(fish: Fish, values: Mapping[str, float] | None = None, trim: Trim | None = None) -> tuple[StripLink, ...]:
    """Return the strips of the fish's links, each neutral: of its own volume, at its own centre of buoyancy."""
    trim = trim or Trim()
    return tuple(
        StripLink(
            **{
                **dict(strip),
                "volume": link.mass / fish.density,
                "buoyancy_center": (-link.com, 0.0, trim.arm - trim.depth),
                "roll_damping": trim.roll_damping,
            }
        )
        for link, strip in zip(fish.links, mjcf.strips(fish, values), strict=True)
    )


def spec(fish: Fish, trim: Trim | None = None) -> mujoco.MjSpec:
    """Return the MJCF of the fish without water: hand-written where its body is that of a shipped fish, else built."""
    trim = trim or Trim()
    made = mjcf.written(fish, "free") or build(fish)
    for link in fish.links:
        made.body(link.name).ipos[2] = -trim.depth
    return made


def build(fish: Fish, servo: Servo | None = None) -> mujoco.MjSpec:
    """Build the MJCF of the fish, the same as the hand-written one but for looks; `servo` replaces the fish's."""
    made = mjcf.chain(fish, servo or fish.servo or default_servo(fish))
    made.modelname = f"{fish.name}_free"
    made.option.gravity = (0.0, 0.0, -GRAVITY)
    made.body(fish.links[0].name).add_freejoint(name="root")
    for link, outline in zip(fish.links, outlines(fish), strict=True):
        body = made.body(link.name)
        body.inertia = inertia(link, outline)
        body.ipos[2] = -Trim().depth
    return made


def inertia(link: Link, outline: LinkOutline) -> FloatArray:
    """Return I_xx, I_yy, I_zz (3,) about the centre of mass [kg m2] by the rule above.

    Where Table I's I_zz is less than that of the sections alone, their mass is drawn in until it is not.
    """
    area = outline.strip_weight * outline.strip_height * outline.strip_width
    high = link.mass * np.average(outline.strip_height**2, weights=area) / 16.0
    wide = link.mass * np.average(outline.strip_width**2, weights=area) / 16.0
    share = min(1.0, link.inertia / wide)
    return np.array([share * (high + wide), link.inertia + share * (high - wide), link.inertia])
