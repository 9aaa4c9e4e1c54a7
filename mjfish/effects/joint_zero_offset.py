"""Zeros of the joints that are off."""

from __future__ import annotations

import numpy as np

from mjfish.drive.motion import JointMotion
from mjfish.effects.effect import Effect, Fingerprint, Values, each_joint, variant
from mjfish.fish import Fish
from mjfish.parameters import Parameter

_ZERO = Parameter("joint_zero_offset.joint", "rad", 0.0, -0.3, 0.3, 0.0, 0.01, about="zero of joint")


class JointZeroOffset(Effect):
    """Joint i is bent by a constant: theta_i = theta_command,i + b_i. Rates and accelerations are those commanded.

    Of angles that were measured, b_i is how far the zero of the sensor is off: theta_i = theta_measured,i + b_i.

    The offset of each joint is an amplitude of its own, numbered from the head on. The catalogue lists those of four
    joints; `for_fish` has as many as the fish.
    """

    name, domain, mechanism = "joint_zero_offset", "drive", "joint_zero"
    summary = "the joints are not straight where told or measured to be"
    parameters = each_joint(_ZERO, 4)
    jerks = False
    source = "Joint offsets in kinematic calibration: Siciliano et al., Robotics (2009), sec. 2.11"
    signature = "the fish turns where it should swim straight, always to the same side"
    confirm = "photograph the fish from above with all joints at zero, as told or measured"
    of_sensors = True
    fingerprint = Fingerprint(exponent=0.0, odd=True, part="everywhere")

    @classmethod
    def for_fish(cls, fish: Fish) -> Effect:
        """Return the effect with an offset for every joint of the fish."""
        return variant(JointZeroOffset, parameters=each_joint(_ZERO, fish.joints))

    def drive(self, motion: JointMotion, values: Values) -> JointMotion:
        """Bend the joints."""
        bend = np.array([values[p.short] for p in self.parameters])
        return JointMotion(motion.time, motion.angle + bend, motion.rate, motion.acceleration)
