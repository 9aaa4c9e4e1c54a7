"""Drag coefficients that fall exponentially with the Reynolds number."""

from __future__ import annotations

from typing import Any

import numpy as np

from mjfish.effects.calibration import TOW_TEST
from mjfish.effects.effect import Effect, Fingerprint
from mjfish.hydro.load import load
from mjfish.parameters import Parameter

#: Kinematic viscosity of water at 20 C [m2/s].
VISCOSITY = 1.0e-6


@load
def _excess(link: Any, parameters: Any) -> tuple[float, float, float]:
    """Excess over the constant coefficients: c a exp(-Re / Re_0), Re = V h / nu of a strip's whole speed."""
    friction = parameters[0]
    pressure = parameters[1]
    decay = 1.0 / (1e3 * parameters[2] * VISCOSITY)
    u = link.u
    along = 0.0
    across = 0.0
    moment = 0.0
    for k in range(link.coarse_r.shape[0]):
        r = link.coarse_r[k]
        q = link.v + link.w * r
        height = link.coarse_height[k]
        rise = np.exp(-decay * height * np.sqrt(u * u + q * q))
        along += link.coarse_weight[k] / link.length * rise
        share = link.coarse_weight[k] * height * rise * abs(q) * q
        across += share
        moment += share * r
    half = -0.5 * link.density
    along *= friction * link.c_f * link.wetted * abs(u) * u
    pressure *= half * link.c_d
    return half * along, pressure * across, pressure * moment


class ExponentialDrag(Effect):
    """Coefficients rise at low Reynolds number: c(Re) = c (1 + a exp(-Re / Re_0)), Re = V h / nu.

    V is the whole speed of a strip and h its height; `friction` is a for c_f, `pressure` for c_d.
    """

    name, domain, mechanism = "exponential_drag", "water", "drag_law"
    summary = "drag coefficients fall exponentially with the Reynolds number"
    parameters = (
        Parameter("exponential_drag.friction", "-", 0.0, 0.0, 20.0, 0.0, 0.2, about="relative rise of c_f at rest"),
        Parameter("exponential_drag.pressure", "-", 0.0, 0.0, 20.0, 0.0, 0.2, about="relative rise of c_d at rest"),
        Parameter("exponential_drag.reynolds", "1e3", 30.0, 1.0, 300.0, 30.0, 10.0, about="Re_0", shape=True),
    )
    source = "Hoerner, Fluid-Dynamic Drag (1965), ch. 3: drag of bluff sections against Reynolds number"
    signature = "too slow at low beat frequency and at start-ups, right where it swims fast"
    confirm = "swim at more and lower beat frequencies, or tow the stretched fish at several speeds"
    #: The exponent is that of the default Re_0; the smaller Re_0, the steeper.
    fingerprint = Fingerprint(exponent=-2.5, odd=False, part="everywhere")
    calibration = TOW_TEST
    resembles = ("design-short",)
    load = _excess
