"""Fits of too many parameters for a singular value decomposition: the same optimum, and no matrix of all of them."""

from __future__ import annotations

import importlib
from dataclasses import replace

import numpy as np
import pytest
from synthetic_swimming import as_measured, problem, swimming

from mjfish.estimation.fit import fit
from mjfish.fish import Fish
from mjfish.numerics.block_angular import BlockAngular


def test_steps_by_lsmr_find_the_optimum_of_exact_ones(pike: Fish, monkeypatch: pytest.MonkeyPatch) -> None:
    """Four runs with a start of their own each: estimates differ by less than a millionth of their standard errors."""
    driven = swimming(pike, ("v1", "v3", "v5", "v7"), duration=2.5)
    posed = problem(replace(driven, trials=tuple(as_measured(trial, pike) for trial in driven.trials)))
    exact = fit(posed)
    monkeypatch.setattr(importlib.import_module("mjfish.estimation.fit"), "_DENSE", 1)
    dense = BlockAngular.dense

    def small(matrix: BlockAngular) -> object:
        assert not matrix.parts, "a matrix of all parameters was made"
        return dense(matrix)

    monkeypatch.setattr(BlockAngular, "dense", small)
    iterated = fit(posed)
    assert iterated.evaluations <= exact.evaluations + 1
    assert iterated.status == exact.status == "converged"
    assert np.array_equal(iterated.at_bound, exact.at_bound)
    np.testing.assert_array_less(np.abs(iterated.x - exact.x), 1e-6 * exact.reach)
    assert iterated.sse == pytest.approx(exact.sse, rel=1e-12)
    np.testing.assert_allclose(iterated.covariance, exact.covariance, rtol=1e-6, atol=1e-12)
