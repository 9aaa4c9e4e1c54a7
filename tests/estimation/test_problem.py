"""Residuals, which samples count, and derivatives."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest
from pike_coefficients import COEFFICIENTS
from synthetic_swimming import SIGMA, TRUTH, as_measured, problem, swimming

from mjfish.data import Dataset, Trial
from mjfish.drive.cpg import DriveSegment
from mjfish.effects import catalogue
from mjfish.estimation import Problem
from mjfish.estimation.problem import nuisances
from mjfish.fish import Fish
from mjfish.fish.frames import CHANNELS
from mjfish.model import MARGIN, Model
from mjfish.noise import Autoregressive
from mjfish.numerics.arrays import FloatArray, readonly


@pytest.fixture(scope="module")
def synthetic(pike: Fish) -> Dataset:
    return swimming(pike, ("v1", "v3"), duration=2.0)


@pytest.fixture(scope="module")
def posed(synthetic: Dataset) -> Problem:
    return problem(synthetic)


@pytest.fixture(scope="module")
def measured(synthetic: Dataset, pike: Fish) -> Trial:
    return as_measured(synthetic.trials[0], pike)


def _turning(synthetic: Dataset) -> Trial:
    drive = (*synthetic.trials[0].drive, DriveSegment(1.0, 18.0, (0.0, 1.0, 1.5, 2.0)))
    return replace(synthetic.trials[0], drive=drive)


def _fourth_order(posed: Problem, x: FloatArray, column: int, h: float) -> FloatArray:
    """Return the derivative of the whitened prediction by central differences of fourth order."""

    def shifted(steps: float) -> FloatArray:
        moved = x.copy()
        moved[column] += steps * h
        return -posed.residual(moved)

    return (8.0 * (shifted(1.0) - shifted(-1.0)) - (shifted(2.0) - shifted(-2.0))) / (12.0 * h)


def test_residuals_are_measured_minus_predicted_in_units_of_sigma(posed: Problem) -> None:
    x = posed.start(TRUTH)
    stacked = posed.residual(x).reshape(-1, 3)
    by_hand = np.concatenate([(t.velocity - posed.model.predict(t, TRUTH).velocity) / SIGMA for t in posed.trials])
    np.testing.assert_allclose(stacked, by_hand, rtol=0.0, atol=1e-10)
    np.testing.assert_allclose(np.concatenate(posed.raw(x)), by_hand * SIGMA, rtol=0.0, atol=1e-12)
    predicted = posed.predictions(x)
    np.testing.assert_array_equal(predicted[0], posed.model.predict(posed.trials[0], TRUTH).velocity)
    assert abs(stacked.std() - 1.0) < 0.2


def test_free_parameters_are_the_models_without_the_fixed_ones_as_declared(posed: Problem, pike: Fish) -> None:
    c_d = next(p for p in pike.parameters if p.name == "c_d.head").rebound(high=3.0, start=1.0)
    one = replace(posed, fixed={"c_m.head": 0.4}, declared={"c_d.head": c_d})
    assert [p.name for p in one.parameters] == list(COEFFICIENTS[1:])
    start = dict(zip(COEFFICIENTS[1:], one.start({"c_m.body": 0.7}), strict=True))
    assert (start["c_m.body"], start["c_d.head"], start["c_d.body"]) == (0.7, 1.0, 2.0)
    assert one.named(one.start())["c_m.head"] == 0.4


@pytest.mark.parametrize("column", range(9), ids=COEFFICIENTS)
def test_the_jacobian_is_the_derivative_of_the_prediction(posed: Problem, column: int) -> None:
    x = posed.start(TRUTH)
    exact = _fourth_order(posed, x, column, 0.02 * posed.parameters[column].scale)
    found = posed.jacobian(x).dense()[:, column]
    assert np.linalg.norm(found - exact) < 1e-6 * np.linalg.norm(exact)


def test_the_jacobian_of_every_effect_is_the_derivative_of_the_prediction(synthetic: Dataset) -> None:
    """All formulas on at once, each by two scales, a limit by six: below it joints do not feel it; play by one.

    Catches a hook that loses a derivative that went in. Left out are random causes; learned forms, which repeat them;
    and a second form of the tail, whose damping takes the place of the first one's: tests/model/test_sensitivity.py.
    """
    causes = (
        effect
        for name, effect in catalogue().items()
        if not (effect.learned or effect.random or name == "tail_hardening")
    )
    effects = tuple(effect for effect in causes if not effect.not_applicable(synthetic))
    posed = problem(replace(synthetic, trials=synthetic.trials[1:]), model=Model(synthetic.fish, effects), fixed=TRUTH)
    names = [p.name for p in posed.parameters]
    assert names == [p.name for effect in effects for p in effect.parameters]
    scales = {"servo_rate_limit.slowness": 6.0, "servo_limited_lag.slowness": 6.0}
    scales |= {p.name: 1.0 for p in posed.parameters if p.group == "servo_backlash"}
    x = posed.start({p.name: p.default + scales.get(p.name, 2.0) * p.scale for p in posed.parameters if not p.shape})
    found = posed.jacobian(x).dense()
    for column, p in enumerate(posed.parameters):
        exact = _fourth_order(posed, x, column, 5e-4 * p.scale)
        assert np.linalg.norm(exact) * p.scale > 0.01, p.name
        assert np.linalg.norm(found[:, column] - exact) < 1e-3 * np.linalg.norm(exact), p.name


@pytest.mark.parametrize(
    ("name", "limit"),
    [
        # servo_lag has no derivative there: its joints start at rest however short it is, see its docstring.
        ("reynolds_drag.friction", 0.05),
        ("reynolds_drag.pressure", 0.05),
        ("tail_compliance.compliance", 0.25),  # rings after the start, at a frequency that goes with its size
    ],
)
def test_at_a_null_value_that_is_a_bound_the_derivative_is_one_sided_and_right(
    synthetic: Dataset, name: str, limit: float
) -> None:
    """By Richardson's extrapolation of ever smaller one-sided differences. Catches a step across the bound."""
    effect = catalogue()[name.partition(".")[0]]
    posed = problem(synthetic, model=Model(synthetic.fish, (effect,)), fixed=TRUTH)
    column = [p.name for p in posed.parameters].index(name)
    x, scale = posed.start(), posed.parameters[column].scale

    def one_sided(h: float) -> FloatArray:
        moved = x.copy()
        moved[column] += h
        return (posed.residual(x) - posed.residual(moved)) / h

    rough = [one_sided(share * scale) for share in (0.2, 0.1, 0.05)]
    once = [2.0 * b - a for a, b in itertools.pairwise(rough)]
    exact = (4.0 * once[1] - once[0]) / 3.0
    found = posed.jacobian(x).dense()[:, column]
    assert np.linalg.norm(found - exact) < limit * np.linalg.norm(exact)


