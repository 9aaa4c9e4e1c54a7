"""A curve by coefficients of cubic B-splines, against the same curve by scipy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import BSpline

from mjfish.hydro.spline import spline, spline_slope, spline_weights
from mjfish.numerics.arrays import FloatArray

COUNTS = (2, 3, 7)
over_counts = pytest.mark.parametrize("count", COUNTS)


def _values(count: int) -> FloatArray:
    return np.random.default_rng(count).normal(size=count)


def _weights(t: float, count: int) -> FloatArray:
    """Return the weight of every knot (count,) at t."""
    k, *four = spline_weights(t, count)
    row = np.zeros(count + 3)
    row[k : k + 4] = four
    assert row[0] == row[-1] == row[-2] == 0.0, "a knot that is not there has no weight"
    return row[1 : count + 1]


def _reference(values: FloatArray) -> BSpline:
    """Return the uniform B-spline whose coefficients are mirrored at both ends."""
    count = len(values)
    return BSpline(np.arange(-3.0, count + 3.0), np.concatenate([values[1:2], values, values[-2:-1]]), 3)


@over_counts
def test_it_is_the_b_spline_with_these_coefficients(count: int) -> None:
    values, t = _values(count), np.linspace(0.0, count - 1.0, 201)
    found = [spline(at, values, 0, count) for at in t]
    np.testing.assert_allclose(found, _reference(values)(t), rtol=0.0, atol=1e-14)


@over_counts
def test_its_slope_is_that_of_the_b_spline_and_does_not_jump_at_a_knot(count: int) -> None:
    """Central differences over 1e-5, also across knots and ends: the curve is once differentiable everywhere.

    Where the second derivative jumps by J, as at the ends, such a difference is off by h J / 4, 1e-4 here.
    """
    values, h = _values(count), 1e-5
    for at in np.arange(-1.0, count + 0.5, 0.25):
        slope = (spline(at + h, values, 0, count) - spline(at - h, values, 0, count)) / (2.0 * h)
        exact = float(_reference(values)(at, nu=1)) if 0.0 <= at <= count - 1.0 else 0.0
        assert slope == pytest.approx(exact, abs=1e-4)


@over_counts
def test_weights_sum_to_one_and_are_the_derivatives_by_the_values(count: int) -> None:
    """The curve is linear in its values: with one of them 1 and the others 0 it is that one's weight."""
    for t in (-2.0, 0.0, 0.3, 0.99, 1.0, count - 1.5, count - 1.0, count + 3.0):
        weights = _weights(t, count)
        assert weights.sum() == pytest.approx(1.0, abs=1e-15)
        np.testing.assert_allclose([spline(t, row, 0, count) for row in np.eye(count)], weights, rtol=0.0, atol=1e-15)


def test_coefficients_on_a_line_are_that_line_away_from_the_ends() -> None:
    line = 0.3 + 0.7 * np.arange(7.0)
    for t in np.linspace(1.0, 5.0, 23):
        assert spline(float(t), line, 0, 7) == pytest.approx(0.3 + 0.7 * t, rel=1e-14)


@over_counts
def test_beyond_the_ends_it_is_constant(count: int) -> None:
    values = _values(count)
    for t in (-1e-9, -5.0, -np.inf):
        assert spline(t, values, 0, count) == spline(0.0, values, 0, count)
    for t in (count - 1.0 + 1e-9, count + 20.0, np.inf):
        assert spline(t, values, 0, count) == spline(count - 1.0, values, 0, count)


def test_its_values_may_stand_among_others() -> None:
    """As in the parameters of a load: nothing in front of them or behind them is read."""
    values = _values(5)
    row = np.concatenate([[np.nan, np.nan], values, [np.nan]])
    for t in (-1.0, 0.4, 2.0, 3.7, 9.0):
        assert spline(t, row, 2, 5) == spline(t, values, 0, 5)


@over_counts
def test_its_slope_is_that_of_the_b_spline(count: int) -> None:
    """Within, at both ends, where it is zero, and beyond."""
    values, t = _values(count), np.linspace(0.0, count - 1.0, 201)
    padded = np.concatenate([[9.0, 7.0], values, [5.0]])
    found = [spline_slope(at, padded, 2, count) for at in t]
    np.testing.assert_allclose(found, _reference(values).derivative()(t), rtol=0.0, atol=1e-13)
    assert spline_slope(-0.5, padded, 2, count) == spline_slope(count - 0.5, padded, 2, count) == 0.0
