"""Tests of pictures need an OpenGL that draws without a window: EGL or OSMesa."""

from __future__ import annotations

import functools

import numpy as np
import pytest

from mjfish.errors import InputError
from mjfish.mujoco.offscreen import Mesh, Stage

#: A tetrahedron of 10 cm.
TETRAHEDRON = Mesh(
    0.1 * np.array([[1.0, 0.0, 0.0], [-1.0, 1.0, 0.0], [-1.0, -1.0, 0.0], [0.0, 0.0, 1.0]]),
    np.array([[0, 1, 3], [1, 2, 3], [2, 0, 3], [0, 2, 1]], dtype=np.uint32),
)


@functools.cache
def _reason() -> str:
    """Return why this machine cannot draw, or nothing."""
    try:
        with Stage([(TETRAHEDRON, (255, 0, 0, 255))], width=16, height=16, floor=-1.0, spacing=0.5, extent=1.0):
            return ""
    except InputError as error:
        return str(error)


def skip_without_gl() -> None:
    """Skip the test where there is no such OpenGL, and say why."""
    if _reason():
        pytest.skip(_reason())
