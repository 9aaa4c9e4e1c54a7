"""Lift learned from the data: forces of fin and body by the angle of attack."""

from __future__ import annotations

from typing import Any

import numpy as np

from mjfish.effects.calibration import TOW_TEST
from mjfish.effects.effect import Effect, Fingerprint
from mjfish.fish.outline import INTERVALS
from mjfish.hydro.load import load
from mjfish.parameters import Parameter
from mjfish.parameters.prior import Prior


@load
def _force(link: Any, parameters: Any) -> tuple[float, float, float]:
    """Return the force on a link: across its stream, and across its chord."""
    first, second, third, normal = parameters[0], parameters[1], parameters[2], parameters[3]
    place, downwash = parameters[4], parameters[5]
    if link.last == 0.0:
        first, second, third, normal = parameters[6], 0.0, 0.0, parameters[7]
        place, downwash = parameters[8], parameters[9]
    u = link.u
    q = link.v + downwash * link.length * link.w
    square = u * u + q * q + 1e-18
    speed = np.sqrt(square)
    half = 0.5 * link.density * link.height_moment[INTERVALS, 0]
    cosine = (u * u - q * q) / square  # of 2 alpha
    lift = half * (first + cosine * second + third * (4.0 * cosine * cosine - 1.0) / 3.0) * abs(u) * q / speed
    fx = lift * q if u > 0.0 else -lift * q
    fy = -lift * abs(u) - half * normal * abs(u) * q
    return fx, fy, place * link.length * fy


class Lift(Effect):
    """Fin and body have forces that are odd functions of their angle of attack, learned.

    With the velocity V of a point of the chord and its angle of attack alpha,

        across the stream   L = 1/2 rho S V^2 C_L(alpha)
                            C_L = (a_1 / 2) sin 2 alpha + (a_2 / 4) sin 4 alpha + (a_3 / 6) sin 6 alpha
        across the chord    N = 1/2 rho S V^2 (b / 2) sin 2 alpha

    C_L is odd and zero at 0 and 90 degrees, and takes no power; N takes power for b >= 0. The fin has a_1, a_2, a_3, b,
    the place where its force acts and that of its velocity; the links of the body have a_1 and b, and such places.
    """

    name, domain, mechanism = "lift", "water", "lift"
    learned = True
    summary = "fin or body have lift, learned"
    parameters = (
        Parameter("lift.fin_1", "-", 0.0, -8.0, 12.0, 0.0, 0.05, about="a_1 of the fin"),
        Parameter("lift.fin_2", "-", 0.0, -8.0, 8.0, 0.0, 0.05, about="a_2 of the fin"),
        Parameter("lift.fin_3", "-", 0.0, -8.0, 8.0, 0.0, 0.05, about="a_3 of the fin"),
        Parameter("lift.fin_normal", "-", 0.0, -2.0, 12.0, 0.0, 0.05, about="b of the fin"),
        Parameter("lift.place", "-", 0.25, 0.0, 1.0, 0.25, 0.1, about="of the fin's force, in chords", shape=True),
        Parameter("lift.downwash", "-", 0.75, 0.0, 1.0, 0.75, 0.1, about="of the velocity, in chords", shape=True),
        Parameter("lift.body_1", "-", 0.0, -8.0, 8.0, 0.0, 0.05, about="a_1 of the body"),
        Parameter("lift.body_normal", "-", 0.0, -2.0, 8.0, 0.0, 0.05, about="b of the body"),
        Parameter("lift.body_place", "-", 0.5, 0.0, 1.0, 0.5, 0.1, about="of a link's force, in chords", shape=True),
        Parameter("lift.body_downwash", "-", 0.5, 0.0, 1.0, 0.5, 0.1, about="of its velocity, in chords", shape=True),
    )
    source = "Hoerner and Borst, Fluid-Dynamic Lift (1975), ch. 3, 17 and 19"
    signature = "sway and yaw rate of the beat, growing with forward speed; little at rest"
    confirm = "hold the fin in a stream and measure its force along and across it against the angle"
    fingerprint = Fingerprint(exponent=0.0, odd=False, part="everywhere")
    calibration = TOW_TEST
    load = _force

    def priors(self) -> tuple[Prior, ...]:
        """Slopes of lift are of the order of those of foils; further harmonics are smaller."""
        names = tuple(f"lift.{short}" for short in ("fin_1", "fin_normal", "body_1", "body_normal"))
        return Prior("lift.slopes", names, np.eye(4), 4.0), Prior(
            "lift.harmonics", ("lift.fin_2", "lift.fin_3"), np.eye(2), 2.0
        )
