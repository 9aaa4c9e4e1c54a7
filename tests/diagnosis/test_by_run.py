"""Tests of columns of single runs, run by run, against the same in plain matrices."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from mjfish.arrays import FloatArray, orthonormal, principal_axes, project_out
from mjfish.block_angular import BlockAngular, Part, block_angular, span
from mjfish.diagnosis.by_run import ByRun
from mjfish.diagnosis.sign_flips import flipped_p
from mjfish.diagnosis.weighted_sum import Plain, Ridge, weighted_tail

RUNS, ROWS, WAVES = 12, 40, 6


def _by_run(seed: int = 0) -> tuple[ByRun, FloatArray, FloatArray]:
    """Return columns beside three shared parameters and one of each run, and W and M W as plain matrices."""
    rng = np.random.default_rng(seed)
    rows = [np.arange(r * ROWS, (r + 1) * ROWS) for r in range(RUNS)]
    parts = tuple(Part(at, np.array([3 + r]), rng.standard_normal((ROWS, 1))) for r, at in enumerate(rows))
    jacobian = BlockAngular(rng.standard_normal((RUNS * ROWS, 3)), np.arange(3), parts)
    blocks = [rng.standard_normal((ROWS, WAVES)) * np.geomspace(1.0, 30.0, WAVES) for _ in rows]
    columns = block_angular(np.zeros((RUNS * ROWS, 0)), rows, blocks)
    found = ByRun(jacobian, span(jacobian), columns)
    return found, columns.dense(), project_out(orthonormal(jacobian.dense()), columns.dense())


def _residual(by_run: ByRun, seed: int = 1) -> FloatArray:
    return by_run.basis.off(np.random.default_rng(seed).standard_normal(RUNS * ROWS))


def test_the_statistic_is_that_of_all_columns() -> None:
    by_run, _, beyond = _by_run()
    z = _residual(by_run)
    axes = beyond @ principal_axes(beyond.T @ beyond)
    statistic, rank = by_run.statistic(z)
    assert rank == axes.shape[1] == RUNS * WAVES
    assert statistic == pytest.approx(float(np.sum((axes.T @ z) ** 2)), rel=1e-9)
    np.testing.assert_allclose(by_run.fitted(z), axes @ (axes.T @ z), atol=1e-9)
    np.testing.assert_allclose(np.concatenate(by_run.energy), np.sum(beyond**2, axis=0), rtol=1e-9)
    assert by_run.flipped_p(z) == pytest.approx(flipped_p(beyond, z), rel=1e-6)


@pytest.mark.parametrize("scale", [1.0, 1.4])
def test_drawn_sizes_are_those_of_all_eigenvalues(scale: float) -> None:
    by_run, _, beyond = _by_run()
    z = scale * _residual(by_run)
    values, vectors = np.linalg.eigh(beyond.T @ beyond)
    variance = 100.0 / values.sum()
    weights = variance * values / (1.0 + variance * values)
    score = vectors.T @ (beyond.T @ z)
    statistic = float(np.sum(variance / (1.0 + variance * values) * score**2))
    test = by_run.drawn(z)
    assert test.variance == pytest.approx(variance, rel=1e-9)
    assert test.beyond == pytest.approx((statistic - weights.sum()) / weights.max(), rel=1e-7)
    assert test.p == pytest.approx(weighted_tail(statistic, weights), rel=1e-6)
    basis = beyond @ (vectors * np.sqrt(variance / (1.0 + variance * values)))
    squares = z**2
    spread = basis.T @ (basis * squares[:, None])
    mean = float(np.trace(spread))
    direct = 2.0 * float(np.sum(spread**2) - np.sum((np.sum(basis**2, axis=1) * squares) ** 2))
    expected = float(stats.chi2.sf(2.0 * statistic * mean / direct, 2.0 * mean**2 / direct))
    assert test.flipped_p(z) == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize("count", [4, 60, 300])
def test_the_cumulants_are_those_of_the_eigenvalues(count: int) -> None:
    """Up to the pole, where 1 + c d of the largest d is negative: B has taken the most from them."""
    rng = np.random.default_rng(count)
    d = np.sort(rng.uniform(0.1, 1.0, count))
    b = np.linalg.qr(rng.standard_normal((count, 2)))[0] * np.sqrt(0.05)
    b[-2:] += np.diag([0.25, 0.28])
    ridge = Ridge.of(d, b, 50.0)
    values = np.maximum(np.linalg.eigvalsh(np.diag(d) - b @ b.T), 0.0)
    plain = Plain(ridge.variance * values / (1.0 + ridge.variance * values))
    assert ridge.largest == pytest.approx(plain.largest, rel=1e-9)
    assert ridge.total == pytest.approx(float(plain.values.sum()), rel=1e-9)
    for share in (-3.0, -0.2, 0.0, 0.3, 0.9, 0.999):
        s = 0.5 * share / plain.largest
        np.testing.assert_allclose(ridge.cumulants(s), plain.cumulants(s), rtol=1e-6, atol=1e-9)


def test_columns_of_nothing_are_no_evidence() -> None:
    by_run, _, _ = _by_run()
    nothing = ByRun(by_run.jacobian, by_run.basis, BlockAngular.of(np.zeros((RUNS * ROWS, 0))))
    z = _residual(by_run)
    assert nothing.statistic(z) == (pytest.approx(0.0, abs=1e-9), 0)
    assert nothing.drawn(z).p == 1.0
    assert nothing.drawn(z).flipped_p(z) == 1.0
