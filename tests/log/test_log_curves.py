"""The curves of a diagnosis in its log, read back from where they are drawn."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from diagnosed import SPEEDS, diagnosis, drag_curve, learned_diagnosis
from logs import entities, text
from rerun.chunk import RrdReader

from mjfish.reporting.curves import span, stretches
from mjfish.reporting.log import write_log
from mjfish.reporting.log.curves import FRAME, form_tab, placed_in_frame

BODY = "/curves/drag_law/c_d-body"


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The log of a diagnosis that names a drag law."""
    path = tmp_path_factory.mktemp("log") / "fish.rrd"
    write_log(learned_diagnosis(), path)
    return path


def _static(path: Path, entity: str, component: str) -> list:
    """Return the instances of a static component."""
    for chunk in RrdReader(path).stream().filter(content=entity).to_chunks():
        batch = chunk.to_record_batch()
        if component in batch.schema.names:
            return list(batch.column(component).to_pylist()[0])
    raise AssertionError(f"{entity} has no {component}")


def _read(points: list) -> tuple[np.ndarray, np.ndarray]:
    """Return speed and coefficient of points in the frame of the body's curve."""
    x, y = np.array(points).T
    low, high = span(drag_curve())
    first, last = np.log(SPEEDS[[0, -1]])
    return np.exp(first + (last - first) * x / FRAME[0]), low + (high - low) * (1.0 - y / FRAME[1])


def test_the_curve_and_its_band_are_drawn_where_the_runs_have_been(log: Path) -> None:
    strips = _static(log, f"{BODY}/seen", "LineStrips2D:strips")
    piece = next(piece for piece in stretches(drag_curve()) if piece.seen)
    assert len(strips) == 3
    for strip, values in zip(strips, (piece.y, piece.low, piece.high), strict=True):
        speed, y = _read(strip)
        np.testing.assert_allclose(speed, piece.x, rtol=1e-5)
        np.testing.assert_allclose(y, values, rtol=1e-5)


def test_beyond_them_it_is_another_entity_and_stays_in_the_frame(log: Path) -> None:
    strips = _static(log, f"{BODY}/beyond", "LineStrips2D:strips")
    below, _, above = stretches(drag_curve())
    assert [len(strip) for strip in strips] == [*[len(below.x)] * 3, *[len(above.x)] * 3]
    low, high = span(drag_curve())
    speed, y = _read(strips[0])
    np.testing.assert_allclose(speed, below.x, rtol=1e-5)
    np.testing.assert_allclose(y, np.clip(below.y, low, high), rtol=1e-5)
    assert below.y.max() > high  # so something was cut
    assert "/curves/drag_law/c_f-head/seen" not in entities(log)  # no run has been there


def test_the_nominal_model_is_drawn_too(log: Path) -> None:
    speed, y = _read(_static(log, f"{BODY}/nominal", "LineStrips2D:strips")[0])
    np.testing.assert_allclose(speed, SPEEDS, rtol=1e-5)
    np.testing.assert_allclose(y, 2.0, rtol=1e-5)


def test_labels_tell_the_ends_of_the_curve_and_of_what_was_seen(log: Path) -> None:
    labels = _static(log, f"{BODY}/labels", "Points2D:labels")
    assert labels[:4] == ["0.046", "0.46", "0.010", "1.0"]
    low, high = span(drag_curve())
    shown = [float(label) for label in labels[4:]]
    assert len(shown) >= 2
    assert all(low <= y <= high for y in shown)
    marks = _static(log, f"{BODY}/frame", "LineStrips2D:strips")[1:]
    assert len(marks) == len(labels)
    _, y = _read([np.mean(mark, axis=0) for mark in marks[4:]])
    np.testing.assert_allclose(y, shown, rtol=1e-4)


def test_every_curve_is_in_the_log_and_is_told_in_words(log: Path) -> None:
    found = entities(log)
    (mechanism,) = learned_diagnosis().mechanisms
    said = text(log, "/curves/about", "TextDocument:text")
    assert said.startswith("**drag_law: these data do not settle its form: reynolds_drag or linear")
    for curve in mechanism.curves:
        assert f"/curves/drag_law/{curve.quantity}-{curve.group}/nominal" in found
        assert f"\n- {curve.summary()}\n" in said


def test_the_tab_has_a_view_a_curve() -> None:
    (mechanism,) = learned_diagnosis().mechanisms
    tab = form_tab([mechanism])
    assert tab is not None
    said, grid = tab.contents
    assert said.origin == "/curves/about"
    assert [view.origin for view in grid.contents] == [
        f"/curves/drag_law/{curve.quantity}-{curve.group}" for curve in mechanism.curves
    ]
    assert grid.contents[1].name == "c_d of body over speed [m/s]"


def test_without_curves_there_is_neither_tab_nor_entity(tmp_path: Path) -> None:
    write_log(diagnosis(), tmp_path / "fish.rrd")
    assert not any(entity.startswith("/curves") for entity in entities(tmp_path / "fish.rrd"))
    assert form_tab(()) is None


def test_what_is_outside_the_frame_is_on_its_edge() -> None:
    curve = drag_curve()
    placed = placed_in_frame(curve, np.array([SPEEDS[0], SPEEDS[-1]]), np.array([1e3, -1e3]))
    np.testing.assert_allclose(placed, [[0.0, 0.0], FRAME], atol=1e-9)
