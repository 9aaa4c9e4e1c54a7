"""Mass: a gauge that no refit of all nine coefficients can see, and any one known coefficient can."""

from __future__ import annotations

import numpy as np
import pytest
from pike_coefficients import COEFFICIENTS

from mjfish.data import Trial
from mjfish.drive import modes
from mjfish.effects import find
from mjfish.fish import Fish
from mjfish.model import Model
from mjfish.model.sensitivity import sensitivities
from mjfish.numerics.arrays import FloatArray

MASS = find("mass_error")
VALUES = dict(zip(COEFFICIENTS, (1.0, 0.5, 0.6, 2.0, 1.5, 2.5, 0.014, 0.01, 0.012), strict=True))


def _trials() -> list[Trial]:
    time = np.arange(301) / 50.0
    return [Trial(m, None, time, np.zeros((301, 3)), drive=modes.drive(m)) for m in ("v1", "v7", "v3-t2")]


def _columns(fish: Fish, at: float) -> tuple[FloatArray, FloatArray]:
    """Return the sensitivity (n,) to the mass error and those (n, 9) to the coefficients, times their values."""
    model = Model(fish, (MASS,))
    values = {**VALUES, "mass_error.error": at}
    names = ["mass_error.error", *COEFFICIENTS]
    blocks = [sensitivities(model, trial, values, names) for trial in _trials()]
    stacked = np.concatenate(blocks).reshape(-1, len(names))
    return stacked[:, 0], stacked[:, 1:] * np.array([VALUES[name] for name in COEFFICIENTS])


@pytest.mark.parametrize("error", [-0.3, 0.4])
def test_a_heavier_fish_swims_as_one_with_smaller_coefficients(pike: Fish, error: float) -> None:
    """V(m (1 + e), c) = V(m, c / (1 + e)), exactly, in a turn and in a change of it."""
    model = Model(pike, (MASS,))
    lighter = {name: value / (1.0 + error) for name, value in VALUES.items()}
    for trial in _trials():
        heavy = model.predict(trial, {**VALUES, "mass_error.error": error}).velocity
        same = model.predict(trial, {**lighter, "mass_error.error": 0.0}).velocity
        np.testing.assert_allclose(heavy, same, rtol=0.0, atol=1e-11)
        assert np.abs(heavy - model.predict(trial, {**VALUES, "mass_error.error": 0.0}).velocity).max() > 0.01


@pytest.mark.parametrize("at", [0.0, 0.2])
def test_its_sensitivity_is_that_of_all_coefficients_together(pike: Fish, at: float) -> None:
    """Euler: dV/de = -sum_k c_k dV/dc_k / (1 + e), to rounding. Catches a mass that scales without its inertia."""
    mass, coefficients = _columns(pike, at)
    expected = -coefficients.sum(axis=1) / (1.0 + at)
    assert np.abs(mass - expected).max() < 1e-9 * np.abs(mass).max()


def test_it_lies_in_the_span_of_nine_coefficients_and_not_in_that_of_eight(pike: Fish) -> None:
    """A refit of all nine leaves rounding of it; with any one held, more than noise of a thousandth would hide."""
    mass, coefficients = _columns(pike, 0.0)
    assert _left(mass, coefficients) < 1e-9
    for held in range(len(COEFFICIENTS)):
        assert _left(mass, np.delete(coefficients, held, axis=1)) > 2e-3, COEFFICIENTS[held]


def _left(column: FloatArray, columns: FloatArray) -> float:
    """Return the share of the length of a column that lies outside the span of the others."""
    solved = np.linalg.lstsq(columns, column, rcond=None)[0]
    return float(np.linalg.norm(column - columns @ solved) / np.linalg.norm(column))


def test_masses_and_inertias_grow_by_one_factor_and_the_rest_stays(pike: Fish) -> None:
    heavy = MASS.body(pike, {"error": 0.25})
    for before, after in zip(pike.links, heavy.links, strict=True):
        assert (after.mass, after.inertia) == (1.25 * before.mass, 1.25 * before.inertia)
        assert after.model_copy(update={"mass": before.mass, "inertia": before.inertia}) == before
    assert heavy.model_copy(update={"links": pike.links}) == pike
