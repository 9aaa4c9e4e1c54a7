"""Noise of the sealed world: its true covariance is what the whitening says."""

from __future__ import annotations

import numpy as np
import pytest

from studies.battery.generator import noise


@pytest.mark.parametrize("kind", noise.KINDS)
def test_whitened_noise_is_white(kind: noise.Kind) -> None:
    """A covariance that is not the one of the noise drawn: sizes by strength would be off by kind."""
    how = noise.draw(np.random.default_rng(4), kind, 1.0)
    rng = np.random.default_rng(5)
    blocks = np.stack([noise.whiten(how, noise.sample(how, 200, rng)) for _ in range(200)])
    assert np.std(blocks) == pytest.approx(1.0, abs=0.05)
    for lag in (1, 2, 5, 20):
        correlation = np.mean(blocks[:, lag:] * blocks[:, :-lag]) / np.mean(blocks**2)
        assert abs(correlation) < 0.02, f"lag {lag}"


@pytest.mark.parametrize("kind", noise.KINDS)
def test_its_level_is_the_stated_one(kind: noise.Kind) -> None:
    """A sigma that is stated and not there."""
    how = noise.draw(np.random.default_rng(6), kind, 1.0)
    rng = np.random.default_rng(7)
    drawn = np.concatenate([noise.sample(how, 500, rng)[20:-20] for _ in range(60)])  # a filter is worse at its ends
    assert np.std(drawn, axis=0) == pytest.approx(noise.LEVEL, rel=0.08)


def test_drifting_noise_lasts_and_white_noise_does_not() -> None:
    """A drift that is white after all."""
    rng = np.random.default_rng(8)
    slow = noise.Noise("drift", (1.0, 1.0, 1.0), share=0.7, memory=1.0)
    drawn = np.concatenate([noise.sample(slow, 2000, rng) for _ in range(10)], axis=1)
    assert np.mean(drawn[10:] * drawn[:-10]) == pytest.approx(0.7 * np.exp(-0.2), abs=0.06)


def test_frames_are_lost_in_the_stated_share_and_never_at_the_ends() -> None:
    """A run that starts late because its first frame is missing."""
    rng = np.random.default_rng(9)
    for _ in range(20):
        how = noise.draw(rng, "dropped_frames")
        there = noise.kept(how, 400, rng)
        assert there[0]
        assert there[-1]
        assert how.lost <= np.mean(~there) < how.lost + 0.02


def test_only_noise_with_tails_has_outliers() -> None:
    """Tails that are those of a normal distribution."""
    rng = np.random.default_rng(10)
    share = {}
    for kind in ("white", "heavy_tailed"):
        how = noise.draw(rng, kind, 1.0)
        share[kind] = np.mean(np.abs(noise.sample(how, 20000, rng)) > 4.0 * np.array(how.sigma))
    assert share["white"] < 3e-4
    assert share["heavy_tailed"] > 3e-3
