"""Servos that answer as a filter of second order."""

from __future__ import annotations

from mjfish.drive.motion import JointMotion
from mjfish.effects.commanded import SHORTEST, filtered
from mjfish.effects.effect import Fingerprint, ServoForm, Values
from mjfish.parameters import Parameter


class ServoSecondOrder(ServoForm):
    """The joints follow their command as a filter of second order: T^2 theta'' + 2 zeta T theta' + theta = c.

    From rest where the command starts: theta(0) = c(0), theta'(0) = 0. A position loop around a motor with inertia; a
    damping ratio zeta below 0.7 overshoots.
    """

    name = "servo_second_order"
    summary = "the servos answer with inertia"
    parameters = (
        Parameter("servo_second_order.time", "s", 0.0, 0.0, 0.3, 0.0, 0.005, about="T, 1 / natural frequency"),
        Parameter("servo_second_order.damping", "-", 0.7, 0.1, 3.0, 0.7, 0.2, about="zeta, damping ratio", shape=True),
    )
    jerks = False
    source = "Ljung, System Identification (1999), sec. 4.2: process models"
    signature = "late, and larger or smaller near its natural frequency; steps overshoot or come smooth"
    fingerprint = Fingerprint(exponent=1.0, odd=False, part="everywhere")

    def drive(self, motion: JointMotion, values: Values) -> JointMotion:
        """Filter the motion."""
        if values["time"] < SHORTEST:
            return motion
        return filtered(motion, values["time"], values["damping"])
