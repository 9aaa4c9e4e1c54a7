"""Soft saturation of the joint angles."""

from __future__ import annotations

import numpy as np

from mjfish.drive.motion import JointMotion
from mjfish.effects.effect import Effect, Fingerprint, Values
from mjfish.parameters import Parameter


class ServoSaturation(Effect):
    """Large angles come out too small: theta = c (1 + h)^(-1/p), h = (psi c^2)^(p/2), c the command.

    An odd and increasing saturation that never passes L = 1 / sqrt(psi), the angle at which the joint would stop. p is
    its sharpness: at 2 it is soft, theta = c - psi c^3 / 2 + O(psi^2), at 20 nearly a hard stop (the norm of order p
    of 1 and c / L).

        theta' = (1 + h)^(-1 - 1/p) c'
        theta'' = (1 + h)^(-1 - 1/p) c'' - (p + 1) (1 + h)^(-2 - 1/p) h / c  c'^2

    It makes angles smaller only, psi >= 0.
    """

    name, domain, mechanism = "servo_saturation", "drive", "servo_limit"
    summary = "the joints do not reach the large angles they are told"
    parameters = (
        Parameter("servo_saturation.psi", "1/rad2", 0.0, 0.0, 10.0, 0.0, 0.05, about="1 / (largest angle)^2"),
        Parameter(
            "servo_saturation.sharpness", "-", 2.0, 2.0, 20.0, 2.0, 1.0, about="p, 2 soft, 20 a hard stop", shape=True
        ),
    )
    source = "Saturation as a sector nonlinearity: Khalil, Nonlinear Systems (2002), sec. 1.2.7"
    signature = "too little swing, most at the joints that bend far; the same at every beat frequency, third harmonics"
    confirm = "step the joints on the bench to larger and larger angles and read them"
    fingerprint = Fingerprint(exponent=0.0, odd=False, part="everywhere")
    resembles = ("stuck-clipped",)

    def drive(self, motion: JointMotion, values: Values) -> JointMotion:
        """Compress the angles; rates and accelerations by the chain rule."""
        psi, p, command = values["psi"], values["sharpness"], motion.angle
        size = np.maximum(np.abs(command), 1e-12)
        h = np.sign(psi) * (abs(psi) * size**2) ** (0.5 * p)  # odd in psi: differences step over its null
        slope = (1.0 + h) ** (-1.0 - 1.0 / p)
        bend = -(p + 1.0) * slope * h / (1.0 + h) * np.sign(command) / size
        return JointMotion(
            time=motion.time,
            angle=command * (1.0 + h) ** (-1.0 / p),
            rate=slope * motion.rate,
            acceleration=slope * motion.acceleration + bend * motion.rate**2,
        )
