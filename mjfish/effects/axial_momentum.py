"""Axial force of the added momentum of turning links."""

from __future__ import annotations

from typing import Any

from mjfish.effects.calibration import TOW_TEST
from mjfish.effects.effect import Effect, Fingerprint
from mjfish.hydro.load import load
from mjfish.parameters import Parameter


@load
def _force(link: Any, parameters: Any) -> tuple[float, float, float]:
    """Return share w p_y along the link."""
    momentum = link.c_m * (link.added[0] * link.v + link.added[1] * link.w)
    return parameters[0] * link.w * momentum, 0.0, 0.0


class AxialMomentum(Effect):
    """The axial force w p_y of the added momentum p_y that turns with a link is (1 + psi) of what the model has.

    In an ideal fluid psi = 0; a wake that carries momentum away leaves less.
    """

    name, domain, mechanism = "axial_momentum", "water", "reactive_force"
    summary = "the added momentum pushes turning links along by another share"
    parameters = (
        Parameter("axial_momentum.share", "-", 0.0, -1.0, 2.0, 0.0, 0.2, about="psi, excess of the axial force"),
    )
    source = "Lamb, Hydrodynamics (1932), art. 124: Kirchhoff's equations"
    signature = "thrust is off by a share, most where the joints bend far; sway and yaw rate hardly"
    confirm = "hold the fish, beat, and measure the thrust at several amplitudes"
    fingerprint = Fingerprint(exponent=0.0, odd=False, part="everywhere")
    calibration = TOW_TEST
    load = _force
