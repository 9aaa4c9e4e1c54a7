"""Servo dynamics learned from the data: dead time, rate limit and a filter of second order."""

from __future__ import annotations

from mjfish.drive.motion import JointMotion
from mjfish.effects.commanded import SHORTEST, filtered, limited
from mjfish.effects.effect import Fingerprint, ServoForm, Values
from mjfish.parameters import Parameter


class ServoDynamics(ServoForm):
    """The joints follow their command through a rate limit, a dead time, and a filter of second order.

    A stable and causal filter of unit static gain: the limit of `ServoRateLimit`, behind which the joints close in on
    their command at a rate k, a dead time, and the filter of `ServoSecondOrder`, one behind the other.
    """

    name = "servo_dynamics"
    learned = True
    summary = "the joints follow their command late, learned"
    parameters = (
        Parameter("servo_dynamics.time", "s", 0.0, 0.0, 0.3, 0.0, 0.005, about="T, 1 / natural frequency"),
        Parameter("servo_dynamics.delay", "s", 0.0, 0.0, 0.3, 0.0, 0.005, about="dead time"),
        Parameter("servo_dynamics.slowness", "s/rad", 0.0, 0.0, 0.5, 0.0, 0.03, about="1 / (largest rate)"),
        Parameter("servo_dynamics.damping", "-", 0.7, 0.1, 20.0, 0.7, 0.2, about="zeta, damping ratio", shape=True),
        Parameter(
            "servo_dynamics.catch_up", "1/s", 100.0, 20.0, 800.0, 100.0, 20.0, about="k, of the limit", shape=True
        ),
    )
    source = "Ljung, System Identification (1999), sec. 4.2: process models"
    signature = "late, and smaller or larger by frequency"
    fingerprint = Fingerprint(exponent=None, odd=False, part="everywhere")

    def like(self, formula: str, values: Values) -> dict[str, float]:
        """Return this motion at the numbers of a formula of the same mechanism."""
        if formula == "servo_lag":
            time = max(values["time_constant"] / 40.0, SHORTEST)  # overdamped: the other pole is that of the lag
            return {"time": time, "damping": max(0.5 * values["time_constant"] / time, 0.5)}
        if formula == "servo_delay":
            return {"delay": max(values["time"] - 2.0 * SHORTEST, 0.0), "damping": 1.0}
        if formula == "servo_limited_lag":
            return {"slowness": values["slowness"], "catch_up": 1.0 / values["time"], "delay": values["time"]}
        return {short: values[short] for short in ("time", "damping", "delay", "slowness") if short in values}

    def drive(self, motion: JointMotion, values: Values) -> JointMotion:
        """Delay, limit and filter the motion."""
        if max(values["delay"], values["slowness"]) <= 0.0 and values["time"] < SHORTEST:
            return motion
        if values["slowness"] > 0.0:
            motion = limited(motion, values["slowness"], values["catch_up"])
        return filtered(motion, values["time"], values["damping"], values["delay"])
