"""The picture of the README shows what a diagnosis holds."""

from __future__ import annotations

import importlib.util
import sys
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from diagnosed import diagnosis

from mjfish.diagnosis import Overlay

_SVG = "{http://www.w3.org/2000/svg}"


@pytest.fixture(scope="module")
def tool() -> ModuleType:
    path = Path(__file__).parents[2] / "tools" / "picture.py"
    spec = importlib.util.spec_from_file_location("picture", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["picture"] = module
    spec.loader.exec_module(module)
    return module


def _lines(svg: str, who: str) -> list[np.ndarray]:
    root = ET.fromstring(svg)  # noqa: S314 - our own text
    found = [line for line in root.iter(f"{_SVG}polyline") if line.get("class") == who]
    return [np.array([point.split(",") for point in (line.get("points") or "").split()], dtype=float) for line in found]


def test_curves_are_the_velocities_and_residuals_of_the_held_out_trial(tool: ModuleType) -> None:
    one = diagnosis()
    overlay = one.overlays[1]  # held out; the misfit is in yaw rate
    svg = tool.picture(one)
    scored = np.abs(overlay.trial.time - 1.2) > 0.03  # not beside the step of the drive
    velocity, left = _lines(svg, "before")
    for drawn, values in (
        (velocity, overlay.nominal[:, 2]),
        (left, overlay.trial.velocity[:, 2] - overlay.nominal[:, 2]),
    ):
        assert len(drawn) == np.count_nonzero(scored)
        assert np.corrcoef(drawn[:, 1], values[scored])[0, 1] < -0.9999  # pixels count downwards
        assert np.corrcoef(drawn[:, 0], overlay.trial.time[scored])[0, 1] > 0.9999
    after = _lines(svg, "after")[1]
    assert np.ptp(after[:, 1]) < 0.7 * np.ptp(left[:, 1])
    assert "Held-out run fast" in svg


def test_of_a_long_trial_the_stretch_is_drawn_where_the_nominal_model_is_worst(tool: ModuleType) -> None:
    one = diagnosis()
    overlay = one.overlays[1]
    time = np.linspace(0.0, 20.0, 1001)
    bad = np.zeros((len(time), 3))
    bad[600:700, 2] = 1.0
    still = replace(overlay.trial, time=time, velocity=np.zeros_like(bad) + np.sin(time)[:, None])
    predicted = still.velocity + bad, still.velocity
    overlay = Overlay.of(one.nominal_model, still, predicted, held_out=True)
    drawn = _lines(tool.picture(replace(one, overlays=(overlay,))), "before")[1]
    assert len(drawn) == pytest.approx(151, abs=1)  # three seconds
    assert np.count_nonzero(drawn[:, 1] > drawn[:, 1].mean()) == pytest.approx(100, abs=2)


def test_round_numbers_mark_the_axes(tool: ModuleType) -> None:
    np.testing.assert_allclose(tool._ticks(-0.52, 2.2, 4), [0.0, 1.0, 2.0])
    np.testing.assert_allclose(tool._ticks(0.013, 0.087, 4), [0.02, 0.04, 0.06, 0.08])
    assert not np.any(np.signbit(tool._ticks(-0.4, 1.0, 4)[tool._ticks(-0.4, 1.0, 4) == 0.0]))


def test_names_are_text_in_the_picture(tool: ModuleType) -> None:
    svg = tool.picture(diagnosis(names=("a", "<b>&")))
    assert "<b>" not in svg
    ET.fromstring(svg)  # noqa: S314 - our own text
