"""The advised run against a random one of the menu, simulated and added."""

from __future__ import annotations

import pytest
from scipy import stats

from studies.battery.advised_run import case


@pytest.mark.slow
def test_an_advised_run_splits_more_verdicts_than_a_random_one_and_as_many_as_predicted() -> None:
    """Of twelve cases; the tool plays more."""
    played = [one for one in map(case, range(24)) if one is not None]
    assert len(played) >= 8
    advised = sum(one.split_advised for one in played)
    assert advised > sum(one.split_random for one in played)
    predicted = sum(one.probability_advised for one in played) / len(played)
    assert stats.binomtest(advised, len(played), predicted).pvalue > 1e-3
