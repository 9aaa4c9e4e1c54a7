"""Causes that are of this paper alone: what it leaves open, or prints with doubt."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import ClassVar

import numpy as np

from mjfish.drive.motion import JointMotion
from mjfish.effects import Effect
from mjfish.fish import Fish
from mjfish.parameters import Parameter


class PsiUnit(Effect):
    """All angles are larger: the unit of beta psi is (1 + error) times the fish's."""

    name: ClassVar[str] = "psi_unit"
    domain: ClassVar = "drive"
    summary: ClassVar[str] = "the unit of beta psi"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("psi_unit.error", "-", 0.0, -0.8, 1.0, 0.0, 0.05, about="relative error of the unit of beta psi"),
    )
    source: ClassVar[str] = "[Yu2016] eq. (20) and Table II: theta = beta psi with beta = 60, without a unit"
    signature: ClassVar[str] = "all velocities are too large or too small, alike at every frequency"
    confirm: ClassVar[str] = "film the joints: the amplitude of one is enough"

    def drive(self, motion: JointMotion, values: Mapping[str, float]) -> JointMotion:
        """Scale angles, rates and accelerations."""
        gain = 1.0 + values["error"]
        return replace(
            motion, angle=gain * motion.angle, rate=gain * motion.rate, acceleration=gain * motion.acceleration
        )


class SoftStart(Effect):
    """The beat grows to its amplitude more slowly: theta = r(t) theta_command, r = 1 - (1 + t / T) exp(-t / T)."""

    name: ClassVar[str] = "soft_start"
    domain: ClassVar = "drive"
    summary: ClassVar[str] = "a start-up with less of a kick"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("soft_start.time", "s", 0.0, 0.0, 1.0, 0.0, 0.05, about="time T of the growth of the beat"),
    )
    source: ClassVar[str] = "[Yu2016] eq. (20): where the oscillators start is not printed"
    signature: ClassVar[str] = "the first beats alone are too large"
    confirm: ClassVar[str] = "film the joints in the first beats"

    def drive(self, motion: JointMotion, values: Mapping[str, float]) -> JointMotion:
        """Multiply by r, with its exact rate and acceleration."""
        width = values["time"]
        if width <= 0.0:
            return motion
        ends = motion.time[:-1], 0.5 * (motion.time[:-1] + motion.time[1:]), motion.time[1:]
        s = (np.stack(ends, axis=1) / width)[:, :, None]
        decay = np.exp(-s)
        r, slope, bend = 1.0 - (1.0 + s) * decay, s * decay / width, (1.0 - s) * decay / width**2
        return JointMotion(
            time=motion.time,
            angle=r * motion.angle,
            rate=r * motion.rate + slope * motion.angle,
            acceleration=r * motion.acceleration + 2.0 * slope * motion.rate + bend * motion.angle,
        )


class HeadInertia(Effect):
    """The head's yaw inertia about its centre of mass is I_0 (1 + error).

    At most +0.0527: that of two point masses at its ends, m c (l - c) = 0.0305 kg m2.
    """

    name: ClassVar[str] = "head_inertia"
    domain: ClassVar = "body"
    summary: ClassVar[str] = "the head's inertia I_0"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("head_inertia.error", "-", 0.0, -0.9, 0.0527, 0.0, 0.02, about="relative error of I_0"),
    )
    source: ClassVar[str] = "[Yu2016] Table I: 95 % of what two point masses at the ends of the head would have"
    signature: ClassVar[str] = "the head turns too much or too little"
    confirm: ClassVar[str] = "hang the head on two threads and time its swing about the vertical (bifilar pendulum)"

    def body(self, fish: Fish, values: Mapping[str, float]) -> Fish:
        """Scale the inertia of the first link."""
        head = fish.links[0].model_copy(update={"inertia": (1.0 + values["error"]) * fish.links[0].inertia})
        return fish.model_copy(update={"links": (head, *fish.links[1:])})


class FinHeight(Effect):
    """The last section, the caudal fin, is (1 + error) times as high."""

    name: ClassVar[str] = "fin_height"
    domain: ClassVar = "body"
    summary: ClassVar[str] = "the height of the caudal fin"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("fin_height.error", "-", 0.0, -0.5, 0.5, 0.0, 0.05, about="relative error of the fin's height"),
    )
    source: ClassVar[str] = "[Yu2016] Fig. 1: the outline is shown in pictures only"
    signature: ClassVar[str] = "thrust and the recoil of the head are off together"
    confirm: ClassVar[str] = "measure the fin"

    def body(self, fish: Fish, values: Mapping[str, float]) -> Fish:
        """Scale both ends of the last section."""
        fin = fish.sections[-1]
        height = tuple((1.0 + values["error"]) * end for end in fin.height)
        fin = fin.model_copy(update={"height": height})
        return fish.model_copy(update={"sections": (*fish.sections[:-1], fin)})
