"""The sides of the fits in the bench do the same work, and a comparison whose sides disagree is stopped."""

from __future__ import annotations

import numpy as np
import pytest
from mujoco import sysid
from pike_coefficients import COEFFICIENTS

import bench_identify
from comparison import Comparison, Side, measure
from mjfish.estimation import Problem

#: Coefficients away from the true ones, inside the bounds.
_ELSEWHERE = (1.5, 0.2, 0.9, 3.0, 0.5, 2.5, 0.004, 0.015, 0.006)


@pytest.fixture(scope="module")
def posed() -> Problem:
    return bench_identify.posed(("v1", "v7"), 1.0)


def test_sysid_sees_the_residual_of_the_fit_also_away_from_the_truth(posed: Problem) -> None:
    """Both trials, all channels, to a fifth of a sigma. Catches another joint motion, clock, frame or coefficient."""
    side = bench_identify.SysidFit(posed)
    parameters = sysid.ParameterDict()
    for one in side.start:
        parameters.add(one)
    assert [one.name for one in side.start] == list(COEFFICIENTS)
    with side.water.installed():
        found = np.concatenate(side.residual(np.array(_ELSEWHERE), parameters)[0])
    expected = posed.residual(np.array(_ELSEWHERE))
    assert np.abs(expected).max() > 10.0
    np.testing.assert_allclose(found, -expected, atol=0.2)


def test_plain_numpy_sees_the_residual_of_the_fit_also_away_from_the_truth(posed: Problem) -> None:
    found = bench_identify.PlainFit(posed).residual(np.array(_ELSEWHERE))
    np.testing.assert_allclose(found, -posed.residual(np.array(_ELSEWHERE)), atol=0.2)


def test_fits_that_end_at_different_costs_stop_the_bench(posed: Problem, monkeypatch: pytest.MonkeyPatch) -> None:
    """A thousandth is the limit."""
    monkeypatch.setattr(bench_identify.SysidFit, "__call__", lambda _: 1.002)
    monkeypatch.setattr(bench_identify, "posed", lambda *_: posed)
    comparison = bench_identify.fit_vs_mujoco_sysid()
    assert comparison.agree is not None
    comparison.agree(1.0005, 1.0)
    with pytest.raises(SystemExit, match="fit_vs_mujoco_sysid: the fits do not end at the same cost"):
        measure(comparison, lambda: None)


def test_a_cold_side_is_run_as_often_as_it_is_timed() -> None:
    """And what it returned is compared with what the other did."""
    calls: list[str] = []
    told: list[tuple[object, object]] = []
    comparison = Comparison(
        top=Side("slow", lambda: calls.append("slow") or "same", warm=False),
        bottom=Side("fast", lambda: calls.append("fast") or "same", times=2),
        target=1.0,
        at_least=True,
        repeats=1,
        agree=lambda top, bottom: told.append((top, bottom)),
    )
    measure(comparison, lambda: None)
    assert calls == ["fast", "slow", "fast", "fast"]
    assert told == [("same", "same")]
