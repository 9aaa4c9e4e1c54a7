"""Axes of the camera's body frame that are turned against the fish's."""

from __future__ import annotations

import numpy as np

from mjfish.data import Trial
from mjfish.effects.effect import Effect, Fingerprint, Values
from mjfish.fish import frames
from mjfish.numerics.arrays import FloatArray
from mjfish.parameters import Parameter


class FrameMisalignment(Effect):
    """The axis taken for the fish's is turned by a constant angle a about z: V_recorded = R(a)^T V.

    So surge_recorded = cos a surge + sin a sway and sway_recorded = cos a sway - sin a surge: with a > 0 the recorded
    x axis points to port of the head's, and a fish that swims straight seems to drift to starboard. The rate of a
    constant angle is zero, so that the yaw rate is right. Where places and headings were recorded, the heading is a too
    large, and the places are right.
    """

    name, domain, mechanism = "frame_misalignment", "data", "camera_axes"
    summary = "the axis taken for the fish's is turned"
    parameters = (
        Parameter("frame_misalignment.angle", "rad", 0.0, -0.5, 0.5, 0.0, 0.01, about="of the recorded axis, to port"),
    )
    source = "Misalignment of a sensor: Groves, Principles of GNSS and Inertial Navigation (2013), sec. 4.4"
    signature = "a constant share of the forward speed shows up as sway, to the same side in every run"
    confirm = "push the stretched fish along a straight rail in the camera's view"
    fingerprint = Fingerprint(exponent=0.0, odd=True, part="everywhere")
    resembles = ("compatibility-derived", "compatibility-rotation", "design-no-turn")

    def reading(self, state: FloatArray, values: Values, trial: Trial) -> FloatArray:
        """Turn the translations."""
        del trial
        read = state.copy()
        read[:, :2] = frames.to_body(state[:, :2], np.full(len(state), values["angle"]))
        return read

    def camera(
        self, time: FloatArray, place: FloatArray, heading: FloatArray, values: Values, trial: Trial
    ) -> tuple[FloatArray, FloatArray]:
        """Turn the headings."""
        del time, trial
        return place, heading + values["angle"]
