"""The elastic tail as a cause; its mechanics are tested with the equation of motion."""

from __future__ import annotations

import numpy as np
import pytest

from mjfish.data import Trial
from mjfish.effects import find
from mjfish.fish import Fish
from mjfish.model import Model, Prediction
from mjfish.numerics.arrays import FloatArray

TAIL = find("tail_compliance")


def _predict(fish: Fish, trial: Trial, compliance: float, damping: float = 0.02, **options: float) -> Prediction:
    model = Model(fish, (TAIL,), **options)
    values = model.values({"tail_compliance.compliance": compliance, "tail_compliance.damping": damping})
    return model.predict(trial, values)


def _rms(difference: FloatArray) -> float:
    return float(np.sqrt(np.mean(difference**2)))


def test_compliance_adds_to_the_fishs_own_and_damping_is_that_of_the_sum(pike: Fish, straight: Trial) -> None:
    soft = pike.model_copy(update={"tail_compliance": 0.25})
    whole = pike.model_copy(update={"tail_compliance": 0.75, "tail_damping": 0.05})
    found = _predict(soft, straight, 0.5, 0.05).velocity
    assert found.tobytes() == Model(whole).predict(straight, Model(whole).values()).velocity.tobytes()


def test_the_nominal_fish_is_left_rigid(pike: Fish) -> None:
    assert TAIL.body(pike, {"compliance": 0.3, "damping": 0.01}).tail_compliance == 0.3
    assert pike.tail_compliance == 0.0


LIGHT, HEAVY = {"c_m.tail": 0.02, "c_d.tail": 3.9}, {"c_m.tail": 2.5, "c_d.tail": 0.3}


@pytest.mark.parametrize(
    "coefficients", [pytest.param({}, marks=pytest.mark.slow), LIGHT, HEAVY], ids=["nominal", "light", "heavy"]
)
@pytest.mark.parametrize("damping", [0.005, pytest.param(0.02, marks=pytest.mark.slow), 0.2])
@pytest.mark.parametrize("compliance", [0.01, *(pytest.param(c, marks=pytest.mark.slow) for c in (0.05, 0.15)), 2.0])
def test_it_is_integrated_stably_and_accurately_wherever_a_fit_may_look(
    pike: Fish, turning: Trial, compliance: float, damping: float, coefficients: dict[str, float]
) -> None:
    """Drag on a light tail is stiffer than its spring. Catches a step chosen from the spring alone."""
    fish = pike.with_values(coefficients)
    coarse = _predict(fish, turning, compliance, damping)
    assert coarse.status == "ok"
    fine = _predict(fish, turning, compliance, damping, step=0.001)
    limit = 2e-3 * np.ptp(fine.velocity, axis=0)
    assert np.all(np.sqrt(np.mean((coarse.velocity - fine.velocity) ** 2, axis=0)) < limit)


def test_a_stiffer_tail_is_nearer_to_the_rigid_one(pike: Fish, straight: Trial) -> None:
    rigid = Model(pike).predict(straight, Model(pike).values()).velocity
    apart = [_rms(_predict(pike, straight, c).velocity - rigid) for c in (0.001, 0.01, 0.1)]
    assert apart[0] < 0.2 * apart[1] < 0.2 * apart[2]
    assert apart[2] > 0.05


def test_a_tail_too_stiff_to_integrate_diverges_with_a_status_that_names_its_parameters(
    pike: Fish, straight: Trial
) -> None:
    lost = _predict(pike, straight, 1e-9, 0.0)
    assert lost.status == "diverged"
    assert np.all(np.isnan(lost.velocity[-1]))
    assert "diverged at 0." in lost.message
    assert "c_m.tail = 0.06" in lost.message
    assert "tail_compliance.compliance = 1e-09, tail_compliance.damping = 0" in lost.message
