"""Servos of limited speed that lag."""

from __future__ import annotations

from mjfish.drive.motion import JointMotion
from mjfish.effects.commanded import limited
from mjfish.effects.effect import Fingerprint, ServoForm, Values
from mjfish.parameters import Parameter


class ServoLimitedLag(ServoForm):
    """The joints close in on their command with a time constant T, and turn no faster than L = 1 / slowness.

        theta' = L sat((theta_command - theta) / (T L)),   theta(0) = theta_command(0)

    The position loop of a servo with a limited speed; sat and its corner as of `ServoRateLimit`. Where the limit is not
    met, it is the lag of `ServoLag`.
    """

    name = "servo_limited_lag"
    summary = "the servos are too slow for their command, and lag"
    parameters = (
        Parameter("servo_limited_lag.slowness", "s/rad", 0.0, 0.0, 0.5, 0.1, 0.03, about="1 / (largest rate)"),
        Parameter("servo_limited_lag.time", "s", 0.005, 0.001, 0.1, 0.005, 0.003, about="T, of the loop", shape=True),
    )
    source = "Rate limiter of an actuator: Fielding and Flux, Aeronautical Journal 107 (2003)"
    signature = "late; above a frequency the tail swings less, as rounded triangles"
    fingerprint = Fingerprint(exponent=None, odd=False, part="everywhere")
    limits = ("servo_lag", "servo_rate_limit")

    def drive(self, motion: JointMotion, values: Values) -> JointMotion:
        """Let the joints close in as fast as they may."""
        return limited(motion, values["slowness"], 1.0 / values["time"], 0.0)

    def like(self, formula: str, values: Values) -> dict[str, float]:
        """Return the numbers at which it is the lag alone, or the limit alone."""
        if formula == "servo_lag":
            return {"slowness": 0.0, "time": values["time_constant"]}
        return {"slowness": values["slowness"], "time": 0.0} if formula == "servo_rate_limit" else {}
