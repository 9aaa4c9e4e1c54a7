"""Drag coefficients that depend on the Reynolds number."""

from __future__ import annotations

from typing import Any

import numpy as np

from mjfish.effects.calibration import TOW_TEST
from mjfish.effects.effect import Effect, Fingerprint
from mjfish.hydro.load import load
from mjfish.parameters import Parameter

#: Speed at which `friction` and `pressure` are the relative increase of the coefficients [m/s].
REFERENCE_SPEED = 0.3


@load
def _excess(link: Any, parameters: Any) -> tuple[float, float, float]:
    """Excess over the constant coefficients: c a sqrt(U_0 / |q|) in place of c, strip by strip."""
    friction = parameters[0]
    pressure = parameters[1]
    along = friction * link.c_f * link.wetted * np.sqrt(REFERENCE_SPEED * abs(link.u)) * link.u
    across = 0.0
    moment = 0.0
    if pressure != 0.0:
        for k in range(link.strip_r.shape[0]):
            r = link.strip_r[k]
            q = link.v + link.w * r
            share = link.strip_weight[k] * link.strip_height[k] * np.sqrt(REFERENCE_SPEED * abs(q)) * q
            across += share
            moment += share * r
        across *= pressure * link.c_d
        moment *= pressure * link.c_d
    return -0.5 * link.density * along, -0.5 * link.density * across, -0.5 * link.density * moment


class ReynoldsDrag(Effect):
    """Coefficients rise at low Reynolds number: c(Re) = c (1 + a (Re_0 / Re)^(1/2)).

    Re goes with the local speed, |u| along and |q| across; Re_0 belongs to a speed of 0.3 m/s. `friction` is a for
    c_f, `pressure` for c_d. The exponent 1/2 is that of a laminar boundary layer (Blasius).
    """

    name, domain, mechanism = "reynolds_drag", "water", "drag_law"
    summary = "drag coefficients depend on the Reynolds number"
    parameters = (
        Parameter("reynolds_drag.friction", "-", 0.0, 0.0, 20.0, 0.0, 0.2, about="relative rise of c_f at 0.3 m/s"),
        Parameter("reynolds_drag.pressure", "-", 0.0, 0.0, 20.0, 0.0, 0.2, about="relative rise of c_d at 0.3 m/s"),
    )
    source = "[Yu2016] sec. V-B; Schlichting, Boundary-Layer Theory (1979), ch. VII"
    signature = "forward speed against beat frequency is bent; start-ups are slower than simulated"
    confirm = "swim at more and lower beat frequencies, or tow the stretched fish at several speeds"
    fingerprint = Fingerprint(exponent=-0.5, odd=False, part="everywhere")
    calibration = TOW_TEST
    resembles = ("design-short",)
    load = _excess
