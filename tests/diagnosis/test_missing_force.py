"""The missing force: a push that is added comes back, inside its band, in its own channel."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mjfish.diagnosis.missing_force import missing_force, stretched, with_velocities
from mjfish.estimation import Noise, Problem, fit
from mjfish.fish import Fish, load_fish
from mjfish.model import Model
from mjfish.numerics.arrays import readonly
from mjfish.ode.jacobians import jacobians
from mjfish.simulation.synthetic import generate

SIGMA = np.array([0.006, 0.006, 0.04])


@pytest.fixture(scope="module")
def pike() -> Fish:
    """The shipped fish."""
    return load_fish("pike")


def test_the_stretched_fish_has_its_mass_along_and_the_waters_too_across(pike: Fish) -> None:
    """Catches an added mass along the body, or a moment that is not moved to the nose."""
    inertia = stretched(pike, {**pike.values, "c_m.head": 0.5, "c_m.body": 0.5, "c_m.tail": 0.5})
    assert inertia[0, 0] == pytest.approx(sum(link.mass for link in pike.links))
    assert inertia[1, 1] > 1.3 * inertia[0, 0]
    np.testing.assert_allclose(inertia, inertia.T)
    np.testing.assert_allclose(inertia[0, 1:], 0.0)
    arm = -inertia[1, 2] / inertia[1, 1]  # of the centre of mass, behind the nose: a push there does not turn
    assert 0.1 < arm < 0.4
    assert inertia[2, 2] > inertia[1, 1] * arm**2


def test_a_steady_push_across_comes_back_with_its_size_inside_its_band(pike: Fish) -> None:
    """A push of 0.2 m/s2 sideways from 3 s to 5 s: the deviation obeys the linearised equation."""
    rng = np.random.default_rng(4)
    dataset = generate(pike, ["v1", "v5"], noise=np.full(3, 1e-9), duration=7.0, seed=2, held_out=[])
    problem = Problem(Model(dataset.fish), dataset.trials, Noise.white(SIGMA))
    one = fit(problem, tolerance=1e-6)
    pushed = []
    for trial in dataset.trials:
        run = problem.model.prepare(trial, one.values)
        rollout = problem.prediction(trial, one.values).rollout
        a, _ = jacobians(run.fish, rollout, values=run.coefficients)
        deviation = np.zeros((len(a) + 1, 3))
        for k, step in enumerate(np.diff(rollout.time)):
            push = np.array([0.0, 0.2, 0.0]) * (3.0 <= rollout.time[k] < 5.0)
            deviation[k + 1] = deviation[k] + step * (a[k] @ deviation[k] + push)
        seen = np.stack([np.interp(trial.time, rollout.time, deviation[:, c]) for c in range(3)], axis=1)
        noisy = trial.velocity + seen + SIGMA * rng.standard_normal(seen.shape)
        pushed.append(replace(trial, velocity=readonly(noisy)))
    found = missing_force(replace(problem, trials=tuple(pushed)), one.values)
    expected = stretched(pike, one.values)[1, 1] * 0.2
    for force in found:
        middle, before = ((force.time > low) & (force.time < high) for low, high in ((3.4, 4.8), (0.5, 2.8)))
        assert force.force[middle, 1].mean() == pytest.approx(expected, rel=0.3)
        assert abs(force.force[before, 1].mean()) < 0.25 * expected
        assert abs(force.force[middle, 1].mean() - expected) < 2.0 * force.band[middle, 1].mean()


def test_what_moves_the_fish_is_its_inertia_times_its_acceleration(pike: Fish) -> None:
    """Against differences of the simulated velocities. Catches measured, noisy ones that are differentiated."""
    dataset = generate(pike, ["v1", "v5"], noise=SIGMA, duration=6.0, seed=2, held_out=[])
    problem = Problem(Model(dataset.fish), dataset.trials, Noise.white(SIGMA))
    one = fit(problem, tolerance=1e-6)
    inertia = stretched(pike, one.values)
    for i, found in enumerate(missing_force(problem, one.values)):
        times = dataset.trials[i].time[problem.mask(i)]
        rollout = problem.prediction(dataset.trials[i], one.values).rollout
        ahead, back = rollout.at(times + 1e-4), rollout.at(times - 1e-4)
        inner = slice(1, -1)  # at rest and at the end there is one side only
        swum = ((ahead - back) / 2e-4)[inner, :3] @ inertia.T
        np.testing.assert_allclose(found.driving, np.sqrt(np.mean(swum**2, axis=0)), rtol=0.02)


def test_a_film_shows_the_force_that_velocities_show(pike: Fish) -> None:
    """Of places and headings alone, by the velocities of the smoothed path; one of another frame or time is another."""
    found = []
    for observe, noise in (("pose", (1e-4, 1e-4, 1e-3)), ("velocity", (1e-4, 1e-4, 1e-3))):
        dataset = generate(
            pike, ["v1"], values={"tail_compliance.compliance": 0.3}, noise=noise, duration=5.0, observe=observe,
            places=[(0.5, 0.0, 0.3)],
        )  # fmt: skip
        problem = Problem(Model(pike), dataset.trials, Noise.white(np.array([1e-4, 1e-4, 1e-3])))
        problem = replace(problem, sensor_sigma={"position": np.array([1e-4, 1e-4]), "heading": np.array([1e-3])})
        values = {**problem.fixed, **problem.named(problem.start())}
        looked = with_velocities(problem, values)
        assert looked is not None
        (one,) = missing_force(looked, values)
        found.append(one.force[(one.time > 0.5) & (one.time < 4.5)])
    for across in (1, 2):  # next to nothing is missing along
        filmed, known = (force[:, across] for force in found)
        assert np.corrcoef(filmed, known)[0, 1] > 0.95
