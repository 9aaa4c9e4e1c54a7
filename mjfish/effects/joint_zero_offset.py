"""Zeros of the joints that are off."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from mjfish.data import Dataset
from mjfish.drive.motion import JointMotion
from mjfish.effects.commanded import nothing_between
from mjfish.effects.effect import Effect, Family, Fingerprint, Values
from mjfish.parameter import Parameter

#: Joints that have an offset of their own.
JOINTS = 4


class JointZeroOffset(Effect):
    """Joint i is bent by a constant: theta_i = theta_command,i + b_i. Rates and accelerations are those commanded.

    The offset of each joint is an amplitude of its own, numbered from the head on. It is declared for fish of four
    joints, because the parameters of a cause are the same for every fish.
    """

    name: ClassVar[str] = "joint_zero_offset"
    family: ClassVar[Family] = "drive"
    summary: ClassVar[str] = "the joints are not straight where they are told to be"
    parameters: ClassVar[tuple[Parameter, ...]] = tuple(
        Parameter(f"joint_zero_offset.joint_{i}", "rad", 0.0, -0.3, 0.3, 0.0, 0.01, about=f"zero of joint {i}")
        for i in range(1, JOINTS + 1)
    )
    source: ClassVar[str] = "Joint offsets in kinematic calibration: Siciliano et al., Robotics (2009), sec. 2.11"
    signature: ClassVar[str] = "the fish turns where it should swim straight, always to the same side"
    confirm: ClassVar[str] = "command zero to all joints and photograph the fish from above"
    fingerprint: ClassVar[Fingerprint] = Fingerprint(exponent=0.0, odd=True, part="everywhere")

    def not_applicable(self, dataset: Dataset) -> str:
        """Measured joint angles have their own zero; another number of joints has no declared offsets."""
        if dataset.fish.joints != JOINTS:
            return f"it is declared for {JOINTS} joints, {dataset.fish.name} has {dataset.fish.joints}"
        return nothing_between(dataset)

    def drive(self, motion: JointMotion, values: Values) -> JointMotion:
        """Bend the first four joints, or as many as there are."""
        bend = np.zeros(motion.joints)
        known = min(JOINTS, motion.joints)
        bend[:known] = [values[f"joint_{i}"] for i in range(1, known + 1)]
        return JointMotion(motion.time, motion.angle + bend, motion.rate, motion.acceleration)
