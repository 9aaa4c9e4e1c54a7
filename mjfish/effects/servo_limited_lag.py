"""Servos of limited speed with a lag behind the limit."""

from __future__ import annotations

from typing import ClassVar

from mjfish.data import Dataset
from mjfish.drive.motion import JointMotion
from mjfish.effects.commanded import filtered, limited, undetectable_behind_measured_joints
from mjfish.effects.effect import Effect, Fingerprint, Values
from mjfish.effects.mechanism import Domain
from mjfish.parameter import Parameter


class ServoLimitedLag(Effect):
    """The joints turn no faster than L = 1 / slowness, and follow the limited command with a critically damped lag.

    The limit is that of `ServoRateLimit`; behind it comes a filter of second order with two equal time constants T, so
    that the joints start at rest.
    """

    name: ClassVar[str] = "servo_limited_lag"
    domain: ClassVar[Domain] = "drive"
    mechanism: ClassVar[str] = "servo_dynamics"
    summary: ClassVar[str] = "the servos are too slow for their command, and lag"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("servo_limited_lag.slowness", "s/rad", 0.0, 0.0, 0.5, 0.1, 0.03, about="1 / (largest rate)"),
        Parameter("servo_limited_lag.time", "s", 0.005, 0.0005, 0.1, 0.005, 0.003, about="T, of the lag", shape=True),
    )
    source: ClassVar[str] = "Rate limiter of an actuator: Fielding and Flux, Aeronautical Journal 107 (2003)"
    signature: ClassVar[str] = "late; above a frequency the tail swings less, as rounded triangles"
    confirm: ClassVar[str] = "log the joint angles on the bench while the command steps"
    fingerprint: ClassVar[Fingerprint] = Fingerprint(exponent=None, odd=False, part="everywhere")
    resembles: ClassVar[tuple[str, ...]] = ("clock-drift", "clock-jump", "design-no-start", "repeats-differ")
    smooth: ClassVar[bool] = False

    def not_applicable(self, dataset: Dataset) -> str:
        """Measured joint angles leave nothing between command and joint."""
        return undetectable_behind_measured_joints(dataset)

    def drive(self, motion: JointMotion, values: Values) -> JointMotion:
        """Limit and filter the motion."""
        return filtered(limited(motion, values["slowness"]), values["time"], 1.0)
