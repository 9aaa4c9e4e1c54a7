"""The size of a walk of the drive's clock, from velocities."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import mjfish
from mjfish.data import Dataset
from mjfish.estimation import Fit, Noise, Problem, fit
from mjfish.estimation.marginal_likelihood import CLEAR, log_likelihood_gained, of_every_run, walk_size, with_size
from mjfish.estimation.noise_of_fit import noise_of, walk_of
from mjfish.estimation.nominal import nominal_problem
from mjfish.model.sensitivity import sensitivities
from mjfish.numerics.arrays import readonly

SIGMA = np.array([0.006, 0.006, 0.04])


def _pool(size: float, seed: int = 3) -> Dataset:
    modes = ["v1", "v3", "v5", "v7"]
    return mjfish.generate("pike", modes, values={"clock_wander.size": size}, noise=SIGMA, duration=5.0, seed=seed)


def _fitted(pool: Dataset) -> tuple[Problem, Fit]:
    problem = nominal_problem(pool, pool.trials, Noise.white(SIGMA))
    return problem, fit(problem, problem.start(), tolerance=1e-6)


def _first_size(problem: Problem, found: Fit) -> float:
    nothing = [np.zeros((int(np.count_nonzero(problem.mask(i))), 3, 0)) for i in range(len(problem.trials))]
    noise, _ = noise_of(problem, found, nothing, SIGMA, patterns=False)
    return walk_of(problem, found, nothing, noise)


@pytest.mark.parametrize("size", [0.003, 0.008])
def test_size_and_coefficients_come_out_as_they_were(size: float) -> None:
    pool = _pool(size)
    problem, found = _fitted(pool)
    assert found.sse > 3.0 * found.count
    walking, found = with_size(problem, found, _first_size(problem, found))
    _, determined = walk_size(walking, found)
    assert abs(np.log(walking.walk / size)) < 2.5 / np.sqrt(2.0 * determined)
    assert found.sse < 1.1 * found.count
    assert found.values["c_d.body"] == pytest.approx(pool.fish.values["c_d.body"], rel=0.05)
    assert log_likelihood_gained(walking, found) > 10.0 * CLEAR
    assert of_every_run(walking, found)


def test_white_noise_has_no_walk() -> None:
    assert _first_size(*_fitted(_pool(0.0))) == 0.0


def test_lost_frames_of_one_run_are_no_walk() -> None:
    pool = _pool(0.0)
    first, *others = pool.trials
    late = replace(
        first, time=readonly(first.time[:-5]), velocity=readonly(np.delete(first.velocity, np.s_[100:105], 0))
    )
    problem, found = _fitted(replace(pool, trials=(late, *others)))
    assert not of_every_run(*with_size(problem, found, _first_size(problem, found) or 1e-3))


def test_a_walk_that_is_none_goes_to_nothing() -> None:
    problem, found = _fitted(_pool(0.0))
    still, _ = with_size(problem, found, 1e-3)
    assert still.walk < 3e-4


def test_derivatives_by_the_modes_are_those_of_differences() -> None:
    (trial,) = mjfish.generate("pike", ["v3"], duration=4.0).trials
    trial = replace(trial, walk=tuple(0.004 * np.random.default_rng(0).standard_normal(8)))
    model = mjfish.Model(mjfish.load_fish("pike"))
    for mode in (0, 7):

        def predicted(by: float, mode: int = mode) -> np.ndarray:
            walk = tuple(own + by * (m == mode) for m, own in enumerate(trial.walk))
            return model.predict(replace(trial, walk=walk), model.values()).velocity

        expected = (predicted(1e-4) - predicted(-1e-4)) / 2e-4
        found = sensitivities(model, trial, model.values(), [f"walk.{mode}"])[:, :, 0]
        np.testing.assert_allclose(found, expected, atol=5e-3 * np.abs(expected).max())
