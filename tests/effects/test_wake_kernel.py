"""The learned memory of the water: two lags of drag and added momentum."""

from __future__ import annotations

import numpy as np
import pytest
from link_forces import VALUES
from recovery import derivative_error

from mjfish.data import Trial
from mjfish.diagnosis import curves
from mjfish.effects import find
from mjfish.fish import Fish
from mjfish.model import Model

KERNEL = find("wake_kernel")
NUMBERS = {"drag": 0.3, "late_drag": 0.2, "mass": 0.6, "late_mass": -0.3, "time": 0.05, "late_time": 0.3}


def _full(effect: str, values: dict[str, float]) -> dict[str, float]:
    return VALUES | {f"{effect}.{short}": value for short, value in values.items()}


@pytest.mark.parametrize("time", [0.08, 0.5])
@pytest.mark.parametrize("name", ["wake_memory", "added_mass_memory"])
def test_one_share_alone_is_the_formula(pike: Fish, turning: Trial, name: str, time: float) -> None:
    """Of either lag, to rounding. Catches force and moment exchanged, or a lag with the time of the other."""
    values = {"share": 0.4, "time": time}
    like = KERNEL.like(name, values)
    assert set(like) == {"drag" if name == "wake_memory" else "mass", "time"} or time == 0.5
    model = Model(pike, (KERNEL,))
    found = model.predict(turning, model.values(_full("wake_kernel", like))).velocity
    formula = Model(pike, (find(name),))
    expected = formula.predict(turning, formula.values(_full(name, values))).velocity
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-9 * np.abs(expected).max())


def test_a_time_beyond_both_lags_is_the_nearest_one_and_another_formula_is_unknown() -> None:
    assert KERNEL.like("wake_memory", {"share": 0.4, "time": 0.01}) == {"drag": 0.4, "time": 0.02}
    assert KERNEL.like("another", {}) == {}


def test_after_a_sudden_start_drag_and_momentum_come_by_the_kernel(pike: Fish, turning: Trial) -> None:
    """As it is read off a link that is set in motion: c_d (1 - sum psi exp(-t / tau)), c_m (1 + sum chi (1 - ...))."""
    model = Model(pike, (KERNEL,))
    fish = curves._Fish.of(model, _full("wake_kernel", NUMBERS), turning)
    time = np.array([0.01, 0.05, 0.1, 0.3, 0.9])
    early, late = np.exp(-time / NUMBERS["time"]), np.exp(-time / NUMBERS["late_time"])
    for index, link in enumerate(pike.links):
        drag, mass = (curves._response(kind, index, pike, fish, time) for kind in ("c_d", "c_m"))
        np.testing.assert_allclose(drag, VALUES[f"c_d.{link.group}"] * (1.0 - 0.3 * early - 0.2 * late), rtol=1e-4)
        expected = VALUES[f"c_m.{link.group}"] * (1.0 + 0.6 * (1.0 - early) - 0.3 * (1.0 - late))
        np.testing.assert_allclose(mass, expected, rtol=1e-4)


@pytest.mark.parametrize("short", NUMBERS)
def test_its_derivatives(pike: Fish, turning: Trial, short: str) -> None:
    assert derivative_error(pike, turning, KERNEL, NUMBERS, short) < 1e-6
