"""The learned spring of the tail."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from pydantic import ValidationError
from recovery import derivative_error

from mjfish.data import Trial
from mjfish.diagnosis import curves
from mjfish.effects import find
from mjfish.fish import Fish
from mjfish.hydro.load import load_rows
from mjfish.model import Model
from mjfish.numerics.arrays import FloatArray

LAW = find("tail_law")


def _predict(fish: Fish, trial: Trial, name: str, values: dict[str, float], step: float = 0.005) -> FloatArray:
    model = Model(fish, (find(name),), step=step)
    found = model.predict(trial, model.values({f"{name}.{short}": value for short, value in values.items()}))
    assert found.status == "ok"
    return found.velocity


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("tail_compliance", {"compliance": 0.3, "damping": 0.03}),
        ("tail_hardening", {"compliance": 0.3, "damping": 0.03, "hardening": 40.0}),
    ],
)
def test_formulas_are_special_cases(pike: Fish, turning: Trial, name: str, values: dict[str, float]) -> None:
    learned = _predict(pike, turning, "tail_law", LAW.like(name, values))
    assert learned.tobytes() == _predict(pike, turning, name, values).tobytes()
    assert LAW.like("another", values) == {}


def test_the_moment_rises_with_the_deflection_whatever_its_numbers(pike: Fish) -> None:
    """At random numbers within the bounds, or on them; as its curve has it, too."""
    rng, deflection = np.random.default_rng(6), np.linspace(0.0, 2.0, 400)
    for draw in range(100):
        share = rng.uniform(size=4)
        share = np.round(share) if draw % 2 else share
        values = {p.short: p.low + s * (p.high - p.low) for p, s in zip(LAW.parameters, share, strict=True)}
        values["compliance"] = max(values["compliance"], 0.01)
        fish = LAW.body(pike, values)
        moment = deflection * (1.0 + fish.tail_quadratic * deflection + fish.tail_hardening * deflection**2)
        assert np.all(np.diff(moment) > -1e-12 * moment.max())
        Fish.model_validate({**fish.model_dump(by_alias=True)})
        shown = curves._moment(curves._Fish(SimpleNamespace(fish=fish), np.zeros(5), load_rows([])), deflection)
        np.testing.assert_allclose(shown, moment / values["compliance"], rtol=1e-12)


def test_a_spring_that_turns_back_is_refused(pike: Fish) -> None:
    with pytest.raises(ValidationError, match="tail_quadratic = -4 makes the moment of the tail fall"):
        Fish.model_validate({**pike.model_dump(by_alias=True), "tail_quadratic": -4.0, "tail_hardening": 5.0})


@pytest.mark.parametrize(
    "coefficients",
    [pytest.param({}, marks=pytest.mark.slow), {"c_m.tail": 0.02, "c_d.tail": 3.9}, {"c_m.tail": 2.5, "c_d.tail": 0.3}],
)
@pytest.mark.parametrize("compliance", [0.05, pytest.param(0.3, marks=pytest.mark.slow), 2.0])
@pytest.mark.parametrize("quadratic", [-10.0, 30.0])
def test_it_is_integrated_stably_and_accurately_wherever_a_fit_may_look(
    pike: Fish, turning: Trial, quadratic: float, compliance: float, coefficients: dict[str, float]
) -> None:
    values = {"compliance": compliance, "damping": 0.05, "quadratic": quadratic, "hardening": 30.0}
    fish = pike.with_values(coefficients)
    coarse = _predict(fish, turning, "tail_law", values)
    fine = _predict(fish, turning, "tail_law", values, 0.001)
    assert np.all(np.sqrt(np.mean((coarse - fine) ** 2, axis=0)) < 5e-3 * np.ptp(fine, axis=0))


@pytest.mark.parametrize("quadratic", [-4.0, 6.0])
@pytest.mark.parametrize("short", ["compliance", "damping", "quadratic", "hardening"])
def test_its_derivatives(pike: Fish, turning: Trial, short: str, quadratic: float) -> None:
    values = {"compliance": 0.3, "damping": 0.03, "quadratic": quadratic, "hardening": 20.0}
    assert derivative_error(pike, turning, LAW, values, short) < 1e-5
