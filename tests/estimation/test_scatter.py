"""Scatter from run to run is told apart from the error with which every run tells its coefficients."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from noise_draws import INSIDE, Draws, draws
from synthetic_swimming import problem, swimming

from mjfish.estimation import Problem, fit
from mjfish.estimation.stability import Reduced, _deviations, scatter
from mjfish.fish import Fish
from mjfish.numerics.arrays import FloatArray

MODES = ("v1", "v3", "v5")


def _runs(fish: Fish, name: str, factors: FloatArray) -> Problem:
    """Return runs of 6 s in one dataset, each by a fish whose coefficient is another multiple of the true one."""
    trials = []
    for k, factor in enumerate(factors):
        values = {**INSIDE, name: factor * INSIDE[name]}
        mode = (*MODES, "v1-t1")[k % 4]
        swum = swimming(fish, (mode,), values=values, duration=6.0, seed=100 + k)
        trials.append(replace(swum.trials[0], name=f"run{k}"))
    return problem(replace(swum, trials=tuple(trials)))


@pytest.mark.parametrize(("name", "relative"), [("c_d.tail", 0.05), ("c_d.body", 0.1)])
def test_a_drag_coefficient_that_differs_by_run_is_found_with_its_scatter(
    pike: Fish, name: str, relative: float
) -> None:
    """To 15 % of the standard deviation of the values of eight runs; others have no more than a few errors of a run."""
    drawn = np.random.default_rng(0).standard_normal(8)
    factors = 1.0 + relative * (drawn - drawn.mean()) / drawn.std(ddof=1)
    posed = _runs(pike, name, factors)
    found = fit(posed)
    tau = scatter(posed, found)
    assert tau[name] == pytest.approx(relative * INSIDE[name], rel=0.15)
    of_a_run = {other: np.sqrt(8.0) * sigma for other, sigma in found.sigma.items()}
    assert tau[name] > 3.0 * of_a_run[name]
    assert all(tau[other] < of_a_run[other] for other in tau if other != name)


@pytest.fixture(scope="module")
def alike(pike: Fish) -> Draws:
    """Six runs of one fish."""
    return draws(pike, MODES * 2, duration=4.0)


@pytest.mark.parametrize("phi", [pytest.param(0.0, marks=pytest.mark.slow), 0.8])
def test_runs_of_one_fish_are_not_scattered_in_most_draws(alike: Draws, phi: float) -> None:
    """Of 40 draws of noise, white or coloured: 0 in most, and else hardly above the error of one run."""
    fits = [*alike.fits(phi, 40, 4)]
    tau = np.array([[*scatter(alike.problem, one).values()] for one in fits])
    error = np.std([one.x for one in fits], axis=0) * np.sqrt(6.0)
    assert tau.shape == (40, 9)
    assert np.mean(tau == 0.0) > 0.65
    assert np.all(np.mean(tau == 0.0, axis=0) > 0.5)
    assert np.max(tau / error) < 1.5


def test_of_one_coefficient_it_is_what_dersimonian_and_laird_found() -> None:
    """Runs with the same error: variance of the estimates less that of the error, or nothing."""
    rng = np.random.default_rng(1)
    for spread in (0.0, 0.3, 1.0, 1.0, 3.0):
        own = spread * rng.standard_normal(12) + 0.5 * rng.standard_normal(12)
        tau = _deviations(_of_one(own / 0.5, np.full(12, 2.0)), [0], np.array([100.0]))
        assert tau[0] ** 2 == pytest.approx(max(np.var(own, ddof=1) - 0.25, 0.0), rel=1e-3, abs=1e-6)


def test_a_run_that_does_not_move_a_coefficient_says_nothing_of_its_scatter() -> None:
    own = np.array([0.0, 4.0, 6.0, 1.0])
    moved = _of_one(own, np.ones(4))
    still = _of_one(np.append(own, 7.0), np.array([1.0, 1.0, 1.0, 1.0, 0.0]))
    widest = np.array([100.0])
    assert _deviations(still, [0], widest)[0] == pytest.approx(_deviations(moved, [0], widest)[0], rel=1e-4)


def _of_one(residual: FloatArray, slope: FloatArray) -> Reduced:
    """Return one coefficient in runs of one number each, with errors of size one."""
    nothing: Any = None
    names = tuple(f"run{k}" for k in range(len(slope)))
    return Reduced(names, nothing, (), slope[:, None, None], residual[:, None], np.ones((len(slope), 1, 1)))


def test_scatter_is_never_wider_than_the_bounds() -> None:
    assert _deviations(_of_one(np.array([0.0, 40.0, 90.0]), np.ones(3)), [0], np.array([2.0]))[0] == 2.0


def test_one_run_and_what_rests_on_a_bound_have_none(pike: Fish) -> None:
    posed = problem(swimming(pike, MODES[:2], duration=3.0))
    held = next(p for p in pike.parameters if p.name == "c_d.head").rebound(high=1.2)
    posed = replace(posed, declared={"c_d.head": held})
    found = fit(posed)
    assert found.at_bound[[p.name for p in found.parameters].index("c_d.head")]
    assert "c_d.head" not in scatter(posed, found)
    assert "c_d.body" in scatter(posed, found)
    alone = replace(posed, trials=posed.trials[:1])
    assert scatter(alone, fit(alone)) == {}
