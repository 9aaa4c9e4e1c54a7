"""Drag that goes with the whole speed of a strip."""

from __future__ import annotations

from typing import Any

import numpy as np

from mjfish.effects.calibration import TOW_TEST
from mjfish.effects.effect import Effect, Fingerprint
from mjfish.hydro.load import load
from mjfish.parameters import Parameter


@load
def _excess(link: Any, parameters: Any) -> tuple[float, float, float]:
    """Excess over the crossflow principle: (V - |q|) q and (V - |u|) u, V = sqrt(u^2 + q^2)."""
    u = link.u
    middle = link.v + 0.5 * link.length * link.w
    along = parameters[0] * link.c_f * link.wetted * (np.sqrt(u * u + middle * middle) - abs(u)) * u
    across = 0.0
    moment = 0.0
    for k in range(link.coarse_r.shape[0]):
        r = link.coarse_r[k]
        q = link.v + link.w * r
        share = link.coarse_weight[k] * link.coarse_height[k] * (np.sqrt(u * u + q * q) - abs(q)) * q
        across += share
        moment += share * r
    half = -0.5 * link.density
    pressure = half * parameters[1] * link.c_d
    return half * along, pressure * across, pressure * moment


class WholeSpeedDrag(Effect):
    """Drag across goes as |V| q in place of |q| q, and friction as |V| u in place of |u| u, V the whole velocity.

    The crossflow principle takes the flow along a section not to matter for the drag across it, which holds of laminar
    flow around infinite cylinders. A share psi of the other extreme is added: psi (V - |q|) q, psi (V - |u|) u.
    """

    name, domain, mechanism = "whole_speed_drag", "water", "drag_law"
    summary = "drag goes with the whole speed, not with that across or along"
    parameters = (
        Parameter("whole_speed_drag.friction", "-", 0.0, 0.0, 2.0, 0.0, 0.2, about="psi of the friction along"),
        Parameter("whole_speed_drag.pressure", "-", 0.0, 0.0, 2.0, 0.0, 0.2, about="psi of the drag across"),
    )
    source = "Hoerner, Fluid-Dynamic Drag (1965), sec. 3-10: crossflow principle"
    signature = "sway and yaw rate of the beat are damped more, the faster the fish swims"
    confirm = "tow the stretched fish at an angle: the side force grows with the speed along"
    fingerprint = Fingerprint(exponent=0.0, odd=False, part="everywhere")
    calibration = TOW_TEST
    load = _excess
