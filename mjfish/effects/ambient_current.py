"""Uniform steady current in the tank."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from mjfish.data import Dataset, Trial
from mjfish.effects.calibration import DRIFT
from mjfish.effects.effect import Effect, Fingerprint, Values
from mjfish.effects.place import begun_at, heading_known
from mjfish.fish import frames
from mjfish.numerics.arrays import FloatArray
from mjfish.parameters import Parameter


class AmbientCurrent(Effect):
    """The water moves with a constant velocity c in the world: V_camera = V_relative + R(yaw)^T c.

    A uniform steady current is a change of inertial frame: relative to the water nothing changes (Galilean
    invariance), so that the camera reads the relative velocity plus the current, turned into the body frame. A fish
    that nobody held drifts with the water when its drive starts; one that was held, and let go then, begins against it:

        V_relative(0) = -h R(yaw(0))^T c,   h = 0 adrift, 1 held.
    """

    name, domain, mechanism = "ambient_current", "water", "current"
    summary = "the water in the tank moves"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("ambient_current.x", "m/s", 0.0, -0.5, 0.5, 0.0, 0.01, about="current along world x"),
        Parameter("ambient_current.y", "m/s", 0.0, -0.5, 0.5, 0.0, 0.01, about="current along world y"),
        Parameter(
            "ambient_current.held", "-", 0.0, 0.0, 1.0, 0.5, 0.1, about="0 adrift at the start, 1 held", shape=True
        ),
    )
    source = "Fossen, Handbook of Marine Craft Hydrodynamics and Motion Control (2011), sec. 8.3"
    signature = "an offset of surge and sway that turns with the heading; it is there at rest too"
    confirm = "let the fish drift without drive, or swim the same run in the opposite heading"
    fingerprint = Fingerprint(exponent=-1.0, odd=None, part="everywhere")
    calibration = DRIFT
    resembles = ("compatibility-bias", "design-no-turn", "start-offset")

    def not_applicable(self, dataset: Dataset) -> str:
        """A current needs the heading in the world: from rest it starts at 0, else it must be measured."""
        unknown = [t.name for t in dataset.trials if not t.starts_at_rest and not heading_known(t)]
        return f"the heading was not measured (no yaw column) in {', '.join(unknown)}" if unknown else ""

    def start(self, velocity: FloatArray, values: Values, trial: Trial) -> FloatArray:
        """Begin a trial from rest against the water, as far as the fish was held; else the start is free anyhow."""
        if not trial.starts_at_rest:
            return velocity
        against = frames.to_body(np.array([[values["x"], values["y"]]]), np.array([float(begun_at(trial)[2])]))[0]
        return np.asarray(velocity - values["held"] * np.array([*against, 0.0]))

    def reading(self, state: FloatArray, values: Values, trial: Trial) -> FloatArray:
        """Add the current in the body frame to the velocity through the water, and its way to the place."""
        current = np.array([values["x"], values["y"]])
        read = state.copy()
        read[:, :2] += frames.to_body(np.broadcast_to(current, (len(state), 2)), state[:, 5])
        read[:, 3:5] += _since(trial.time, trial)[:, None] * current
        return read

    def camera(
        self, time: FloatArray, place: FloatArray, heading: FloatArray, values: Values, trial: Trial
    ) -> tuple[FloatArray, FloatArray]:
        """Add the way of the water."""
        return place + _since(time, trial)[:, None] * np.array([values["x"], values["y"]]), heading


def _since(time: FloatArray, trial: Trial) -> FloatArray:
    """Return how long (n,) the water has carried the fish [s]: since 0, where it began from rest by itself."""
    return time if trial.starts_at_rest and not trial.from_rest else time - trial.time[0]
