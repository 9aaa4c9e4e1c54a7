"""Rows on an even grid of times that are not even."""

from __future__ import annotations

import numpy as np
import pytest

from mjfish.data.trial import rows_of
from mjfish.noise.autoregressive import grid


@pytest.mark.parametrize("rate", [24.0, 59.94, 60.0])
def test_times_stamped_in_milliseconds_share_no_row(rate: float) -> None:
    """The mean step is not the median one: over ten seconds they drift apart by several samples."""
    time = np.round(np.arange(601) / rate, 3)
    np.testing.assert_array_equal(rows_of(time), np.arange(601))
    assert np.count_nonzero(grid(time, np.ones(601, dtype=np.bool_))) == 601


def test_jitter_is_no_gap_and_a_lost_sample_is_one() -> None:
    rng = np.random.default_rng(3)
    even = 0.02 * np.arange(400)
    kept = np.delete(np.arange(400), [50, 51, 200])
    time = (even + rng.uniform(-0.002, 0.002, 400))[kept]
    np.testing.assert_array_equal(rows_of(time), kept)
