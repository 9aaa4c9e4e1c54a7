"""A lens that bends straight lines."""

from __future__ import annotations

import numpy as np

from mjfish.effects.effect import Fingerprint, PictureForm, Values
from mjfish.numerics.arrays import FloatArray
from mjfish.parameters import Parameter


class LensDistortion(PictureForm):
    """A place p is seen at c + (1 + k |p - c|^2) (p - c): radial distortion about the point c under the camera.

    k > 0 draws the edge of the image outwards (pincushion), k < 0 inwards (barrel). A heading turns with the image: the
    direction e becomes (1 + k r^2) e + 2 k (r . e) r, r = p - c.
    """

    name, mechanism = "lens_distortion", "lens"
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

    def picture(self, away: FloatArray, ahead: FloatArray, values: Values) -> tuple[FloatArray, FloatArray]:
        """Move the places from or to the centre."""
        k = values["curvature"]
        stretch = 1.0 + k * np.sum(away**2, axis=1, keepdims=True)
        return stretch * away, stretch * ahead + 2.0 * k * np.sum(away * ahead, axis=1, keepdims=True) * away
