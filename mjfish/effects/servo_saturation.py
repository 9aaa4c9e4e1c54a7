"""Soft saturation of the joint angles."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from mjfish.drive.motion import JointMotion
from mjfish.effects.commanded import nothing_between
from mjfish.effects.effect import Effect, Family, Fingerprint, Values
from mjfish.parameter import Parameter
from mjfish.trial import Dataset


class ServoSaturation(Effect):
    """Large angles come out too small: theta = c / sqrt(1 + psi c^2) = c - psi c^3 / 2 + O(psi^2), c the command.

    A smooth, odd and increasing saturation that never passes 1 / sqrt(psi): the angle at which the joint would stop.
    The cubic that it begins with is the first term of any odd saturation. With s = 1 / sqrt(1 + psi c^2)

        theta' = s^3 c',  theta'' = s^3 c'' - 3 psi c s^5 c'^2.

    It makes angles smaller only, psi >= 0.
    """

    name: ClassVar[str] = "servo_saturation"
    family: ClassVar[Family] = "drive"
    summary: ClassVar[str] = "the joints do not reach the large angles they are told"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("servo_saturation.psi", "1/rad2", 0.0, 0.0, 10.0, 0.0, 0.05, about="1 / (largest angle)^2"),
    )
    source: ClassVar[str] = "Saturation as a sector nonlinearity: Khalil, Nonlinear Systems (2002), sec. 1.2.7"
    signature: ClassVar[str] = (
        "too little swing, most at the joints that bend far; the same at every beat frequency, third harmonics"
    )
    confirm: ClassVar[str] = "step the joints on the bench to larger and larger angles and read them"
    fingerprint: ClassVar[Fingerprint] = Fingerprint(exponent=0.0, odd=False, part="everywhere")

    def not_applicable(self, dataset: Dataset) -> str:
        """Measured joint angles leave nothing between command and joint."""
        return nothing_between(dataset)

    def drive(self, motion: JointMotion, values: Values) -> JointMotion:
        """Compress the angles; rates and accelerations by the chain rule."""
        psi, command = values["psi"], motion.angle
        square = 1.0 / (1.0 + psi * command**2)
        share = np.sqrt(square)
        slope = share * square
        return JointMotion(
            time=motion.time,
            angle=share * command,
            rate=slope * motion.rate,
            acceleration=slope * (motion.acceleration - 3.0 * psi * command * square * motion.rate**2),
        )
