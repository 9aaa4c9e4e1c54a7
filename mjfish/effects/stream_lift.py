"""Lift of the caudal fin across the stream."""

from __future__ import annotations

from typing import Any

import numpy as np

from mjfish.effects.calibration import TOW_TEST
from mjfish.effects.effect import Effect, Fingerprint
from mjfish.fish.outline import INTERVALS
from mjfish.hydro.load import load
from mjfish.parameters import Parameter

#: Where the velocity is taken and the force acts, in chords behind the joint.
_DOWNWASH, _CENTRE = 0.75, 0.25


@load
def _lift(link: Any, parameters: Any) -> tuple[float, float, float]:
    """Return the lift of the last link, none of the others."""
    if link.last == 0.0:
        return 0.0, 0.0, 0.0
    u = link.u
    q = link.v + _DOWNWASH * link.length * link.w
    speed = np.sqrt(u * u + q * q) + 1e-12
    lift = 0.5 * link.density * link.height_moment[INTERVALS, 0] * parameters[0] * abs(u) * q / speed
    fx = lift * q if u > 0.0 else -lift * q
    fy = -lift * abs(u)
    return fx, fy, _CENTRE * link.length * fy


class StreamLift(Effect):
    """The last link has a lift across the stream: L = 1/2 rho S V^2 (C / 2) sin 2 alpha.

    alpha is the angle of attack and V the velocity at three quarters of the chord; the force acts at one quarter. It
    takes no power, unlike the force across the chord of a foil without suction at its leading edge. At small angles
    both are the same.
    """

    name, domain, mechanism = "stream_lift", "water", "lift"
    summary = "the caudal fin has lift across the stream"
    parameters = (
        Parameter("stream_lift.slope", "-", 0.0, 0.0, 8.0, 0.0, 0.05, about="C, slope of the lift at small angles"),
    )
    source = "Hoerner and Borst, Fluid-Dynamic Lift (1975), ch. 3 and 17: plates to 90 degrees"
    signature = "sway, yaw rate and thrust of the beat, growing with forward speed; little at rest"
    confirm = "hold the fin in a stream and measure its force along and across it against the angle"
    fingerprint = Fingerprint(exponent=0.0, odd=False, part="everywhere")
    calibration = TOW_TEST
    load = _lift
