"""What a basis explains of noise by chance, outliers or not."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from mjfish.diagnosis.evidence import flipped_p
from mjfish.numerics.arrays import FloatArray, project_out

N, K = 1200, 60
TIME = np.arange(N)


def _basis() -> FloatArray:
    """Sines and cosines of pieces of a sixth, so that one sample has much of the weight."""
    columns = np.zeros((N, K))
    for column in range(K):
        piece, wave = divmod(column, 10)
        part = slice(piece * N // 6, (piece + 1) * N // 6)
        columns[part, column] = np.sin(np.pi * (wave + 1) * (TIME[part] + 0.5) * 6 / N)
    return columns


@pytest.mark.parametrize("freedom", [3.0, 1e6])
def test_its_p_value_is_uniform_under_noise(freedom: float) -> None:
    rng = np.random.default_rng(0)
    found = [flipped_p(_basis(), rng.standard_t(freedom, N)) for _ in range(300)]
    assert stats.kstest(found, "uniform").pvalue > 0.01


def test_one_outlier_is_no_misfit() -> None:
    """By chi2 it is one with p < 1e-6."""
    noise = np.random.default_rng(1).standard_normal(N)
    noise[730] = 40.0
    basis, _ = np.linalg.qr(_basis())
    assert stats.chi2.sf(np.sum((basis.T @ noise) ** 2), K) < 1e-6
    assert flipped_p(_basis(), noise) > 0.01


def test_a_misfit_is_one_as_ever() -> None:
    """As large as the noise, and where the noise has outliers, too."""
    rng = np.random.default_rng(2)
    wave = np.sin(np.pi * 3.0 * TIME * 6 / N)
    for noise in (rng.standard_normal(N), rng.standard_t(3.0, N) / np.sqrt(3.0)):
        assert flipped_p(_basis(), noise + wave) < 1e-12


def test_columns_that_depend_on_each_other_count_once() -> None:
    residual = np.random.default_rng(3).standard_normal(N)
    basis = _basis()
    twice = np.hstack([basis, basis @ np.random.default_rng(4).standard_normal((K, 5))])
    assert flipped_p(twice, residual) == pytest.approx(flipped_p(basis, residual), rel=1e-6)


def test_nothing_to_explain_is_no_misfit() -> None:
    basis, _ = np.linalg.qr(_basis())
    left = project_out(basis, np.ones((N, 1)))[:, 0]
    assert flipped_p(np.zeros((N, 2)), left) == 1.0
    assert flipped_p(basis, np.zeros(N)) == 1.0
