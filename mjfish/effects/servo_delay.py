"""Servos that follow after a dead time."""

from __future__ import annotations

from typing import ClassVar

from mjfish.drive.motion import JointMotion
from mjfish.effects.commanded import SHORTEST, filtered
from mjfish.effects.effect import Effect, Fingerprint, Values
from mjfish.effects.mechanism import Domain
from mjfish.parameter import Parameter


class ServoDelay(Effect):
    """The joints follow their command after a dead time: theta(t) = c(t - T), at rest until then.

    Transport of the command over a bus, or a servo that samples it seldom. Unlike an offset of the camera's clock it
    leaves the time of the run alone: the fish starts late. A joint cannot jump to its command's rate: 2 ms of T are
    those of a critically damped filter; a shorter T is none.
    """

    name: ClassVar[str] = "servo_delay"
    domain: ClassVar[Domain] = "drive"
    mechanism: ClassVar[str] = "servo_dynamics"
    summary: ClassVar[str] = "the servos follow their command after a dead time"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("servo_delay.time", "s", 0.0, 0.0, 0.3, 0.0, 0.005, about="T, dead time"),
    )
    source: ClassVar[str] = "Ljung, System Identification (1999), sec. 4.2: process models with delay"
    signature: ClassVar[str] = "late by a time at every frequency, not smaller; steps come late and sharp"
    confirm: ClassVar[str] = "log the joint angles on the bench while the command steps"
    fingerprint: ClassVar[Fingerprint] = Fingerprint(exponent=1.0, odd=False, part="everywhere")
    resembles: ClassVar[tuple[str, ...]] = ("clock-drift", "clock-jump", "design-no-start", "repeats-differ")
    smooth: ClassVar[bool] = False

    def drive(self, motion: JointMotion, values: Values) -> JointMotion:
        """Delay the motion."""
        dead = values["time"] - 2.0 * SHORTEST  # so long does the critically damped filter delay
        return filtered(motion, SHORTEST, 1.0, dead) if dead > 0.0 else motion
