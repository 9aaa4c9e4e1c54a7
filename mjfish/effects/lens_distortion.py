"""A lens that bends straight lines."""

from __future__ import annotations

import numpy as np

from mjfish.data import Dataset, Trial
from mjfish.effects.effect import Effect, Fingerprint, Values
from mjfish.numerics.arrays import FloatArray
from mjfish.parameters import Parameter


class LensDistortion(Effect):
    """A place p is seen at c + (1 + k |p - c|^2) (p - c): radial distortion about the point c under the camera.

    k > 0 draws the edge of the image outwards (pincushion), k < 0 inwards (barrel). A heading turns with the image: the
    direction e becomes (1 + k r^2) e + 2 k (r . e) r, r = p - c. Velocities that somebody made of such places have no
    place to be corrected at.
    """

    name, domain, mechanism = "lens_distortion", "data", "lens"
    summary = "the lens bends straight lines"
    parameters = (
        Parameter("lens_distortion.curvature", "1/m2", 0.0, -0.2, 0.2, 0.0, 0.005, about="k, of the radial distortion"),
        Parameter("lens_distortion.x", "m", 0.0, -20.0, 20.0, 0.0, 0.2, about="c, under the camera", shape=True),
        Parameter("lens_distortion.y", "m", 0.0, -20.0, 20.0, 0.0, 0.2, about="c, under the camera", shape=True),
    )
    source = "Brown, Photogrammetric Engineering 37 (1971): close-range camera calibration, k_1"
    signature = "paths are too long or too short by a share that grows with the distance from one point"
    confirm = "film a straight edge along the border of the image"
    fingerprint = Fingerprint(exponent=0.0, odd=None, part="everywhere")

    def not_applicable(self, dataset: Dataset) -> str:
        """A lens acts on places."""
        seen = any(sensor.kind == "position" for trial in dataset.trials for sensor in trial.sensors)
        return "" if seen else "no place was measured, which a lens would move"

    def cannot_act(self, trial: Trial) -> str:
        """It moves what sensors of places read."""
        seen = any(sensor.kind == "position" for sensor in trial.sensors)
        return "" if seen else "it has no sensor of a place, which a lens would move"

    def camera(
        self, time: FloatArray, place: FloatArray, heading: FloatArray, values: Values, trial: Trial
    ) -> tuple[FloatArray, FloatArray]:
        """Move the places from or to the centre, and turn the headings with the image."""
        del time, trial
        k, centre = values["curvature"], np.array([values["x"], values["y"]])
        away = place - centre
        stretch = 1.0 + k * np.sum(away**2, axis=1)
        ahead = np.stack([np.cos(heading), np.sin(heading)], axis=1)
        seen = stretch[:, None] * ahead + 2.0 * k * np.sum(away * ahead, axis=1)[:, None] * away
        turned = np.arctan2(ahead[:, 0] * seen[:, 1] - ahead[:, 1] * seen[:, 0], np.sum(ahead * seen, axis=1))
        return centre + stretch[:, None] * away, heading + turned
