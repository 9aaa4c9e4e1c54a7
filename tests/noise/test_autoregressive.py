"""Noise: autoregressive coefficients come back, whitening makes white, white data stay white."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from scipy import signal

from mjfish.noise import Autoregressive, Noise, estimate
from mjfish.noise.autoregressive import MAX_ORDER
from mjfish.numerics.arrays import FloatArray, readonly

SIGMA = np.array([0.01, 0.02, 0.05])
PHI = np.array([[0.6, -0.3], [1.2, -0.5], [0.9, 0.0]])


def _whiten(noise: Noise, block: FloatArray) -> FloatArray:
    trial = SimpleNamespace(time=0.02 * np.arange(len(block)), step=0.02)
    return noise.whiten(trial, np.ones(len(block), dtype=np.bool_), block)  # type: ignore[arg-type]


def _white(seed: int, samples: int = 500, trials: int = 4) -> list[FloatArray]:
    rng = np.random.default_rng(seed)
    return [rng.standard_normal((samples, 3)) * SIGMA for _ in range(trials)]


def _coloured(seed: int, samples: int = 2000, trials: int = 4) -> list[FloatArray]:
    def one(innovations: FloatArray) -> FloatArray:
        return np.stack([signal.lfilter([1.0], [1.0, *-PHI[c]], innovations[:, c])[200:] for c in range(3)], axis=1)

    return [one(block) for block in _white(seed, samples + 200, trials)]


def _correlation(block: FloatArray, lag: int) -> FloatArray:
    return np.array([np.corrcoef(block[:-lag, c], block[lag:, c])[0, 1] for c in range(3)])


@pytest.mark.parametrize("seed", range(5))
def test_white_noise_has_order_zero_and_its_own_sigma(seed: int) -> None:
    found = estimate(_white(seed))
    assert found.order == 0
    np.testing.assert_allclose(found.sigma, SIGMA, rtol=5.0 / np.sqrt(2 * 2000))


def test_autoregressive_coefficients_and_innovations_come_back() -> None:
    """Within five standard errors, 1 / sqrt(n) each at most, and what the white floor takes."""
    found = estimate(_coloured(1))
    assert found.order >= 2
    padded = np.pad(PHI, ((0, 0), (0, found.order - 2)))
    assert np.all(np.abs(found.phi - padded) < 5.0 / np.sqrt(8000) + 0.02)
    np.testing.assert_allclose(found.sigma, SIGMA, rtol=0.05)


def test_whitening_by_the_estimate_makes_white() -> None:
    white = _whiten(estimate(_coloured(3)), _coloured(4, trials=1)[0])
    assert np.all(np.abs(_correlation(white, 1)) < 0.08)
    np.testing.assert_allclose(white.std(axis=0), 1.0, rtol=0.1)


def test_whitening_is_linear_and_treats_columns_alike() -> None:
    """Residuals and sensitivities pass the same filter."""
    noise = Autoregressive(readonly(SIGMA), readonly(PHI))
    a, b = _coloured(5, trials=2, samples=50)
    both = _whiten(noise, np.stack([a, 2.0 * a - b], axis=2))
    np.testing.assert_allclose(both[..., 0], _whiten(noise, a), rtol=1e-12)
    np.testing.assert_allclose(both[..., 1], 2.0 * _whiten(noise, a) - _whiten(noise, b), rtol=0.0, atol=1e-10)


def test_white_noise_only_divides_by_sigma() -> None:
    block = _white(1, samples=20, trials=1)[0]
    np.testing.assert_allclose(_whiten(Noise.white(readonly(SIGMA)), block), block / SIGMA, rtol=1e-14)


def test_lost_degrees_of_freedom_make_the_estimate_larger() -> None:
    blocks = _white(7)
    plain, corrected = estimate(blocks), estimate(blocks, lost=500.0)
    np.testing.assert_allclose(corrected.sigma, plain.sigma * np.sqrt(2000 / 1500), rtol=1e-12)


def test_one_short_run_does_not_take_the_colour_out_of_all() -> None:
    coloured = _coloured(8)
    whole = estimate(coloured)
    np.testing.assert_allclose(estimate([*coloured, coloured[0][:15]]).phi, whole.phi, atol=0.05)


def test_no_order_drops_a_run_or_is_beyond_what_the_runs_tell() -> None:
    coloured = _coloured(8)
    assert estimate([*coloured, coloured[0][:3]]).order <= 1
    assert estimate([block[:7] for block in coloured]).order == 0
    assert estimate(coloured).order <= MAX_ORDER


def test_residuals_that_are_all_zero_have_a_finite_noise() -> None:
    found = estimate([np.zeros((100, 3))])
    assert np.all(np.isfinite(found.sigma))
    assert np.all(found.sigma > 0.0)
