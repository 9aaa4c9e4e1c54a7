"""Lift of the links in front of the caudal fin."""

from __future__ import annotations

from typing import Any

from mjfish.effects.calibration import TOW_TEST
from mjfish.effects.effect import Effect, Fingerprint
from mjfish.fish.outline import INTERVALS
from mjfish.hydro.load import load
from mjfish.parameters import Parameter


@load
def _lift(link: Any, parameters: Any) -> tuple[float, float, float]:
    """Return the lift of a link, none of the last."""
    if link.last == 1.0:
        return 0.0, 0.0, 0.0
    arm = 0.5 * link.length
    force = (
        -0.5 * link.density * parameters[0] * link.height_moment[INTERVALS, 0] * abs(link.u) * (link.v + arm * link.w)
    )
    return 0.0, force, arm * force


class BodyLift(Effect):
    """Every link but the last has lift: fy = -1/2 rho S C |u| q, S its area from the side, at its middle.

    The linear part of the normal force of a body at a small angle of attack; the crossflow drag is the quadratic part.
    """

    name, domain, mechanism = "body_lift", "water", "lift"
    summary = "the body has lift"
    parameters = (Parameter("body_lift.slope", "-", 0.0, 0.0, 8.0, 0.0, 0.05, about="C, slope of the normal force"),)
    source = "Hoerner and Borst, Fluid-Dynamic Lift (1975), ch. 19: streamline bodies"
    signature = "sway and yaw rate of the beat are damped, more so the faster it swims; little at rest"
    confirm = "tow the stretched fish at small angles and measure its side force against the angle"
    fingerprint = Fingerprint(exponent=0.0, odd=False, part="everywhere")
    calibration = TOW_TEST
    load = _lift