def test_nuisance_parameters_of_one_trial_do_not_move_another(posed: Problem, measured: Trial) -> None:
    other = replace(measured, name="other")
    both = replace(posed, trials=(measured, other), free_clock=True)
    names = [p.name for p in both.parameters]
    own = [
        f"{trial}:{what}"
        for trial in ("v1", "other")
        for what in ("start.surge", "start.sway", "start.yaw_rate", "clock.offset")
    ]
    assert names == [*COEFFICIENTS, *own]
    x = both.start(TRUTH)
    jacobian = both.jacobian(x).dense()[: both.measured]
    half = len(jacobian) // 2
    assert not np.any(jacobian[half:, 9:13])
    assert not np.any(jacobian[:half, 13:17])
    for column in (9, 10, 11, 12):
        exact = _fourth_order(both, x, column, 0.02 * both.parameters[column].scale)[: both.measured]
        assert np.linalg.norm(exact) > 1.0
        assert np.linalg.norm(jacobian[:, column] - exact) < 1e-3 * np.linalg.norm(exact)


def test_only_the_asked_for_sensitivities_are_returned(posed: Problem) -> None:
    x = posed.start(TRUTH)
    whole, part = posed.slopes(x).velocity, posed.slopes(x, ["c_f.head", "c_m.body"]).velocity
    assert part[0].shape == (len(posed.trials[0].time), 3, 2)
    for a, b in zip(whole, part, strict=True):
        np.testing.assert_array_equal(b, a[:, :, [1, 6]])


