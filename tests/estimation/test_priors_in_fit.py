"""Priors in a fit, on a linear problem whose answer is known in closed form."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from linear_problem import Linear, linear, names

from mjfish.effects import find
from mjfish.estimation import Noise, Problem, fit
from mjfish.fish import Fish
from mjfish.model import Model
from mjfish.numerics.arrays import FloatArray
from mjfish.parameters.prior import Prior, about, smooth_curve

COUNT = 6


@pytest.fixture(scope="module")
def posed() -> Linear:
    """Twenty measurements of six numbers, a smooth curve of five of them and a lone one."""
    rng = np.random.default_rng(5)
    alone = Prior("alone", ("toy.p5",), np.eye(1), 0.2)
    curve = smooth_curve("curve", names(5), 0.3, 0.7)
    return linear(rng.normal(size=(20, COUNT)), 3.0 * rng.normal(size=20), (*curve, alone))


def _rows(posed: Linear) -> FloatArray:
    """Return the rows of all priors, put together by hand."""
    differences = np.concatenate([np.diff(np.eye(5), n=2, axis=0) / 0.3, np.diff(np.eye(5), axis=0) / 0.7])
    level = np.full((1, 5), 0.2) / next(prior.sd for prior in posed.priors if prior.name == "curve.level")
    rows = np.zeros((9, COUNT))
    rows[:7, :5], rows[7, :5], rows[8, 5] = differences, level, 1.0 / 0.2
    return rows


def test_rows_stand_in_the_columns_of_their_parameters_in_units_of_the_sd(posed: Linear) -> None:
    alone = next(prior for prior in posed.priors if prior.name == "alone")
    assert posed.prior_rows(alone).tolist() == [[0.0, 0.0, 0.0, 0.0, 0.0, 5.0]]
    root = posed.prior_root
    np.testing.assert_allclose(root.T @ root, _rows(posed).T @ _rows(posed), rtol=1e-12, atol=1e-12)


def test_a_fixed_parameter_has_no_column_and_an_sd_may_be_another(posed: Linear) -> None:
    alone = next(prior for prior in posed.priors if prior.name == "alone")
    held = replace(posed, fixed={**posed.fixed, "toy.p0": 0.0})
    assert held.prior_rows(alone).tolist() == [[0.0, 0.0, 0.0, 0.0, 5.0]]
    assert not replace(posed, fixed={**posed.fixed, "toy.p5": 0.0}).prior_rows(alone).any()
    wider = replace(posed, prior_sds={"alone": 2.0})
    assert {prior.name: prior.sd for prior in wider.priors}["alone"] == 2.0
    assert wider.prior_root[-1].tolist() == [0.0, 0.0, 0.0, 0.0, 0.0, 0.5]


def test_the_fit_is_the_ridge_solution(posed: Linear) -> None:
    """The estimate is (A'A + R'R)^-1 A'y, with the covariance (A'A + R'R)^-1."""
    found, rows = fit(posed), _rows(posed)
    inverse = np.linalg.inv(posed.design.T @ posed.design + rows.T @ rows)
    np.testing.assert_allclose(found.x, inverse @ posed.design.T @ posed.data, rtol=0.0, atol=1e-7)
    np.testing.assert_allclose(found.covariance, inverse, rtol=1e-9, atol=1e-12)
    without = np.linalg.lstsq(posed.design, posed.data)[0]
    assert np.abs(found.x - without).max() > 0.1
    np.testing.assert_allclose(found.reach, np.sqrt(np.diag(inverse)), rtol=1e-9)


def test_a_prior_draws_to_its_mean() -> None:
    """Of one number measured once, x = 3 with sd 1, and known as 1 with sd 0.5: the mean weighed by precision, 1.4."""
    posed = linear(np.ones((1, 1)), np.array([3.0]), (about("known", names(1), 1.0, 0.5),))
    found = fit(posed)
    assert found.x == pytest.approx([(3.0 + 4.0 * 1.0) / 5.0], abs=1e-6)
    assert found.penalty == pytest.approx((0.4 / 0.5) ** 2, rel=1e-5)
    assert found.cost == pytest.approx(found.objective, rel=1e-9)


def test_what_a_fit_says_of_the_data_is_of_the_data_alone(posed: Linear) -> None:
    """Catches rows of priors among the residuals: tests of whiteness and scores would count them."""
    found = fit(posed)
    np.testing.assert_allclose(found.residual, posed.data - posed.design @ found.x, rtol=0.0, atol=1e-12)
    assert found.sse == pytest.approx(float(found.residual @ found.residual), rel=1e-12)
    assert found.jacobian.shape == posed.design.shape
    assert found.penalty == pytest.approx(float(np.sum((_rows(posed) @ found.x) ** 2)), rel=1e-9)
    assert found.penalty > 0.1
    assert found.objective == found.sse + found.penalty
    assert found.cost == pytest.approx(found.objective, rel=1e-9)


def test_on_a_bound_too(posed: Linear) -> None:
    """An estimate that is put onto its bound has the residual of that place."""
    wanted = fit(posed).values["toy.p5"]
    p = next(p for p in posed.parameters if p.name == "toy.p5")
    bound = p.rebound(high=wanted - 0.05) if wanted > 0.0 else p.rebound(low=wanted + 0.05)
    found = fit(replace(posed, declared={"toy.p5": bound}))
    assert found.at_bound[-1]
    np.testing.assert_allclose(found.residual, posed.data - posed.design @ found.x, rtol=0.0, atol=1e-12)


def test_a_problem_without_priors_is_as_before(posed: Linear) -> None:
    bare = linear(posed.design, posed.data, ())
    found = fit(bare)
    assert bare.prior_root.shape == (0, COUNT)
    assert (found.penalty, found.objective) == (0.0, found.sse)
    np.testing.assert_allclose(found.x, np.linalg.lstsq(posed.design, posed.data)[0], rtol=0.0, atol=1e-7)


def test_priors_of_a_learned_form_name_its_parameters(pike: Fish) -> None:
    """Every one that a prior names is there, and every amplitude has one; a shape may have one."""
    for name in ("drag_law", "lift", "reactive_force"):
        posed = Problem(Model(pike, (find(name),)), (), Noise.white(np.ones(3)))
        amplitudes = {p.name for p in posed.model.effects[0].parameters if not p.shape}
        every = {p.name for p in posed.model.effects[0].parameters}
        named = {of for prior in posed.priors for of in prior.parameters}
        assert amplitudes <= named <= every
        columns = {p.name for p, used in zip(posed.parameters, posed.prior_root.any(axis=0), strict=True) if used}
        assert columns == named
