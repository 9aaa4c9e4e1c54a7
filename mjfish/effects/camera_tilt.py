"""A camera that does not look straight down."""

from __future__ import annotations

import numpy as np

from mjfish.effects.effect import Fingerprint, PictureForm, Values
from mjfish.numerics.arrays import FloatArray
from mjfish.parameters import Parameter


class CameraTilt(PictureForm):
    """A place p is seen at c + q / (1 + t . q), q = p - c: the picture of a plane by a tilted camera.

    t has the direction in which the camera looks away from straight down, and the length sin(angle) / D, with the
    distance D from the camera to the point c that it looks at. What is farther away is seen smaller. At c, scale and
    axes of the picture are right. A heading turns with the picture: the direction e becomes (1 + t . q) e - (t . e) q.
    """

    name, mechanism = "camera_tilt", "camera_tilt"
    summary = "the camera does not look straight down"
    parameters = (
        Parameter("camera_tilt.tilt_x", "1/m", 0.0, -0.1, 0.1, 0.0, 0.005, about="t, along x"),
        Parameter("camera_tilt.tilt_y", "1/m", 0.0, -0.1, 0.1, 0.0, 0.005, about="t, along y"),
        Parameter("camera_tilt.x", "m", 0.0, -20.0, 20.0, 0.0, 0.2, about="c, where the scale is right", shape=True),
        Parameter("camera_tilt.y", "m", 0.0, -20.0, 20.0, 0.0, 0.2, about="c, where the scale is right", shape=True),
    )
    source = "Hartley and Zisserman, Multiple View Geometry (2004), ch. 2: projective maps of a plane"
    signature = "paths are too long on one side of the tank and too short on the other"
    confirm = "film a bar of known length at two opposite walls of the tank"
    fingerprint = Fingerprint(exponent=0.0, odd=None, part="everywhere")

    def picture(self, away: FloatArray, ahead: FloatArray, values: Values) -> tuple[FloatArray, FloatArray]:
        """Divide by the distance along the line of sight."""
        tilt = np.array([values["tilt_x"], values["tilt_y"]])
        distance = 1.0 + away @ tilt[:, None]
        return away / distance, distance * ahead - (ahead @ tilt[:, None]) * away
