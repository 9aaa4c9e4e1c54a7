"""Servos that follow after a dead time."""

from __future__ import annotations

from mjfish.drive.motion import JointMotion
from mjfish.effects.commanded import SHORTEST, filtered
from mjfish.effects.effect import Fingerprint, ServoForm, Values
from mjfish.parameters import Parameter


class ServoDelay(ServoForm):
    """The joints follow their command after a dead time: theta(t) = c(t - T), at rest until then.

    Transport of the command over a bus, or a servo that samples it seldom. Unlike an offset of the camera's clock it
    leaves the time of the run alone: the fish starts late. A joint cannot jump to its command's rate: 2 ms of T are
    those of a critically damped filter; a shorter T is none.
    """

    name = "servo_delay"
    summary = "the servos follow their command after a dead time"
    parameters = (Parameter("servo_delay.time", "s", 0.0, 0.0, 0.3, 0.0, 0.005, about="T, dead time"),)
    jerks = False
    source = "Ljung, System Identification (1999), sec. 4.2: process models with delay"
    signature = "late by a time at every frequency, not smaller; steps come late and sharp"
    fingerprint = Fingerprint(exponent=1.0, odd=False, part="everywhere")

    def drive(self, motion: JointMotion, values: Values) -> JointMotion:
        """Delay the motion."""
        dead = values["time"] - 2.0 * SHORTEST  # so long does the critically damped filter delay
        return filtered(motion, SHORTEST, 1.0, dead) if dead > 0.0 else motion
