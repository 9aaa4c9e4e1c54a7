"""Momentum that the trailing edge sheds into the wake."""

from __future__ import annotations

from typing import Any

import numpy as np

from mjfish.effects.calibration import TOW_TEST
from mjfish.effects.effect import Effect, Fingerprint
from mjfish.fish.outline import INTERVALS
from mjfish.hydro.load import load
from mjfish.parameters import Parameter


@load
def _shed(link: Any, parameters: Any) -> tuple[float, float, float]:
    """Return a share of the momentum shed at the end of the last link, none of the others."""
    if link.last == 0.0:
        return 0.0, 0.0, 0.0
    height = link.node_height[INTERVALS]
    mass = parameters[0] * link.c_m * link.density * 0.25 * np.pi * height * height
    q = link.v + link.w * link.length
    fy = mass * link.u * q if link.u < 0.0 else 0.0
    return -0.5 * mass * q * q, fy, link.length * fy


class EdgeMomentum(Effect):
    """A share psi of the added momentum at the trailing edge is left in the wake [Lighthill1971].

        fx = -psi m q^2 / 2,   fy = psi m q u,   m = c_m rho pi h^2 / 4 and q = v + w l at the end of the last link

    u is the speed along the link towards its end, negative where the fish swims forward; backwards nothing is shed to
    the side. Strips of added mass alone keep all momentum with the body.

    [Lighthill1971] J. Lighthill, Large-amplitude elongated-body theory of fish locomotion, Proc. R. Soc. B 179.
    """

    name, domain, mechanism = "edge_momentum", "water", "reactive_force"
    summary = "the trailing edge sheds momentum into the wake"
    parameters = (
        Parameter("edge_momentum.share", "-", 0.0, -0.5, 2.0, 0.0, 0.05, about="psi, of the momentum that is shed"),
    )
    source = "Lighthill, Proc. R. Soc. B 179 (1971): elongated-body theory of large amplitude"
    signature = "thrust and sway of the beat; side force of the tail grows with forward speed"
    confirm = "tow the fish while it beats, and measure its side force against the speed"
    fingerprint = Fingerprint(exponent=0.0, odd=False, part="everywhere")
    calibration = TOW_TEST
    load = _shed
