"""Gauss-Newton steps within bounds: the optimum that scipy finds, in few steps, and what ends a fit."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, get_args

import numpy as np
import pytest
from scipy.optimize import least_squares, lsq_linear

from mjfish.estimation.fit import LOSSES, Minimum, minimise
from mjfish.estimation.settings import Loss
from mjfish.numerics.arrays import FloatArray
from mjfish.numerics.block_angular import BlockAngular

Function = Callable[[FloatArray], FloatArray]


def _posed(residual: Function, derivative: Function, count: int) -> Any:
    """Return a problem whose residual (n,) has this derivative (n, p), and no priors."""
    return SimpleNamespace(
        residual=residual,
        lost_row=lambda whole: f"row {int(np.flatnonzero(~np.isfinite(whole))[0])}",
        jacobian=lambda x: BlockAngular.of(-derivative(x)),
        prior_root=np.zeros((0, count)),
        prior_mean=np.zeros(0),
        parameters=[SimpleNamespace(shape=False)] * count,
    )


def _linear(matrix: FloatArray, right: FloatArray) -> Any:
    return _posed(lambda x: right - matrix @ x, lambda _: -matrix, matrix.shape[1])


def _rosenbrock(x: FloatArray) -> FloatArray:
    return np.array([10.0 * (x[1] - x[0] ** 2), 1.0 - x[0]])


def _rosenbrock_slope(x: FloatArray) -> FloatArray:
    return np.array([[-20.0 * x[0], 10.0], [-1.0, 0.0]])


def _minimum(
    posed: Any, x: FloatArray, low: FloatArray, high: FloatArray, tolerance: float = 1e-12, **other: Any
) -> Minimum:
    given = {"evaluations": 100, "loss": "linear", "loss_scale": 1.0, **other}
    return minimise(posed, x, (low, high), tolerance, given["evaluations"], given["loss"], given["loss_scale"])


def test_a_linear_problem_takes_one_step_though_bounds_hold_it() -> None:
    rng = np.random.default_rng(0)
    matrix, right = rng.normal(size=(30, 5)) * [1.0, 1e3, 1e-3, 1.0, 1.0], rng.normal(size=30)
    low, high = np.full(5, -0.05), np.full(5, 0.02)
    there = lsq_linear(matrix, right, bounds=(low, high), method="bvls")
    assert (there.active_mask != 0).sum() >= 2
    found = _minimum(_linear(matrix, right), np.zeros(5), low, high)
    np.testing.assert_allclose(found.x, there.x, rtol=1e-6, atol=1e-9)
    assert found.evaluations <= 3
    assert found.status == "converged"


def test_a_step_takes_a_shape_alone_over_a_quarter_of_its_range() -> None:
    posed = _linear(np.eye(2), np.array([7.9, 7.9]))
    posed.parameters = [SimpleNamespace(shape=False), SimpleNamespace(shape=True)]
    low, high = np.zeros(2), np.full(2, 8.0)
    once = _minimum(posed, np.zeros(2), low, high, evaluations=2)
    np.testing.assert_allclose(once.x, [7.9, 2.0])
    np.testing.assert_allclose(_minimum(posed, np.zeros(2), low, high).x, 7.9)


def test_along_what_the_data_hardly_say_it_goes_as_fast() -> None:
    """Two columns are the same to a thousandth, and bounds are on both sides, as those of the friction coefficients."""
    rng = np.random.default_rng(1)
    first = rng.normal(size=200)
    matrix = np.stack([first, first + 1e-3 * rng.normal(size=200)], axis=1)
    right = matrix @ [0.7, 0.3] + 1e-4 * rng.normal(size=200)
    low, high, start = np.zeros(2), np.ones(2), np.array([0.5, 0.5])
    found = _minimum(_linear(matrix, right), start, low, high, 1e-6)
    there = lsq_linear(matrix, right, bounds=(low, high)).x
    theirs = least_squares(
        lambda x: right - matrix @ x, start, lambda _: -matrix, (low, high), ftol=1e-6, x_scale="jac"
    )
    assert found.evaluations <= 3
    assert theirs.nfev > 2 * found.evaluations
    np.testing.assert_allclose(found.x, there, atol=1e-3)  # their standard errors are 7e-3


@pytest.mark.parametrize("high", [2.0, 0.5])
def test_a_bent_valley_is_followed_to_the_optimum_that_scipy_finds(high: float) -> None:
    low, top = np.full(2, -2.0), np.array([high, 2.0])
    found = _minimum(_posed(_rosenbrock, _rosenbrock_slope, 2), np.array([-1.2, 1.0]), low, top)
    theirs = least_squares(_rosenbrock, [-1.2, 1.0], _rosenbrock_slope, (low, top), ftol=1e-15, xtol=1e-15, gtol=1e-15)
    np.testing.assert_allclose(found.x, theirs.x, atol=1e-5)
    assert found.status == "converged"
    assert found.evaluations < 40
    assert (found.gradient[0] < -1e-3) == (high < 1.0)  # the fit pushes against this bound


def test_a_column_that_does_nothing_stays_where_it_is() -> None:
    matrix = np.array([[1.0, 0.0], [2.0, 0.0], [0.0, 0.0]])
    found = _minimum(
        _linear(matrix, np.array([1.0, 2.0, 5.0])), np.array([0.0, 0.4]), np.full(2, -3.0), np.full(2, 3.0)
    )
    np.testing.assert_allclose(found.x, [1.0, 0.4], rtol=1e-6)


def test_the_most_evaluations_end_it_and_the_message_says_so() -> None:
    posed = _posed(_rosenbrock, _rosenbrock_slope, 2)
    found = _minimum(posed, np.array([-1.2, 1.0]), np.full(2, -2.0), np.full(2, 2.0), evaluations=3)
    assert (found.status, found.evaluations) == ("stopped", 3)
    assert found.message == "the most evaluations were used, 3"


def test_what_is_no_number_is_an_error() -> None:
    posed = _posed(lambda x: x * np.nan, lambda x: np.eye(len(x)), 2)
    with pytest.raises(FloatingPointError, match="the residual is not finite: row 0"):
        _minimum(posed, np.zeros(2), np.full(2, -1.0), np.ones(2))


@pytest.mark.parametrize("loss", get_args(Loss))
def test_a_robust_loss_finds_the_optimum_of_scipy(loss: Loss) -> None:
    """A line through points of which every tenth is far off."""
    rng = np.random.default_rng(2)
    matrix = np.stack([np.ones(60), np.linspace(0.0, 1.0, 60)], axis=1)
    right = matrix @ [1.0, 2.0] + 0.1 * rng.normal(size=60)
    right[::10] += 4.0
    low, high = np.full(2, -9.0), np.full(2, 9.0)
    found = _minimum(_linear(matrix, right), np.array([1.5, 1.5]), low, high, loss=loss, loss_scale=0.2)
    theirs = least_squares(
        lambda x: right - matrix @ x, [1.5, 1.5], lambda _: -matrix, (low, high), loss=loss, f_scale=0.2, ftol=1e-14
    )
    np.testing.assert_allclose(found.x, theirs.x, rtol=1e-4)
    assert found.cost == pytest.approx(2.0 * theirs.cost, rel=1e-8)


@pytest.mark.parametrize("loss", get_args(Loss))
def test_losses_and_their_slopes_are_those_of_scipy(loss: Loss) -> None:
    value, slope = LOSSES[loss]
    for z in (0.04, 0.5, 3.0, 40.0):
        theirs = least_squares(lambda x, z=z: np.array([np.sqrt(z)]) + 0.0 * x, [0.0], loss=loss, max_nfev=1)
        assert value(np.array([z]))[0] == pytest.approx(2.0 * theirs.cost, rel=1e-12)
        ends = value(np.array([z * 1.0001, z * 0.9999]))
        assert slope(np.array([z]))[0] == pytest.approx((ends[0] - ends[1]) / (0.0002 * z), rel=1e-6)
