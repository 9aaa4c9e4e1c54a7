"""Statistics of the score tests."""

from __future__ import annotations

import numpy as np
from scipy import optimize, stats

from mjfish.diagnosis import evidence
from mjfish.numerics.arrays import orthonormal, project_out


def test_one_sided_statistic_is_what_non_negative_least_squares_removes() -> None:
    rng = np.random.default_rng(0)
    signatures = rng.standard_normal((40, 3))
    information = signatures.T @ signatures
    draws = rng.standard_normal((20, 40))
    found = evidence.one_sided_statistic(draws @ signatures, information, np.ones(3, dtype=bool))
    for z, statistic in zip(draws, found, strict=True):
        _, left = optimize.nnls(signatures, z)
        np.testing.assert_allclose(statistic, z @ z - left**2, rtol=1e-9, atol=1e-9)


def test_two_sided_statistic_is_chi_squared() -> None:
    rng = np.random.default_rng(1)
    signatures = rng.standard_normal((50, 2))
    u = rng.standard_normal((4000, 50)) @ signatures
    statistic = evidence.one_sided_statistic(u, signatures.T @ signatures, np.zeros(2, dtype=bool))
    assert stats.kstest(statistic, stats.chi2(2).cdf).pvalue > 1e-3


def test_amplitudes_of_the_wrong_sign_stay_at_zero() -> None:
    psi = evidence.amplitudes(np.array([-3.0, 4.0]), np.diag([1.0, 2.0]), np.array([True, True]))
    np.testing.assert_allclose(psi, [0.0, 2.0])


def test_projection_leaves_nothing_along_the_basis() -> None:
    rng = np.random.default_rng(2)
    columns = rng.standard_normal((30, 4)) * np.array([1.0, 1e-6, 1e6, 1.0])
    columns[:, 3] = columns[:, 0]  # a repeat: rank 3
    span = orthonormal(columns)
    assert span.shape == (30, 3)
    left = project_out(span, columns)
    assert np.max(np.abs(left) / np.linalg.norm(columns, axis=0)) < 1e-12


def test_tails_do_not_underflow_into_ties() -> None:
    far = evidence.log_tail(np.array([5e3, 6e3]), 1)
    assert np.all(np.isfinite(far))
    assert far[1] < far[0]
