"""What is known of parameters beforehand, and what keeps a learned curve smooth."""

from __future__ import annotations

import numpy as np
import pytest

from mjfish.parameters.prior import Prior, smooth_curve

KNOTS = ("curve.a", "curve.b", "curve.c", "curve.d", "curve.e")


def _of(name: str) -> Prior:
    """Return one of the priors of a curve of five knots; sds 0.3 and 0.7."""
    (found,) = (prior for prior in smooth_curve("curve", KNOTS, 0.3, 0.7) if prior.name == f"curve.{name}")
    assert found.parameters == KNOTS
    return found


def _penalty(prior: Prior, values: list[float]) -> float:
    return float(np.sum((prior.rows @ values / prior.sd) ** 2))


def test_a_straight_line_has_no_curvature_and_one_slope() -> None:
    line = [1.0 + 0.25 * k for k in range(5)]
    assert _penalty(_of("curvature"), line) == pytest.approx(0.0, abs=1e-28)
    np.testing.assert_allclose(_of("slope").rows @ line, 0.25, rtol=1e-14)
    assert _penalty(_of("slope"), line) == pytest.approx(4 * (0.25 / 0.7) ** 2)
    np.testing.assert_allclose(_of("level").rows @ line, [1.5], rtol=1e-14)


def test_a_step_costs_one_first_difference_and_two_second_ones() -> None:
    """0 0 1 1 1: first differences 0 1 0 0, second ones 1 -1 0."""
    step = [0.0, 0.0, 1.0, 1.0, 1.0]
    assert _penalty(_of("curvature"), step) == pytest.approx(2.0 / 0.3**2)
    assert _penalty(_of("slope"), step) == pytest.approx(1.0 / 0.7**2)


def test_a_constant_costs_its_level_alone() -> None:
    level = [0.5] * 5
    assert [_penalty(_of(name), level) for name in ("curvature", "slope")] == [0.0, 0.0]
    assert _penalty(_of("level"), level) > 0.0


def test_all_together_leave_no_direction_free() -> None:
    """The prior is proper: every curve is paid for."""
    rows = np.concatenate([prior.rows / prior.sd for prior in smooth_curve("curve", KNOTS, 0.3, 0.7)])
    assert np.linalg.matrix_rank(rows) == len(KNOTS)


def test_only_the_curvature_is_learned() -> None:
    learned = [prior.name for prior in smooth_curve("curve", KNOTS, 0.3, 0.7) if prior.learned]
    assert learned == ["curve.curvature"]
