"""Joints that turn by another share of what they are told."""

from __future__ import annotations

import numpy as np

from mjfish.drive.motion import JointMotion
from mjfish.effects.effect import Effect, Fingerprint, Values, each_joint, variant
from mjfish.fish import Fish
from mjfish.parameters import Parameter

_GAIN = Parameter("joint_gain_error.joint", "-", 0.0, -1.2, 1.0, 0.0, 0.02, about="gain, less one, of joint")


class JointGainError(Effect):
    """Joint i turns by theta_i = (1 + g_i) theta_command,i: a horn that slips, a tendon that stretches, a dead servo.

    Of angles that were measured, 1 + g_i is the scale of the sensor: theta_i = (1 + g_i) theta_measured,i. A servo that
    does not move has g_i = -1.

    The gain of each joint is an amplitude of its own, numbered from the head on. The catalogue lists those of four
    joints; `for_fish` has as many as the fish.
    """

    name, domain, mechanism = "joint_gain_error", "drive", "joint_gain"
    summary = "the joints turn by another share of what they are told or measured"
    parameters = each_joint(_GAIN, 4)
    source = "Gains of joint encoders in kinematic calibration: Siciliano et al., Robotics (2009), sec. 2.11"
    signature = "the swing of single joints is wrong by a share, the same at every amplitude and beat frequency"
    confirm = "command or measure a known angle of each joint, and photograph it from above"
    of_sensors = True
    fingerprint = Fingerprint(exponent=0.0, odd=False, part="everywhere")

    @classmethod
    def for_fish(cls, fish: Fish) -> Effect:
        """Return the effect with a gain for every joint of the fish."""
        return variant(JointGainError, parameters=each_joint(_GAIN, fish.joints))

    def drive(self, motion: JointMotion, values: Values) -> JointMotion:
        """Scale the angles of each joint, with their rates and accelerations."""
        gain = 1.0 + np.array([values[p.short] for p in self.parameters])
        return JointMotion(motion.time, gain * motion.angle, gain * motion.rate, gain * motion.acceleration)
