"""Refits: what they count."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hidden_cases import draw

from mjfish.data import Trial
from mjfish.diagnosis.evidence import gather, signatures
from mjfish.diagnosis.failures import Parts, noting
from mjfish.diagnosis.refit import lowest, refit_with, refits
from mjfish.diagnosis.refit_result import Refit
from mjfish.diagnosis.result import estimates
from mjfish.drive import cpg
from mjfish.effects import find
from mjfish.estimation import Fit, Noise, Problem, fit
from mjfish.estimation.nominal import nominal_problem
from mjfish.estimation.problem import Slopes
from mjfish.estimation.sensor_noise import with_sensor_noise
from mjfish.fish import Fish, load_fish
from mjfish.model import Model
from mjfish.numerics.arrays import readonly
from mjfish.simulation.synthetic import generate

SIGMA = readonly(np.array([0.006, 0.006, 0.04]))


def _measured(trial: Trial) -> Trial:
    """Return the trial with its joint angles in place of its drive: it need not begin at rest."""
    pike = load_fish("pike")
    motion = cpg.joint_motion(pike.cpg, trial.drive, float(trial.time[-1]) + 0.01, 0.005)
    return replace(trial, drive=(), joint_angle=readonly(motion.angle_at(trial.time)))


@pytest.mark.parametrize(("measured", "freedom"), [(False, 3), (True, 2)])
def test_a_shape_that_the_data_do_not_feel_is_no_parameter(measured: bool, freedom: int) -> None:
    """Whether a fish was held in the current shows where it began at rest, and nowhere else."""
    pike, current = load_fish("pike"), find("ambient_current")
    values = {"ambient_current.x": 0.03, "ambient_current.y": -0.02, "ambient_current.held": 1.0}
    dataset = generate(pike, ["v1-t2"], values=values, effects=[current], noise=SIGMA, duration=7.0, seed=3)
    trials = tuple(map(_measured, dataset.trials)) if measured else dataset.trials
    problem = Problem(Model(pike), trials, Noise.white(SIGMA))
    one = refit_with(gather(problem, fit(problem), [current]), current)
    assert one.degrees_of_freedom == freedom
    assert one.adjusted == one.gain - 2.0 * (freedom - 1)


def test_a_shape_that_the_data_do_not_feel_has_its_default() -> None:
    pike, current = load_fish("pike"), find("ambient_current")
    values = {"ambient_current.x": 0.03, "ambient_current.y": -0.02}
    dataset = generate(pike, ["v1-t2"], values=values, effects=[current], noise=SIGMA, duration=7.0, seed=3)
    problem = Problem(Model(pike), tuple(map(_measured, dataset.trials)), Noise.white(SIGMA))
    one = refit_with(gather(problem, fit(problem), [current]), current)
    told = estimates(one.fit, one.problem.model)["ambient_current.held"]
    assert one.fit.values["ambient_current.held"] != 0.0
    assert (told.estimate, told.low, told.high) == (0.0, 0.0, 1.0)


def test_a_formula_with_limits_begins_where_its_limit_ended(pike: Fish) -> None:
    """And is not tried where every limit is far behind: a hardening tail, where a linear spring explains little."""
    truth = {"ambient_current.x": 0.04}
    data = generate(
        pike, ["v1", "v3-t2"], values=truth, effects=[find("ambient_current")], noise=SIGMA, duration=7.0, seed=2
    )
    problem = Problem(Model(pike), data.trials, Noise.white(SIGMA))
    formulas = [find(name) for name in ("sheared_current", "ambient_current", "tail_hardening", "tail_compliance")]
    found = refits(gather(problem, fit(problem), formulas), formulas)
    assert set(found) == {"sheared_current", "ambient_current", "tail_compliance"}
    assert found["sheared_current"].gain > found["ambient_current"].gain - 1.0


@pytest.mark.slow
def test_a_rolling_fish_leaves_a_wrong_minimum_by_fits_to_ever_longer_stretches() -> None:
    """From the wrong one, twenty times as high, fits to whole runs do not come away."""
    case, roll = draw("roll_loss", "middling", 1, trials=3), find("roll_loss")
    noise = Noise.white(np.asarray(case.dataset.noise))
    problem = Problem(Model(case.dataset.fish, (roll,)), case.dataset.split()[0], noise)
    shapes = {"roll_loss.frequency": 14.0, "roll_loss.damping": 0.09, "roll_loss.inertial": 1.0}
    wrong = fit(problem, problem.start({"roll_loss.square": 0.3, **shapes}), tolerance=1e-5)
    assert wrong.sse > 20.0 * wrong.count
    found = lowest(Refit((roll,), problem, wrong, 100.0))
    assert found.fit.sse < 1.1 * found.fit.count
    assert found.gain == pytest.approx(100.0 + wrong.sse - found.fit.sse)
    for name, value in case.truth.items():
        if name.startswith("roll_loss."):
            assert found.fit.values[name] == pytest.approx(value, rel=0.05)
    assert lowest(found) is found


def _problem(pike: Fish) -> Problem:
    truth = {"servo_lag.time_constant": 0.02}
    data = generate(pike, ["v1"], values=truth, effects=[find("servo_lag")], noise=SIGMA, duration=4.0, seed=2)
    return Problem(Model(pike), data.trials, Noise.white(SIGMA))


def test_a_refit_that_runs_away_begins_again_at_the_declared_coefficients(
    monkeypatch: pytest.MonkeyPatch, pike: Fish
) -> None:
    """The nominal fit to a large misfit may have coefficients at which the fish goes out of control with a cause."""
    problem, starts = _problem(pike), []
    evidence = gather(problem, fit(problem), [find("servo_lag")])

    def first_lost(own: Problem, x: np.ndarray, **options: Any) -> Fit:
        starts.append(x)
        found = fit(own, x, **options)
        return replace(found, status="diverged") if len(starts) == 1 else found

    monkeypatch.setattr("mjfish.diagnosis.refit.fit_or_raise", first_lost)
    one = refit_with(evidence, find("servo_lag"))
    first, second = (one.problem.named(x) for x in starts)
    declared = one.problem.named(one.problem.start())
    assert {name: value for name, value in second.items() if value != declared[name]} == {
        "servo_lag.time_constant": first["servo_lag.time_constant"]
    }
    assert not one.fit.lost
    assert one.fit.values["servo_lag.time_constant"] == pytest.approx(0.02, abs=0.003)


@pytest.mark.parametrize(("name", "size"), [("servo_lag.time_constant", 0.07), ("servo_rate_limit.slowness", 0.39)])
def test_a_large_cause_is_found_where_the_nominal_fit_has_bent_the_coefficients(name: str, size: float) -> None:
    """Beside the bent ones no size explains anything: from there alone a fit leaves 70 times the noise and more."""
    truth, effect = {name: size}, find(name.partition(".")[0])
    data = generate(
        "pike", ["v1", "v3"], values=truth, noise=(1e-3, 1e-3, 0.005), seed=1, duration=6.5, observe="pose",
        joints="commanded",
    )  # fmt: skip
    problem = nominal_problem(data, data.trials, Noise.white(np.full(3, np.nan)))
    problem = with_sensor_noise(problem, problem.start())
    nominal = fit(problem, tolerance=1e-5)
    assert nominal.sse > 100.0 * nominal.count
    found = refit_with(gather(problem, nominal, [effect]), effect)
    assert found.fit.sse < 1.5 * found.fit.count
    assert found.fit.values[name] == pytest.approx(size, rel=0.15)


@pytest.mark.parametrize("everywhere", [False, True])
def test_a_cause_fails_only_if_its_derivatives_are_not_finite_at_the_declared_coefficients_either(
    monkeypatch: pytest.MonkeyPatch, pike: Fish, everywhere: bool
) -> None:
    problem, honest = _problem(pike), Problem.slopes
    bent = {"c_d.head": 3.0 * pike.values["c_d.head"]}

    def slopes(self: Problem, x: np.ndarray, only: Any = None) -> Slopes:
        found = honest(self, x, only)
        far = self.named(x)["c_d.head"] == bent["c_d.head"]
        return replace(found, lost=dict.fromkeys(only or (), "v1 at 1 s")) if everywhere or far else found

    monkeypatch.setattr(Problem, "slopes", slopes)
    if everywhere:
        with noting(Parts()) as parts:
            signatures(problem, bent, [find("servo_lag")])
        assert "not finite: v1 at 1 s;" in parts.failures["servo_lag"]
    else:
        assert signatures(problem, bent, [find("servo_lag")]).lost == {"servo_lag.time_constant": "v1 at 1 s"}
