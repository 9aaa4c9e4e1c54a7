"""Munk moment of the added mass."""

from __future__ import annotations

from mjfish.effects.calibration import TOW_TEST
from mjfish.effects.effect import Effect, Fingerprint, Values
from mjfish.fish import Fish
from mjfish.parameters import Parameter


class MunkMoment(Effect):
    """The moment -kappa u p_y of the added momentum p_y = INT m_a (v + r w) dr about a link's joint.

    A Morison slice does not have it (kappa = 0); Kirchhoff's equations of a body in an ideal fluid do (kappa = 1):
    a slender body in oblique motion is turned broadside.
    """

    name, domain, mechanism = "munk_moment", "water", "reactive_force"
    summary = "the added mass turns the links broadside (Munk moment)"
    parameters = (Parameter("munk_moment.kappa", "-", 0.0, -1.0, 2.0, 0.0, 0.2, about="share of the Munk moment"),)
    source = "Lamb, Hydrodynamics (1932), art. 124; Munk, NACA report 184 (1924)"
    signature = "yaw rate and sway, growing with forward speed times sideways speed; none at rest"
    confirm = "tow the fish, joints held, at a small angle and measure the yaw moment against speed"
    fingerprint = Fingerprint(exponent=0.0, odd=False, part="everywhere")
    calibration = TOW_TEST
    resembles = ("design-no-turn",)

    def body(self, fish: Fish, values: Values) -> Fish:
        """Add kappa to the fish's own share."""
        return fish.model_copy(update={"munk_moment": fish.munk_moment + values["kappa"]})
