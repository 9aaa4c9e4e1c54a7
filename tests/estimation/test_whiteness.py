"""Whiteness: p values that are uniform under the null, and residuals that fail."""

from __future__ import annotations

import numpy as np
import pytest
from residual_draws import coloured
from scipy import stats
from synthetic_swimming import SIGMA

from mjfish.data import Trial
from mjfish.estimation.residual_tests import Autocorrelation, Series, whiteness
from mjfish.estimation.serial_correlation import Block
from mjfish.fish.frames import CHANNELS
from mjfish.noise import Autoregressive
from mjfish.numerics.arrays import FloatArray, readonly


def _series(error: FloatArray, name: str = "v1") -> list[Series]:
    """Return the channels of a residual (n, 3) in units of the noise; samples without a number do not count."""
    cells = np.flatnonzero(np.all(np.isfinite(error), axis=1))
    block = Block(name, np.nan_to_num(error / SIGMA), np.arange(3 * len(cells)), cells, 0.02)
    return [Series(0, channel, block, column) for column, channel in enumerate(CHANNELS)]


def _white(rng: np.random.Generator, samples: int = 300) -> list[Series]:
    return [one for n in (samples, samples + 100) for one in _series(coloured(rng, n, 0.0), f"v{n}")]


def _pooled(tests: tuple[Autocorrelation, ...], channel: str = "surge") -> Autocorrelation:
    return next(t for t in tests if (t.trial, t.channel) == ("all", channel))


def test_p_values_are_uniform_and_bands_hold_where_the_residual_is_white() -> None:
    """400 draws, two trials. Catches a wrong count of pairs or of freedom, a band of another level."""
    rng = np.random.default_rng(11)
    tests = [whiteness(_white(rng), 0) for _ in range(400)]
    for trial in ("v300", "all"):
        p = np.array([t.p_value for test in tests for t in test if t.trial == trial])
        assert stats.kstest(p, "uniform").pvalue > 1e-3
        assert 0.03 < np.mean(p < 0.05) < 0.07
    outside = np.mean([np.abs(t.value) > t.band for test in tests for t in test])
    assert outside == pytest.approx(0.01, abs=0.002)


def test_gaps_are_allowed_for() -> None:
    """A third of the samples missing: still uniform. Catches pairs counted across a gap as if it was none."""
    rng = np.random.default_rng(12)
    p = []
    for _ in range(300):
        one = coloured(rng, 500, 0.0)
        one[rng.random(500) < 0.33] = np.nan
        p += [t.p_value for t in whiteness(_series(one), 0) if t.trial == "all"]
    assert stats.kstest(p, "uniform").pvalue > 1e-3


def test_every_second_sample_of_a_pair_correlated_series_is_white() -> None:
    """Moving-average noise of lag 1; lost rows leave lag 2 and more. Catches a grid that closes gaps."""
    white = np.random.default_rng(13).standard_normal((2001, 3)) * SIGMA
    pair = white[1:] + 0.9 * white[:-1]
    seen = _series(pair)
    late = pair.copy()
    late[1::2] = np.nan
    assert _pooled(whiteness(seen, 0)).p_value < 1e-12
    assert _pooled(whiteness(_series(late), 0)).p_value > 0.01


@pytest.mark.parametrize("phi", [0.3, 0.8, -0.3])
def test_coloured_noise_fails_and_its_innovations_pass(phi: float) -> None:
    rng = np.random.default_rng(14)
    noise = Autoregressive(readonly(SIGMA), readonly(np.full((3, 1), phi)))
    drawn = {f"v{k}": coloured(rng, 500, phi) for k in range(3)}
    before, after = list[Series](), list[Series]()
    for name, error in drawn.items():
        trial = Trial(name, None, readonly(np.arange(500) * 0.02), readonly(error))
        before += _series(error, name)
        after += _series(noise.whiten(trial, np.ones(500, dtype=np.bool_), error) * SIGMA, name)
    assert max(t.p_value for t in whiteness(before, 0)) < 1e-3
    assert min(t.p_value for t in whiteness(after, 0) if t.trial == "all") > 0.003


def test_an_offset_is_no_white_noise() -> None:
    """Catches a mean that is taken out before the test."""
    rng = np.random.default_rng(15)
    assert _pooled(whiteness(_series(coloured(rng, 700, 0.0) + 0.4 * SIGMA), 0), "sway").p_value < 1e-6


def test_a_loud_trial_does_not_drown_the_others() -> None:
    """Three coloured trials beside one that is white and thirty times louder. Catches pooling by energy."""
    rng = np.random.default_rng(16)
    series = [one for k in range(3) for one in _series(coloured(rng, 400, 0.4), f"v{k}")]
    series += _series(30.0 * coloured(rng, 400, 0.0), "loud")
    assert _pooled(whiteness(series, 0)).p_value < 1e-9


def test_the_autocorrelation_is_that_of_theory() -> None:
    rng = np.random.default_rng(17)
    found = _pooled(whiteness(_series(coloured(rng, 40_000, 0.8)), 0))
    np.testing.assert_allclose(found.value[:10], 0.8 ** np.arange(1, 11), atol=0.04)
    assert found.lag[0] == 1.0


def test_the_beat_is_seen() -> None:
    """A line a fifth of the noise's variance."""
    rng = np.random.default_rng(18)
    time = np.arange(521) / 50.0
    line = 0.63 * SIGMA * np.sin(18.0 * time)[:, None]
    assert _pooled(whiteness(_series(coloured(rng, 521, 0.0) + line), 0), "yaw_rate").p_value < 1e-4


def test_short_trials_have_fewer_lags_and_too_short_ones_none() -> None:
    rng = np.random.default_rng(19)
    assert len(_pooled(whiteness(_series(coloured(rng, 40, 0.0)), 0)).lag) == 10
    assert whiteness(_series(coloured(rng, 3, 0.0)), 0) == ()
    assert whiteness(_series(coloured(rng, 60, 0.0)), 20) == ()


def test_a_short_series_takes_no_lags_from_another_channel() -> None:
    """Catches one number of lags for a camera and a compass that was read eight times."""
    rng = np.random.default_rng(20)
    long, short = _series(coloured(rng, 300, 0.0)), _series(coloured(rng, 8, 0.0))
    found = whiteness([*long[:2], short[2]], 0)
    assert {one.channel: len(one.lag) for one in found} == {"surge": 25, "sway": 25, "yaw_rate": 2}
