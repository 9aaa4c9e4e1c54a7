"""Circulatory lift of the caudal fin."""

from __future__ import annotations

from typing import Any

from mjfish.effects.calibration import TOW_TEST
from mjfish.effects.effect import Effect, Fingerprint
from mjfish.fish.outline import INTERVALS
from mjfish.hydro.load import load
from mjfish.parameters import Parameter


@load
def _lift(link: Any, parameters: Any) -> tuple[float, float, float]:
    """Return the lift of the last link, none of the others."""
    if link.last == 0.0:
        return 0.0, 0.0, 0.0
    area = link.height_moment[INTERVALS, 0]
    downwash = link.v + 0.75 * link.length * link.w
    force = -0.5 * link.density * parameters[0] * area * abs(link.u) * downwash
    return 0.0, force, 0.25 * link.length * force


class FinLift(Effect):
    """The last link is a foil in a stream: fy = -1/2 rho S C |u| q(3/4 l), acting at l/4 behind its joint.

    Quasi-steady thin-foil theory: the Kutta condition sets the circulation by the sideways velocity q = v + w r at
    three quarters of the chord, the force acts at one quarter. S = INT h dr is the area and C the slope of the lift
    coefficient: 2 pi of a foil of infinite span, 2 pi / (1 + 2 / A) at an aspect ratio A. The force is normal to the
    chord: no suction at the leading edge, which lies behind the body. Neither added mass nor crossflow drag has it: it
    is their cross term in the speed along and across.
    """

    name, domain, mechanism = "fin_lift", "water", "lift"
    summary = "the caudal fin has circulatory lift"
    parameters = (Parameter("fin_lift.slope", "-", 0.0, 0.0, 8.0, 0.0, 0.05, about="C, slope of the lift coefficient"),)
    source = "Katz, Plotkin, Low-Speed Aerodynamics (2001), ch. 5 and sec. 13.8: thin foil, quasi-steady"
    signature = "sway and yaw rate of the beat, growing with forward speed; little at rest"
    confirm = "hold the fin at small angles in a stream and measure its side force against the angle"
    fingerprint = Fingerprint(exponent=0.0, odd=False, part="everywhere")
    calibration = TOW_TEST
    load = _lift
