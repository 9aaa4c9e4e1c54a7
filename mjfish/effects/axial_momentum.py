"""Axial force of the added momentum of turning links."""

from __future__ import annotations

from typing import Any, ClassVar

from mjfish.effects.calibration import TOW_TEST, Calibration
from mjfish.effects.effect import Effect, Fingerprint
from mjfish.effects.mechanism import Domain
from mjfish.hydro.load import Load, load
from mjfish.parameter import Parameter


@load
def _force(link: Any, parameters: Any) -> tuple[float, float, float]:
    """Return share w p_y along the link."""
    momentum = link.c_m * (link.added[0] * link.v + link.added[1] * link.w)
    return parameters[0] * link.w * momentum, 0.0, 0.0


class AxialMomentum(Effect):
    """The axial force w p_y of the added momentum p_y that turns with a link is (1 + psi) of what the model has.

    In an ideal fluid psi = 0; a wake that carries momentum away leaves less.
    """

    name: ClassVar[str] = "axial_momentum"
    domain: ClassVar[Domain] = "water"
    mechanism: ClassVar[str] = "reactive_force"
    summary: ClassVar[str] = "the added momentum pushes turning links along by another share"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("axial_momentum.share", "-", 0.0, -1.0, 2.0, 0.0, 0.2, about="psi, excess of the axial force"),
    )
    source: ClassVar[str] = "Lamb, Hydrodynamics (1932), art. 124: Kirchhoff's equations"
    signature: ClassVar[str] = "thrust is off by a share, most where the joints bend far; sway and yaw rate hardly"
    confirm: ClassVar[str] = "hold the fish, beat, and measure the thrust at several amplitudes"
    fingerprint: ClassVar[Fingerprint] = Fingerprint(exponent=0.0, odd=False, part="everywhere")
    calibration: ClassVar[Calibration | None] = TOW_TEST
    load: ClassVar[Load | None] = _force
