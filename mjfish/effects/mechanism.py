"""Mechanisms: where something acts and on which variables it depends. A form is a function of these.

Several causes of the catalogue may be forms of one mechanism. A cause of a user's own that names none is a mechanism by
itself.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Domain = Literal["data", "drive", "body", "water", "out_of_plane"]


@dataclass(frozen=True)
class Mechanism:
    """What acts, whatever its form.

    Attributes:
        name: of the mechanism.
        domain: where it acts.
        summary: one line.
        variables: on which it depends.
    """

    name: str
    domain: Domain
    summary: str
    variables: str


_ALL = (
    Mechanism("clock", "data", "the camera's clock is off", "-"),
    Mechanism("camera_scale", "data", "the camera's scale is off", "-"),
    Mechanism("camera_axes", "data", "the camera's axes are turned", "-"),
    Mechanism("camera_tilt", "data", "the camera does not look straight down", "place"),
    Mechanism("lens", "data", "the camera's lens bends lines", "place"),
    Mechanism("tracked_point", "data", "another point is tracked", "-"),
    Mechanism("clock_wander", "drive", "the clock of the drive wanders at random", "-"),
    Mechanism("servo_dynamics", "drive", "the joints follow their command late", "command and its rate"),
    Mechanism("servo_limit", "drive", "the joints end at other angles than they are told", "command"),
    Mechanism("servo_play", "drive", "the gears have play", "command"),
    Mechanism("joint_zero", "drive", "the zeros of the joints are off", "-"),
    Mechanism("mass_distribution", "body", "masses lie elsewhere", "-"),
    Mechanism("trim", "body", "a moment turns the fish to one side", "speed"),
    Mechanism("tail_flexibility", "body", "the tail bends", "deflection and its rate"),
    Mechanism("drag_law", "water", "drag is another function of the speed", "local speed, height"),
    Mechanism("lift", "water", "links have lift", "angle of attack, speed"),
    Mechanism("reactive_force", "water", "the added momentum acts otherwise", "added momentum, speed along"),
    Mechanism("added_mass", "water", "the added mass is another", "sections, amplitude"),
    Mechanism("wake_memory", "water", "the water's force depends on the past", "past of the force"),
    Mechanism("current", "water", "the water moves", "place, time"),
    Mechanism("walls", "water", "walls are near", "place"),
    Mechanism("roll", "out_of_plane", "the fish rolls", "side force"),
)
#: By name.
MECHANISMS = {mechanism.name: mechanism for mechanism in _ALL}


def without_form(name: str) -> bool:
    """Return whether a mechanism is known to depend on nothing: it is a few numbers, and has no other form."""
    return name in MECHANISMS and MECHANISMS[name].variables == "-"
