"""The middle of the sandwich against the covariance that the noise was drawn with, in plain matrices."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy import linalg
from synthetic_swimming import problem, swimming

from mjfish.estimation import fit
from mjfish.estimation.serial_correlation import Block, blocks_of, satterthwaite, serial
from mjfish.fish import Fish
from mjfish.noise import Autoregressive
from mjfish.numerics.arrays import BoolArray, FloatArray, readonly
from mjfish.numerics.block_angular import Basis

#: Samples that channel 1 is behind channel 0.
_LATE = 3
_PHI = 0.7


def _covariance(n: int, late: int = _LATE) -> FloatArray:
    """Return the covariance (3 n, 3 n) of AR(1) in channel 0, the same some samples late and noisy in 1, white in 2."""
    lag = np.arange(n)[None, :] - np.arange(n)[:, None]
    omega = np.zeros((n, 3, n, 3))
    omega[:, 0, :, 0] = omega[:, 1, :, 1] = _PHI ** np.abs(lag)
    omega[:, 0, :, 1] = _PHI ** np.abs(lag - late)
    omega[:, 1, :, 0] = omega[:, 0, :, 1].T
    omega[:, 1, :, 1] += 0.5 * np.eye(n)
    omega[:, 2, :, 2] = 4.0 * np.eye(n)
    return omega.reshape(3 * n, 3 * n)


def _columns(n: int, count: int) -> FloatArray:
    """Return beating columns (n, 3, count) that mix the channels with a delay."""
    t = np.arange(n)[:, None]
    waves = np.cos(0.1 * np.arange(1, count + 1) * t + np.arange(count))
    return np.stack([waves, np.roll(waves, -_LATE, axis=0) + 0.3, 0.5 * waves[::-1]], axis=1)


def _block(residual: FloatArray, counted: BoolArray | None = None) -> Block:
    """Return the residual (n, 3) of a trial, zero where no sample counts; other columns have rows of all samples."""
    cells = np.arange(len(residual)) if counted is None else np.flatnonzero(counted)
    return Block("one", residual, (3 * cells[:, None] + np.arange(3)).ravel(), cells, 0.02)


def _mean_of(
    omega: FloatArray,
    jacobian: FloatArray,
    counted: BoolArray,
    of: Callable[[Block, Basis], FloatArray],
    draws: int = 60,
) -> FloatArray:
    """Return the mean over draws of noise, the columns of `jacobian` fitted out of it at the samples that count."""
    n, p = jacobian.shape[0], jacobian.shape[2]
    root = linalg.cholesky(omega, lower=True)
    seen = jacobian * counted[:, None, None]
    basis = linalg.orth(seen.reshape(3 * n, p)) if p else np.zeros((3 * n, 0))
    rng = np.random.default_rng(4)
    found = []
    for _ in range(draws):
        noise = (root @ rng.standard_normal(3 * n)).reshape(n, 3) * counted[:, None]
        residual = noise.ravel() - basis @ (basis.T @ noise.ravel())
        found.append(of(_block(residual.reshape(n, 3), counted), Basis((), basis)))
    return np.asarray(np.mean(found, axis=0))


@pytest.mark.parametrize("share", [1.0, 0.6])
def test_the_middle_is_that_of_the_noise(share: float) -> None:
    """Leads taken for lags (channel 1 follows 0), a channel left out, or gaps counted as samples would all show."""
    n = 400
    counted = np.random.default_rng(0).random(n) < share
    columns = _columns(n, 4) * counted[:, None, None]
    flat = columns.reshape(3 * n, 4)
    truth = flat.T @ _covariance(n) @ flat
    none = np.zeros((n, 3, 0))
    found = _mean_of(_covariance(n), none, counted, lambda one, basis: serial([one], basis).quadratic_of(0, columns))
    early = flat.T @ _covariance(n, -_LATE) @ flat
    assert np.max(np.abs(found - truth)) < 0.1 * np.max(np.abs(truth))
    assert np.max(np.abs(found - early)) > 0.2 * np.max(np.abs(truth))


@pytest.mark.parametrize("coloured", [False, True])
def test_what_the_fit_took_out_is_given_back(coloured: bool) -> None:
    """Eight parameters on 150 samples: the naive middle would be short by 3 % (white) or by a tenth."""
    n, p = 150, 8
    omega = _covariance(n) if coloured else np.eye(3 * n)
    columns = _columns(n, p)
    every = np.ones(n, dtype=np.bool_)
    flat = columns.reshape(3 * n, p)
    truth = np.diag(flat.T @ omega @ flat)
    found = _mean_of(omega, columns, every, lambda one, basis: np.diag(serial([one], basis).quadratic_of(0, columns)))
    assert np.mean(found / truth) == pytest.approx(1.0, abs=0.06 if coloured else 0.02)


def test_white_noise_has_no_memory() -> None:
    """The window is closed, channels keep their own size, and nearly every sample counts as one."""
    n = 600
    rng = np.random.default_rng(1)
    size = np.array([1.0, 2.0, 0.5])
    columns = rng.standard_normal((n, 3, 2))
    block = _block(rng.standard_normal((n, 3)) * size)
    found = serial([block], Basis((), np.linalg.qr(columns.reshape(3 * n, 2))[0]))
    assert np.all(found.windows == 0.0)
    own = np.sqrt(np.mean(block.residual**2, axis=0))
    expected = np.einsum("tci,c,tcj->ij", columns, own**2, columns)
    np.testing.assert_allclose(found.quadratic_of(0, columns), expected, rtol=0.01, atol=0.01 * np.max(expected))
    assert np.all(satterthwaite(*found.moments(0, columns)) > 0.5 * n)


def test_windows_are_in_seconds_and_of_each_rate_alone() -> None:
    """The same noise at half the rate has half as many correlated lags; both are found, and the middle adds up."""
    rng = np.random.default_rng(2)
    root = linalg.cholesky(_covariance(600), lower=True)
    constant = Basis((), np.full((1800, 1), 1800**-0.5))

    def block(step: float) -> Block:
        noise = (root @ rng.standard_normal(1800)).reshape(600, 3)
        return replace(_block(noise), step=step)

    fast, slow = block(0.01), block(0.02)
    alone = [serial([one], constant) for one in (fast, slow)]
    assert 5 * 0.01 <= alone[0].windows[0] <= 60 * 0.01
    assert alone[0].windows[2] == 0.0
    both = serial([fast, replace(slow, rows=slow.rows + 1800)], Basis((), np.full((3600, 1), 60**-1.0)))
    np.testing.assert_allclose(both.windows, np.maximum(alone[0].windows, alone[1].windows))


def test_blocks_are_the_rows_of_the_fit_at_their_times(pike: Fish) -> None:
    """A drive that steps leaves a gap of masked samples; nothing else moves."""
    noise = Autoregressive(readonly([0.01, 0.01, 0.05]), readonly(np.full((3, 2), 0.1)))
    posed = problem(swimming(pike, ("v1-v5", "v1"), duration=6.0), noise=noise)
    one = fit(posed, evaluations=2)
    blocks = blocks_of(posed, one.residual)
    assert [block.trial for block in blocks] == ["v1-v5", "v1"]
    assert not np.any(blocks[0].counted[259:262])
    assert [int(block.counted.sum()) for block in blocks] == [301 - 3, 301]
    rows = np.concatenate([block.residual[block.counted].ravel() for block in blocks])
    np.testing.assert_array_equal(rows, one.residual)
    jacobian = one.jacobian.dense()
    columns = [block.on_grid(jacobian[block.rows])[block.counted].reshape(-1, 9) for block in blocks]
    np.testing.assert_array_equal(np.concatenate(columns), jacobian)
    early = replace(posed, trials=tuple(replace(t, time=t.time * 2.0) for t in posed.trials[1:]))
    assert blocks_of(early, rows[-903:])[0].step == pytest.approx(0.04)


def test_columns_of_long_runs_are_transformed_a_few_at_a_time(monkeypatch: pytest.MonkeyPatch) -> None:
    n, rng = 300, np.random.default_rng(3)
    block = _block(linalg.cholesky(_covariance(n), lower=True).dot(rng.standard_normal(3 * n)).reshape(n, 3))
    columns, basis = _columns(n, 5), Basis((), linalg.orth(_columns(n, 7).reshape(3 * n, 7)))

    def found() -> list[FloatArray]:
        one = serial([block], basis)
        return [one.quadratic_of(0, columns), one.moments(0, columns), one.moments(0, columns, total=True)]

    at_once = found()
    monkeypatch.setattr("mjfish.estimation.serial_correlation._NUMBERS", 2 * 3 * n)
    for few, every in zip(found(), at_once, strict=True):
        np.testing.assert_allclose(few, every, rtol=1e-10)
