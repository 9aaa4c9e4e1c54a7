"""Forecasts of autoregressive noise: the conditional mean, exactly, with gaps and from the first sample on."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import linalg, signal

from mjfish.data import Trial
from mjfish.errors import InputError
from mjfish.noise import Autoregressive, Noise
from mjfish.numerics.arrays import FloatArray, readonly

PHI = np.array([[0.6, -0.3, 0.2], [1.2, -0.5, 0.0], [0.9, 0.0, 0.0]])
SIGMA = np.array([0.01, 0.02, 0.05])
NOISE = Autoregressive(readonly(SIGMA), readonly(PHI))


def _draw(samples: int, seed: int = 0) -> FloatArray:
    white = np.random.default_rng(seed).standard_normal((samples + 300, 3)) * SIGMA
    return np.stack([signal.lfilter([1.0], [1.0, *-PHI[c]], white[:, c])[300:] for c in range(3)], axis=1)


def _autocovariance(channel: int, samples: int) -> FloatArray:
    impulse = signal.lfilter([1.0], [1.0, *-PHI[channel]], np.eye(1, 3000)[0]) * SIGMA[channel]
    return np.array([impulse[k:] @ impulse[: len(impulse) - k] for k in range(samples)])


@pytest.mark.parametrize("steps", [1, 3])
def test_a_forecast_is_the_gaussian_conditional_mean_across_gaps_and_at_the_start(steps: int) -> None:
    """Against a dense solve. Catches a wrong start of the filter, a gap taken for a zero, a state off by one."""
    series = _draw(40)
    series[[0, 7, 8, 9, 20]] = np.nan
    found = NOISE.forecasts(series, [steps])[steps]
    there = np.isfinite(series).all(axis=1)
    trial = Trial("v1", None, readonly(np.arange(40) * 0.02), readonly(series))
    white = np.full_like(series, np.nan)
    white[there] = NOISE.whiten(trial, there, series[there])
    for channel in range(3):
        full = linalg.toeplitz(_autocovariance(channel, 40))
        for t in range(40):
            seen = [s for s in range(t - steps + 1) if np.isfinite(series[s, channel])]
            weights = np.linalg.solve(full[np.ix_(seen, seen)], full[seen, t]) if seen else np.zeros(0)
            assert found[t, channel] == pytest.approx(weights @ series[seen, channel], rel=1e-9, abs=1e-13)
            if steps == 1 and np.isfinite(series[t, channel]):
                spread = full[t, t] - weights @ full[seen, t]
                expected = (series[t, channel] - found[t, channel]) / np.sqrt(spread)
                assert white[t, channel] == pytest.approx(expected, rel=1e-9, abs=1e-11)


@pytest.mark.parametrize("steps", [1, 5, 25])
def test_the_error_of_a_forecast_is_that_of_theory(steps: int) -> None:
    """First order: sigma^2 (1 - phi^(2k)) / (1 - phi^2) ([Ljung1999], ch. 3.2). Catches a wrong power of F."""
    phi = np.array([0.6, 0.8, 0.9])
    noise = Autoregressive(readonly(SIGMA), readonly(phi[:, None]))
    white = np.random.default_rng(1).standard_normal((20_000, 3)) * SIGMA
    series = np.stack([signal.lfilter([1.0], [1.0, -phi[c]], white[:, c]) for c in range(3)], axis=1)
    error = np.std(series - noise.forecasts(series, [steps])[steps], axis=0)
    np.testing.assert_allclose(error, SIGMA * np.sqrt((1 - phi ** (2 * steps)) / (1 - phi**2)), rtol=0.05)


def test_nothing_after_the_horizon_is_looked_at() -> None:
    """A measurement moves forecasts `steps` samples later and on, none before."""
    series = _draw(60)
    moved = series.copy()
    moved[30] += 1.0
    changed = np.any(NOISE.forecasts(moved, [5])[5] != NOISE.forecasts(series, [5])[5], axis=1)
    assert np.flatnonzero(changed)[0] == 35


def test_white_noise_has_no_forecast() -> None:
    assert not np.any(Noise.white(readonly(SIGMA)).forecasts(_draw(50), [1])[1])


def test_a_horizon_below_one_and_noise_without_bound_are_refused() -> None:
    with pytest.raises(InputError, match="1 or more"):
        NOISE.forecasts(_draw(50), [0])[0]
    with pytest.raises(InputError, match="stationary"):
        Autoregressive(readonly(SIGMA), readonly(np.full((3, 1), 1.01))).forecasts(_draw(50), [1])
