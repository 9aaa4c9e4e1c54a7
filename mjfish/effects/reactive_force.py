"""Forces of the added momentum learned from the data: a share of each."""

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
    """Return Munk moment, axial force, and what the trailing edge sheds, each with its share."""
    momentum = link.c_m * (link.added[0] * link.v + link.added[1] * link.w)
    if link.last == 0.0:
        return parameters[2] * link.w * momentum, 0.0, -parameters[0] * link.u * momentum
    height = link.node_height[INTERVALS]
    mass = parameters[3] * link.c_m * link.density * 0.25 * np.pi * height * height
    q = link.v + link.w * link.length
    fy = mass * link.u * q if link.u < 0.0 else 0.0
    fx = parameters[2] * link.w * momentum - 0.5 * mass * q * q
    return fx, fy, link.length * fy - parameters[1] * link.u * momentum


class ReactiveForce(Effect):
    """The added momentum acts as in an ideal fluid by shares of its own: Munk moment, axial force, what is shed.

        mz = -kappa u p_y (kappa of body and of tail),   fx = psi w p_y,   and psi_e of `EdgeMomentum` at the end

    All of Kirchhoff's equations of a link are kappa = 1, psi = 0; a wake takes some of it away.
    """

    name, domain, mechanism = "reactive_force", "water", "reactive_force"
    learned = True
    summary = "the added momentum acts by other shares, learned"
    parameters = (
        Parameter("reactive_force.munk_body", "-", 0.0, -1.5, 3.0, 0.0, 0.2, about="kappa of all links but the last"),
        Parameter("reactive_force.munk_tail", "-", 0.0, -1.5, 3.0, 0.0, 0.2, about="kappa of the last link"),
        Parameter("reactive_force.axial", "-", 0.0, -1.5, 3.0, 0.0, 0.2, about="psi, excess of the axial force"),
        Parameter("reactive_force.edge", "-", 0.0, -1.0, 3.0, 0.0, 0.05, about="share that the trailing edge sheds"),
    )
    source = "Lamb, Hydrodynamics (1932), art. 124; Lighthill, Proc. R. Soc. B 179 (1971)"
    signature = "yaw rate and sway, growing with forward speed times sideways speed; none at rest"
    confirm = "tow the fish, joints held, at a small angle and measure force and moment against speed"
    fingerprint = Fingerprint(exponent=0.0, odd=False, part="everywhere")
    calibration = TOW_TEST
    resembles = ("design-no-turn",)
    load = _force

    def priors(self) -> tuple[Prior, ...]:
        """Shares are of the order of one."""
        return (Prior("reactive_force.shares", tuple(p.name for p in self.parameters), np.eye(4), 1.0),)
