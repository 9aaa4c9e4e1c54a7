"""The gain on held-out trials, from residuals that are made up."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from planted_cases import draw

from mjfish.arrays import readonly
from mjfish.diagnose.heldout import gain, pooled_error
from mjfish.identify.score import Score
from mjfish.trial import Trial


@pytest.fixture(scope="module")
def trial() -> Trial:
    return draw("time_offset", "middling", trials=2).dataset.trials[0]


def _score(residual: np.ndarray) -> Score:
    return Score((residual,), (residual,), (residual.ravel(),))


def test_errors_that_are_half_are_a_gain_of_half(trial: Trial) -> None:
    before = np.random.default_rng(1).standard_normal(trial.velocity.shape)
    found = gain(_score(before), _score(0.5 * before), (trial,), np.random.default_rng(2))
    assert found.relative_reduction == pytest.approx(0.5)
    assert (found.low, found.high) == pytest.approx((0.5, 0.5))
    for channel, error in found.nominal.items():
        assert found.extended[channel] == pytest.approx(0.5 * error)


def test_a_channel_that_stands_still_does_not_count(trial: Trial) -> None:
    """It has no range to relate its error to."""
    velocity = trial.velocity.copy()
    velocity[:, 2] = 0.0
    still = replace(trial, velocity=readonly(velocity))
    before = np.random.default_rng(1).standard_normal(velocity.shape)
    found = gain(_score(before), _score(0.5 * before), (still,), np.random.default_rng(2))
    assert found.nominal["yaw_rate"] == 0.0
    assert found.relative_reduction == pytest.approx(0.5)
    assert pooled_error([before], [still]) == pytest.approx(found.nominal["pooled"])
    assert np.isfinite([found.low, found.high]).all()
