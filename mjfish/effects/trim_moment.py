"""A moment that turns the fish to one side, whatever it does."""

from __future__ import annotations

from typing import Any

from mjfish.effects.calibration import DRIFT
from mjfish.effects.effect import Effect, Fingerprint
from mjfish.hydro.load import load
from mjfish.parameters import Parameter


@load
def _trim(link: Any, parameters: Any) -> tuple[float, float, float]:
    """Return the moment on the first link; while the joints are led, it is one on the whole fish."""
    return 0.0, 0.0, link.first * (parameters[0] + parameters[1] * link.u * link.u)


class TrimMoment(Effect):
    """A moment about the vertical, M = M_0 + M_2 u^2, u the speed of the head along itself; positive turns to port.

    M_0 is that of a cable or a tube which pulls, M_2 that of a body or a fin which is not symmetric: the moment of its
    lift goes with the dynamic pressure, M_2 = 1/2 rho S L C_n.
    """

    name, domain, mechanism = "trim_moment", "body", "trim"
    summary = "a steady moment turns the fish to one side"
    parameters = (
        Parameter("trim_moment.constant", "N m", 0.0, -0.5, 0.5, 0.0, 0.01, about="M_0"),
        Parameter("trim_moment.square", "N m s2/m2", 0.0, -1.0, 1.0, 0.0, 0.02, about="M_2, per square of the speed"),
    )
    source = "Etkin and Reid, Dynamics of Flight (1996), sec. 3.8: yawing moment of an asymmetric body"
    signature = "every run turns to one side, also where the joints beat evenly"
    confirm = (
        "let the stretched fish glide, and turn it on its back: the turn changes sides with a body, not with a cable"
    )
    fingerprint = Fingerprint(exponent=None, odd=True, part="everywhere")
    calibration = DRIFT
    load = _trim
