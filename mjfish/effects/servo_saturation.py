"""Soft saturation of the joint angles."""

from __future__ import annotations

import numpy as np

from mjfish.drive.motion import JointMotion
from mjfish.effects.commanded import curved
from mjfish.effects.effect import Effect, Fingerprint, Values
from mjfish.parameters import Parameter


class ServoSaturation(Effect):
    """Large angles come out too small: theta = c (1 + h)^(-1/p), h = (psi c^2)^(p/2), c the command.

    An odd and increasing saturation that never passes L = 1 / sqrt(psi), the angle at which the joint would stop: c
    over the norm of order p of 1 and c / L. 1/p is its softness: at 0.5 it is soft, theta = c - psi c^3 / 2 + O(psi^2),
    at 0.005 the joint turns with its command to 0.997 L and stands there, a hard stop.

        theta' = (1 + h)^(-1 - 1/p) c'
        theta'' = (1 + h)^(-1 - 1/p) c'' - (p + 1) (1 + h)^(-2 - 1/p) h / c  c'^2

    It makes angles smaller only, psi >= 0.
    """

    name, domain, mechanism = "servo_saturation", "drive", "servo_limit"
    summary = "the joints do not reach the large angles they are told"
    parameters = (
        Parameter("servo_saturation.psi", "1/rad2", 0.0, 0.0, 10.0, 0.0, 0.05, about="1 / (largest angle)^2"),
        Parameter(
            "servo_saturation.softness", "-", 0.5, 0.005, 0.5, 0.5, 0.05, about="1/p, near 0 a hard stop", shape=True
        ),
    )
    source = "Saturation as a sector nonlinearity: Khalil, Nonlinear Systems (2002), sec. 1.2.7"
    signature = "too little swing, most at the joints that bend far; the same at every beat frequency, third harmonics"
    confirm = "step the joints on the bench to larger and larger angles and read them"
    fingerprint = Fingerprint(exponent=0.0, odd=False, part="everywhere")
    resembles = ("stuck-clipped",)

    def drive(self, motion: JointMotion, values: Values) -> JointMotion:
        """Compress the angles; rates and accelerations by the chain rule."""
        psi, p, command = values["psi"], 1.0 / values["softness"], motion.angle
        size = np.maximum(np.abs(command), 1e-12)
        h = np.sign(psi) * (abs(psi) * size**2) ** (0.5 * p)  # odd in psi: differences step over its null
        slope = (1.0 + h) ** (-1.0 - 1.0 / p)
        bend = -(p + 1.0) * slope * h / (1.0 + h) * np.sign(command) / size
        return curved(motion, command * (1.0 + h) ** (-1.0 / p), slope, bend)
