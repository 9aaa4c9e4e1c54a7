"""The tail of a weighted sum of squares."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from mjfish.diagnosis.weighted_sum import weighted_tail

UNEVEN = np.concatenate([[1.0, 0.5, 0.2], np.full(50, 0.01), [0.0, 1e-14]])


@pytest.mark.parametrize(("t", "count"), [(3.0, 3), (12.0, 10), (10.0, 10), (70.0, 10), (300.0, 60), (2000.0, 300)])
def test_equal_weights_are_a_chi2(t: float, count: int) -> None:
    assert weighted_tail(7.0 * t, np.full(count, 7.0)) == pytest.approx(stats.chi2.sf(t, count), rel=0.02)


def test_uneven_weights_have_the_tail_of_draws() -> None:
    """A chi2 of the same mean and variance has less than half of it at the last."""
    drawn = np.random.default_rng(0).chisquare(1.0, (200_000, len(UNEVEN))) @ UNEVEN
    for t in (1.5, 3.0, 6.0, 10.0):
        assert weighted_tail(t, UNEVEN) == pytest.approx(np.mean(drawn > t), rel=0.1)


def test_noise_of_doubtful_size_has_a_wider_tail() -> None:
    """Draws of the factor and of the noise."""
    rng, weights = np.random.default_rng(1), np.full(25, 2.0)
    drawn = 2.0 * rng.chisquare(25, 400_000) * np.exp(0.3 * rng.standard_normal(400_000))
    for t in (60.0, 100.0, 130.0):
        assert weighted_tail(t, weights, 0.3) == pytest.approx(np.mean(drawn > t), rel=0.1)
    assert weighted_tail(100.0, weights, 0.3) > 10.0 * weighted_tail(100.0, weights)


def test_nothing_to_sum_is_nothing_wrong() -> None:
    assert weighted_tail(0.0, UNEVEN) == 1.0
    assert weighted_tail(1.0, np.zeros(3)) == 1.0
    assert weighted_tail(1.0, np.zeros(0)) == 1.0
