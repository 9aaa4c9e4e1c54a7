"""Wrong scale of the camera."""

from __future__ import annotations

from mjfish.data import Trial
from mjfish.effects.effect import Effect, Fingerprint, Values
from mjfish.numerics.arrays import FloatArray
from mjfish.parameters import Parameter


class VelocityScale(Effect):
    """Lengths are read (1 + error) times too long: (surge, sway)_recorded = (1 + error) (surge, sway), places alike.

    The scale of a camera that looks at a plane in parallel is one number. Angles do not depend on it, so the yaw rate
    is right.
    """

    name, domain, mechanism = "velocity_scale", "data", "camera_scale"
    summary = "the scale of the camera is off"
    parameters = (
        Parameter("velocity_scale.error", "-", 0.0, -0.3, 0.3, 0.0, 0.01, about="relative error of the camera's scale"),
    )
    source = (
        "Scale factor of a sensor: Jategaonkar, Flight Vehicle System Identification (2006), ch. 10; Hartley and "
        "Zisserman, Multiple View Geometry in Computer Vision (2004), ch. 6"
    )
    signature = "surge and sway are off by the same factor at every speed; the yaw rate is right"
    confirm = "film a ruler at the depth of the marker, or integrate the speed along a known distance"
    fingerprint = Fingerprint(exponent=0.0, odd=False, part="everywhere")
    resembles = (
        "compatibility-derived",
        "compatibility-scale",
        "repeats-differ",
        "stuck-clipped",
    )

    def reading(self, state: FloatArray, values: Values, trial: Trial) -> FloatArray:
        """Scale the translations."""
        del trial
        read = state.copy()
        read[:, :2] *= 1.0 + values["error"]
        return read

    def camera(
        self, time: FloatArray, place: FloatArray, heading: FloatArray, values: Values, trial: Trial
    ) -> tuple[FloatArray, FloatArray]:
        """Scale the places about the origin of the world."""
        del time, trial
        return (1.0 + values["error"]) * place, heading
