"""Drag by another power of the speed than the square."""

from __future__ import annotations

from typing import Any

import numpy as np

from mjfish.effects.calibration import TOW_TEST
from mjfish.effects.effect import Effect, Fingerprint
from mjfish.hydro.load import load
from mjfish.parameters import Parameter

#: Speed at which the coefficients are those of the fish [m/s].
REFERENCE_SPEED = 0.3
#: A slower strip counts as this fast in the factor [m/s]: a power below zero has no value at rest.
_SLOWEST = 1e-4


@load
def _excess(link: Any, parameters: Any) -> tuple[float, float, float]:
    """Excess over quadratic drag: c ((V / U_0)^n - 1) in place of c, strip by strip."""
    friction = parameters[0]
    pressure = parameters[1]
    factor = np.exp(friction * np.log(max(abs(link.u), _SLOWEST) / REFERENCE_SPEED)) - 1.0
    along = factor * link.c_f * link.wetted * abs(link.u) * link.u
    across = 0.0
    moment = 0.0
    for k in range(link.coarse_r.shape[0]):
        r = link.coarse_r[k]
        q = link.v + link.w * r
        factor = np.exp(pressure * np.log(max(abs(q), _SLOWEST) / REFERENCE_SPEED)) - 1.0
        share = link.coarse_weight[k] * link.coarse_height[k] * factor * abs(q) * q
        across += share
        moment += share * r
    half = -0.5 * link.density
    return half * along, half * link.c_d * across, half * link.c_d * moment


class PowerDrag(Effect):
    """Drag goes as the speed to another power: c(V) = c (V / U_0)^n, V = |u| along and |q| across, U_0 = 0.3 m/s.

    n = 0 is quadratic drag, n = -1/2 that of a laminar boundary layer, n = -1/5 of a turbulent one, n = -1 linear drag.
    The level of c is one with the coefficient of the fish; what is left of n shows between speeds, and steady runs of
    one beat frequency have one.
    """

    name, domain, mechanism = "power_drag", "water", "drag_law"
    summary = "drag goes as the speed to another power than two"
    parameters = (
        Parameter("power_drag.friction", "-", 0.0, -0.95, 1.5, 0.0, 0.1, about="n of c_f"),
        Parameter("power_drag.pressure", "-", 0.0, -0.95, 1.5, 0.0, 0.1, about="n of c_d"),
    )
    source = "Schlichting, Boundary-Layer Theory (1979), ch. VII and XXI"
    signature = "forward speed against beat frequency is bent; start-ups differ from steady swimming"
    confirm = "tow the stretched fish at several speeds: the slope of the logarithms is no 2"
    #: No power of the frequency: for a small n the excess goes as n ln(V / U_0), and its zero is where U_0 was put.
    fingerprint = Fingerprint(exponent=None, odd=False, part="everywhere")
    calibration = TOW_TEST
    resembles = ("design-short", "design-one-frequency")
    load = _excess
