"""Munk moment of the added mass."""

from __future__ import annotations

from typing import ClassVar

from mjfish.effects.calibration import TOW_TEST, Calibration
from mjfish.effects.effect import Effect, Fingerprint, Values
from mjfish.effects.mechanism import Domain
from mjfish.fish import Fish
from mjfish.parameter import Parameter


class MunkMoment(Effect):
    """The moment -kappa u p_y of the added momentum p_y = INT m_a (v + r w) dr about a link's joint.

    A Morison slice does not have it (kappa = 0); Kirchhoff's equations of a body in an ideal fluid do (kappa = 1):
    a slender body in oblique motion is turned broadside.
    """

    name: ClassVar[str] = "munk_moment"
    domain: ClassVar[Domain] = "water"
    mechanism: ClassVar[str] = "reactive_force"
    summary: ClassVar[str] = "the added mass turns the links broadside (Munk moment)"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("munk_moment.kappa", "-", 0.0, -1.0, 2.0, 0.0, 0.2, about="share of the Munk moment"),
    )
    source: ClassVar[str] = "Lamb, Hydrodynamics (1932), art. 124; Munk, NACA report 184 (1924)"
    signature: ClassVar[str] = "yaw rate and sway, growing with forward speed times sideways speed; none at rest"
    confirm: ClassVar[str] = "tow the fish, joints held, at a small angle and measure the yaw moment against speed"
    fingerprint: ClassVar[Fingerprint] = Fingerprint(exponent=0.0, odd=False, part="everywhere")
    calibration: ClassVar[Calibration | None] = TOW_TEST
    resembles: ClassVar[tuple[str, ...]] = ("design-no-turn",)

    def body(self, fish: Fish, values: Values) -> Fish:
        """Add kappa to the fish's own share."""
        return fish.model_copy(update={"munk_moment": fish.munk_moment + values["kappa"]})
