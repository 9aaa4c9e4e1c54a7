"""Tests of columns of single runs, run by run, against the same in plain matrices."""

from __future__ import annotations

import numpy as np
import pytest

from mjfish.diagnosis.evidence import RunEffects, flipped_p
from mjfish.numerics.arrays import FloatArray, orthonormal, principal_axes, project_out
from mjfish.numerics.block_angular import BlockAngular, Part, block_angular, span

RUNS, ROWS, WAVES = 12, 40, 6


def _run_effects(seed: int = 0) -> tuple[RunEffects, FloatArray, FloatArray]:
    """Return columns beside three shared parameters and one of each run, and W and M W as plain matrices."""
    rng = np.random.default_rng(seed)
    rows = [np.arange(r * ROWS, (r + 1) * ROWS) for r in range(RUNS)]
    parts = tuple(Part(at, np.array([3 + r]), rng.standard_normal((ROWS, 1))) for r, at in enumerate(rows))
    jacobian = BlockAngular(rng.standard_normal((RUNS * ROWS, 3)), np.arange(3), parts)
    blocks = [rng.standard_normal((ROWS, WAVES)) * np.geomspace(1.0, 30.0, WAVES) for _ in rows]
    columns = block_angular(np.zeros((RUNS * ROWS, 0)), rows, blocks)
    found = RunEffects(jacobian, span(jacobian), columns)
    return found, columns.dense(), project_out(orthonormal(jacobian.dense()), columns.dense())


def _residual(run_effects: RunEffects, seed: int = 1) -> FloatArray:
    return run_effects.basis.off(np.random.default_rng(seed).standard_normal(RUNS * ROWS))


def test_the_statistic_is_that_of_all_columns() -> None:
    run_effects, _, beyond = _run_effects()
    z = _residual(run_effects)
    axes = beyond @ principal_axes(beyond.T @ beyond)
    statistic, rank = run_effects.statistic(z)
    assert rank == axes.shape[1] == RUNS * WAVES
    assert statistic == pytest.approx(float(np.sum((axes.T @ z) ** 2)), rel=1e-9)
    np.testing.assert_allclose(run_effects.fitted(z), axes @ (axes.T @ z), atol=1e-9)
    assert run_effects.flipped_p(z) == pytest.approx(flipped_p(beyond, z), rel=1e-6)


def test_columns_of_nothing_are_no_evidence() -> None:
    run_effects, _, _ = _run_effects()
    nothing = RunEffects(run_effects.jacobian, run_effects.basis, BlockAngular.of(np.zeros((RUNS * ROWS, 0))))
    z = _residual(run_effects)
    assert nothing.statistic(z) == (pytest.approx(0.0, abs=1e-9), 0)
