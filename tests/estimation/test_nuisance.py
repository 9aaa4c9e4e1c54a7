"""What belongs to single trials: velocity at the start, offset of the clock."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from pike_coefficients import COEFFICIENTS
from synthetic_swimming import SIGMA, as_measured, off_truth, problem, shifted, swimming

from mjfish.data import Dataset
from mjfish.estimation import Fit, fit
from mjfish.fish import Fish
from mjfish.fish.frames import CHANNELS

RATE = 100.0
OFFSETS = {"v1": 3, "v3": 0, "v5": 6}


@pytest.fixture(scope="module")
def clean(pike: Fish) -> Dataset:
    """The truth without noise: what was the velocity where recording began."""
    return swimming(pike, rate=RATE, noise=None)


@pytest.fixture(scope="module")
def recorded(pike: Fish) -> Dataset:
    """Recordings that begin in the middle of a run, with noisy joint angles in place of the drive."""
    whole = swimming(pike, rate=RATE)
    trials = (as_measured(trial, pike, noise=5e-4, seed=i) for i, trial in enumerate(whole.trials))
    return replace(whole, trials=tuple(trials))


@pytest.fixture(scope="module")
def fitted(recorded: Dataset) -> Fit:
    return fit(problem(recorded), tolerance=1e-6)


def test_coefficients_come_back_from_recordings_that_begin_in_the_middle_of_a_run(fitted: Fit) -> None:
    """Within five standard errors: the noise of the angles, which this fit does not know of, adds a little."""
    assert fitted.status == "converged"
    errors = {name: max(fitted.sigma[name], 1e-9) for name in COEFFICIENTS}
    off = off_truth(fitted.values, errors)
    free = ~fitted.at_bound[:9]
    assert np.count_nonzero(free) >= 7
    assert np.max(np.abs(off[free])) < 5.0


def test_the_velocity_at_the_start_comes_back(clean: Dataset, recorded: Dataset, fitted: Fit) -> None:
    at = int(RATE)
    for before, trial in zip(clean.trials, recorded.trials, strict=True):
        for c, channel in enumerate(CHANNELS):
            name = f"{trial.name}:start.{channel}"
            assert fitted.sigma[name] < 10.0 * SIGMA[c]
            assert abs(fitted.values[name] - before.velocity[at, c]) < 5.0 * fitted.sigma[name]


def test_a_start_at_rest_would_not_explain_them(recorded: Dataset, fitted: Fit) -> None:
    posed = problem(recorded)
    resting = {p.name: 0.0 for p in posed.parameters if ":start." in p.name}
    assert np.sum(posed.residual(posed.start({**fitted.values, **resting})) ** 2) > 10.0 * fitted.sse


@pytest.fixture(scope="module")
def unsynchronised(pike: Fish) -> Dataset:
    whole = swimming(pike, rate=RATE)
    trials = tuple(shifted(trial, OFFSETS[trial.name]) for trial in whole.trials)
    return replace(whole, trials=trials, clock="free")


@pytest.fixture(scope="module")
def clocked(unsynchronised: Dataset) -> Fit:
    return fit(problem(unsynchronised), tolerance=1e-6)


def test_free_clocks_come_back_each_its_own(clocked: Fit) -> None:
    """What is recorded at t happened at t + offset. Catches the opposite sign, and one offset for all."""
    assert clocked.status == "converged"
    for name, samples in OFFSETS.items():
        key = f"{name}:clock.offset"
        assert clocked.sigma[key] < 2e-3
        assert abs(clocked.values[key] - samples / RATE) < 4.0 * clocked.sigma[key]
    assert np.max(np.abs(off_truth(clocked.values, clocked.sigma))) < 4.0


def test_a_clock_taken_for_good_that_is_not_spoils_the_fit(unsynchronised: Dataset, clocked: Fit) -> None:
    trusted = fit(problem(unsynchronised, free_clock=False), clocked.x[:9], tolerance=1e-4)
    assert trusted.sse > 2.0 * clocked.sse