def test_samples_beside_a_step_of_the_drive_do_not_count(posed: Problem, synthetic: Dataset) -> None:
    trial = _turning(synthetic)
    mask = replace(posed, trials=(trial,)).mask(0)
    np.testing.assert_allclose(trial.time[~mask], [0.98, 1.0, 1.02])


def test_the_ends_of_measured_joint_angles_do_not_count(posed: Problem, measured: Trial) -> None:
    mask = replace(posed, trials=(measured,)).mask(0)
    assert measured.time[mask][0] == pytest.approx(1.0 + MARGIN)
    assert measured.time[mask][-1] == pytest.approx(2.0 - MARGIN)


def test_only_samples_inside_the_window_count(posed: Problem) -> None:
    windowed = replace(posed, windows=((0.5, 1.0), None))
    np.testing.assert_allclose(posed.trials[0].time[windowed.mask(0)][[0, -1]], [0.5, 1.0])
    assert np.all(windowed.mask(1))
    assert len(windowed.residual(posed.start(TRUTH))) == 3 * (26 + 101)


def test_a_trial_that_diverges_has_residuals_worse_than_any_and_a_complaint(posed: Problem) -> None:
    x = posed.start({**TRUTH, "c_d.tail": 1e8})
    residual = posed.residual(x)
    assert residual.shape == posed.residual(posed.start(TRUTH)).shape
    assert np.all(residual == 1e3)
    assert np.all(np.isfinite(posed.jacobian(x).dense()))
    assert "v1 diverged at 0." in posed.divergence(x)
    assert posed.divergence(posed.start(TRUTH)) == ""


def test_residuals_and_jacobian_are_whitened_alike(posed: Problem) -> None:
    phi = readonly(np.tile([0.5, 0.2], (3, 1)))
    coloured = replace(posed, noise=Autoregressive(readonly(SIGMA), phi))
    x = posed.start(TRUTH)
    assert len(coloured.residual(x)) == 2 * 3 * 101
    assert coloured.jacobian(x).shape == (2 * 3 * 101, 9)
    exact = _fourth_order(coloured, x, 3, 0.02 * posed.parameters[3].scale)
    assert np.linalg.norm(coloured.jacobian(x).dense()[:, 3] - exact) < 1e-5 * np.linalg.norm(exact)


def test_a_trial_from_rest_on_a_good_clock_has_no_nuisance_parameters(posed: Problem, measured: Trial) -> None:
    assert nuisances(posed.trials[0], free_clock=False) == ()
    declared = nuisances(measured, free_clock=True)
    assert [p.name for p in declared] == [*(f"v1:start.{channel}" for channel in CHANNELS), "v1:clock.offset"]
    assert [p.start for p in declared[:3]] == measured.velocity[0].tolist()


def test_samples_behind_a_gap_are_whitened_by_their_own_past(posed: Problem) -> None:
    """Across a gap a filter that counts rows would subtract the wrong past: samples behind it would be off."""
    trial = posed.trials[0]
    kept = np.r_[0:40, 43 : len(trial.time)]
    lacking = replace(trial, time=trial.time[kept], velocity=trial.velocity[kept], gaps=True)
    coloured = Autoregressive(readonly(SIGMA), readonly([[0.5, 0.2]] * 3))
    gapped = replace(posed, trials=(lacking,), noise=coloured)
    full = replace(posed, trials=(trial,), noise=coloured)
    found = gapped.residual(gapped.start(TRUTH)).reshape(-1, 3)
    expected = full.residual(full.start(TRUTH)).reshape(-1, 3)[kept]
    same = np.r_[0:40, 42 : len(kept)]  # two samples behind the gap lack a part of their past
    np.testing.assert_allclose(found[same], expected[same], atol=1e-9)
    assert np.all(found[40:42] != expected[40:42])
