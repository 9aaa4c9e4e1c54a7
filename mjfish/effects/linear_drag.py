"""Viscous drag in proportion to the speed, on top of the quadratic."""

from __future__ import annotations

from typing import Any

from mjfish.effects.calibration import TOW_TEST
from mjfish.effects.effect import Effect, Fingerprint
from mjfish.fish.outline import INTERVALS
from mjfish.hydro.load import load
from mjfish.parameters import Parameter


@load
def _damping(link: Any, parameters: Any) -> tuple[float, float, float]:
    """Return the damping of one link, by its moments of height: H_k = INT h r^k dr."""
    h0 = link.height_moment[INTERVALS, 0]
    h1 = link.height_moment[INTERVALS, 1]
    h2 = link.height_moment[INTERVALS, 2]
    across = h0 * link.v + h1 * link.w
    moment = h1 * link.v + h2 * link.w
    return -parameters[0] * link.wetted * link.u, -parameters[1] * across, -parameters[1] * moment


class LinearDrag(Effect):
    """Every strip is held back in proportion to its speed: -psi_f u a wetted area along, -psi_d q a height across.

        fx = -psi_f INT p dr u,   fy = -psi_d INT h q dr,   mz = -psi_d INT h q r dr,   q = v + w r

    The linear term of the expansion of drag in speed (Stokes's at Re << 1), which quadratic drag lacks and which wins
    at low speed: psi_f = 1.5 N s/m3 is the friction of c_f = 0.01 at 0.3 m/s, psi_d = 150 N s/m3 the drag of c_d = 1.
    """

    name, domain, mechanism = "linear_drag", "water", "drag_law"
    summary = "a viscous drag in proportion to the speed"
    parameters = (
        Parameter("linear_drag.along", "N s/m3", 0.0, 0.0, 20.0, 0.0, 0.2, about="psi_f, per wetted area"),
        Parameter("linear_drag.across", "N s/m3", 0.0, 0.0, 1000.0, 0.0, 20.0, about="psi_d, per height and length"),
    )
    source = "Fossen, Handbook of Marine Craft Hydrodynamics and Motion Control (2011), sec. 6.4"
    signature = "too slow at low frequency, less so at high; the error falls as one over frequency"
    confirm = "tow the stretched fish at low speeds: the force over the speed does not go to zero"
    fingerprint = Fingerprint(exponent=-1.0, odd=False, part="everywhere")
    calibration = TOW_TEST
    resembles = ("design-short",)
    load = _damping
