"""Heights of the sections: nearly a gauge."""

from __future__ import annotations

import numpy as np
import pytest
from pike_coefficients import COEFFICIENTS

from mjfish.data import Trial
from mjfish.drive import modes
from mjfish.effects import find
from mjfish.fish import Fish
from mjfish.fish.outline import outlines
from mjfish.model import Model

HEIGHT = find("section_height")
VALUES = dict(zip(COEFFICIENTS, (1.0, 0.5, 0.6, 2.0, 1.5, 2.5, 0.014, 0.01, 0.012), strict=True))


def test_only_heights_grow(pike: Fish) -> None:
    other = HEIGHT.body(pike, {"error": 0.1})
    for before, after in zip(pike.sections, other.sections, strict=True):
        assert after.height == pytest.approx([1.1 * h for h in before.height], rel=1e-15)
        assert after.model_copy(update={"height": before.height}) == before
    assert other.model_copy(update={"sections": pike.sections}) == pike


def test_strips_added_mass_and_wetted_perimeter_follow(pike: Fish) -> None:
    """Height goes with 1 + e, added mass with its square, the perimeter of an ellipse with less than it."""
    for before, after in zip(outlines(pike), outlines(HEIGHT.body(pike, {"error": 0.1})), strict=True):
        np.testing.assert_allclose(after.strip_height, 1.1 * before.strip_height, rtol=1e-14)
        np.testing.assert_allclose(after.height_moment, 1.1 * before.height_moment, rtol=1e-13)
        np.testing.assert_allclose(after.added, 1.21 * before.added, rtol=1e-13)
        assert 1.03 < after.wetted / before.wetted < 1.1


def test_other_coefficients_are_the_same_fish_but_for_perimeters_that_share_one(pike: Fish) -> None:
    """c_d (1 + e), c_m (1 + e)^2, c_f by the wetted area. Catches a height that some table of moments misses."""
    error, higher = 0.1, HEIGHT.body(pike, {"error": 0.1})
    grown = {"head": [0], "body": [1, 2, 3], "tail": [4]}
    same = {}
    for name, value in VALUES.items():
        kind, _, group = name.partition(".")
        wet = [sum(o.wetted for o in np.array(outlines(f))[grown[group]]) for f in (pike, higher)]
        factor = {"c_d": 1.0 + error, "c_m": (1.0 + error) ** 2, "c_f": wet[1] / wet[0]}[kind]
        same[name] = value * factor
    time = np.arange(201) / 50.0
    trial = Trial("v3", None, time, np.zeros((201, 3)), drive=modes.drive("v3"))
    model = Model(pike, (HEIGHT,))
    high = model.predict(trial, {**VALUES, "section_height.error": error}).velocity
    refitted = model.predict(trial, {**same, "section_height.error": 0.0}).velocity
    nominal = model.predict(trial, {**VALUES, "section_height.error": 0.0}).velocity
    assert np.abs(high - nominal).max() > 0.02
    assert np.abs(high - refitted).max() < 1e-3 * np.abs(high - nominal).max()
