"""Pictures without a window: what is where it is put, in its colour, seen from where the camera is."""

from __future__ import annotations

import ctypes.util
import sys
from typing import Any

import numpy as np
import pytest
from gl import TETRAHEDRON, skip_without_gl

from mjfish.errors import InputError
from mjfish.mujoco.offscreen import Stage, Strokes
from mjfish.numerics.arrays import FloatArray

RED, GREEN = (230, 30, 30, 255), (30, 230, 30, 255)
SIZE = 120


def _picture(place: list[list[float]], strokes: list[Strokes], camera: dict[str, Any]) -> FloatArray:
    skip_without_gl()
    bodies = [(TETRAHEDRON, colour) for colour in (RED, GREEN)]
    with Stage(bodies, width=SIZE, height=SIZE, floor=-1.0, spacing=0.5, extent=2.0) as stage:
        turn = np.tile([0.0, 0.0, 0.0, 1.0], (2, 1))
        return stage.picture(np.array(place), turn, strokes, **camera).astype(float)


def _camera(target: tuple[float, float, float], distance: float, azimuth: float, elevation: float) -> dict[str, Any]:
    return {"target": np.array(target), "distance": distance, "azimuth": azimuth, "elevation": elevation}


def _where(picture: FloatArray, channel: int) -> tuple[float, float]:
    """Return the mean row and column of pixels in which one channel of colour stands out."""
    others = [k for k in range(3) if k != channel]
    rows, columns = np.nonzero(picture[..., channel] > 1.6 * picture[..., others].max(axis=2))
    assert len(rows) > 20
    return float(rows.mean()), float(columns.mean())


def test_bodies_are_where_they_are_put() -> None:
    """Looking along y from above: x runs to the right, y upwards."""
    seen = _picture([[-0.4, 0.0, 0.0], [0.4, 0.3, 0.0]], [], _camera((0.0, 0.0, 0.0), 2.0, 90.0, -70.0))
    (red_row, red_column), (green_row, green_column) = _where(seen, 0), _where(seen, 1)
    assert red_column < 0.4 * SIZE < 0.6 * SIZE < green_column
    assert green_row < red_row - 5


def test_the_camera_turns_and_looks_at_its_target() -> None:
    from_behind = _picture([[-0.4, 0.0, 0.0], [0.4, 0.0, 0.0]], [], _camera((0.0, 0.0, 0.0), 2.0, -90.0, -70.0))
    assert _where(from_behind, 0)[1] > _where(from_behind, 1)[1]
    centred = _picture([[-0.4, 0.0, 0.0], [0.4, 0.0, 0.0]], [], _camera((-0.4, 0.0, 0.0), 1.5, 90.0, -70.0))
    assert _where(centred, 0)[1] == pytest.approx(0.5 * SIZE, abs=5)


def test_an_arrow_is_drawn_from_its_start_to_its_end() -> None:
    arrow = Strokes(np.array([[0.0, 0.0, 0.0]]), np.array([[0.5, 0.0, 0.0]]), 0.03, (60, 60, 255, 255), arrows=True)
    far, camera = [[0.0, 50.0, 0.0]] * 2, _camera((0.0, 0.0, 0.0), 2.0, 90.0, -60.0)
    without, seen = _picture(far, [], camera), _picture(far, [arrow], camera)
    columns = np.nonzero(np.abs(seen - without).max(axis=(0, 2)) > 30)[0]
    middle, scale = 0.5 * SIZE, 0.5 * SIZE / (2.0 * np.tan(np.radians(20.0)))
    assert columns.min() == pytest.approx(middle, abs=4)
    assert columns.max() == pytest.approx(middle + 0.5 * scale, abs=6)


@pytest.mark.skipif(sys.platform != "linux", reason="EGL and OSMesa are of Linux")
def test_a_machine_without_opengl_is_told_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("MUJOCO_GL", raising=False)
    monkeypatch.setattr(ctypes.util, "find_library", lambda _name: None)
    with pytest.raises(InputError, match=r"no OpenGL that draws without a window.*Debian: libegl1"):
        Stage([(TETRAHEDRON, RED)], width=8, height=8, floor=-1.0, spacing=0.5, extent=1.0)


def test_an_opengl_that_does_not_start_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MUJOCO_GL", "osmesa")
    monkeypatch.setitem(sys.modules, "mujoco.osmesa", None)  # importing it raises ImportError
    with pytest.raises(InputError, match=r"OpenGL does not start by mujoco\.osmesa.*MUJOCO_GL"):
        Stage([(TETRAHEDRON, RED)], width=8, height=8, floor=-1.0, spacing=0.5, extent=1.0)
