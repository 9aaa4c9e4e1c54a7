"""Roll: against its pendulum, closed forms, and a measured channel."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from recovery import NOISE, TRUTH, derivative_error, deviations, found_again, refitted
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

from mjfish.data import Trial
from mjfish.effects import find
from mjfish.effects.roll import GRAVITY
from mjfish.fish import Fish
from mjfish.model import Model
from mjfish.numerics.arrays import FloatArray, readonly
from mjfish.simulation.synthetic import generate

ROLL = find("roll")
SHAPES = {"frequency": 9.0, "damping": 0.15}


def _rate(state: FloatArray, trial: Trial, frequency: float, damping: float) -> FloatArray:
    """Return phi' that the cause adds, read off a marker at -1 m."""
    read = ROLL.reading(state, {"height": -1.0, "frequency": frequency, "damping": damping}, trial)
    assert np.array_equal(np.delete(read, 1, axis=1), np.delete(state, 1, axis=1))
    return np.asarray(read[:, 1] - state[:, 1])


def _sways(trial: Trial, sway: FloatArray) -> FloatArray:
    state = np.zeros((len(trial.time), 8))
    state[:, 1] = sway
    return state


@pytest.mark.parametrize("omega", [4.0, 9.0, 18.0, 26.0])
def test_a_sway_that_swings_makes_it_roll_as_the_transfer_function_says(straight: Trial, omega: float) -> None:
    """That of phi' on sway is k w^2 / (w_r^2 - w^2 + 2 i zeta w_r w), k = w_r^2 / g, once the start has died away.

    Here w_r = 9, and the swing is small. With 50 samples a second, to a hundredth at the quickest beat. Catches a wrong
    sign, power or damping.
    """
    long = replace(straight, time=readonly(np.arange(1001) / 50.0))
    coupling, frequency, damping = 81.0 / GRAVITY, 9.0, 0.15
    gain = 0.01 * coupling * omega**2 / (frequency**2 - omega**2 + 2j * damping * frequency * omega)
    expected = (gain * np.exp(1j * omega * long.time)).real
    found = _rate(_sways(long, 0.01 * np.cos(omega * long.time)), long, frequency, damping)
    settled = (long.time > 10.0) & (long.time < 19.9)
    np.testing.assert_allclose(found[settled], expected[settled], rtol=0.0, atol=0.01 * abs(gain))


def test_in_a_steady_turn_the_fish_leans_like_a_plumb_line(straight: Trial) -> None:
    """Towards -asin of yaw rate times surge over g, once; then it no longer rolls. Catches the sign of the turn."""
    long = replace(straight, time=readonly(np.arange(1001) / 50.0))
    state = np.zeros((1001, 8))
    state[:, 0], state[:, 2] = 0.5, 1.2
    rate = _rate(state, long, 9.0, 0.5)
    assert np.sum(rate) / 50.0 == pytest.approx(-0.6 / GRAVITY, rel=5e-3)
    assert np.max(np.abs(rate[-100:])) < 1e-6


def test_it_solves_its_equation_for_a_swimming_fish(pike: Fish, straight: Trial) -> None:
    """Integrates the equation of phi anew, by scipy, with sway' itself and the rollout between the samples."""
    rollout = Model(pike).predict(straight, Model(pike).values()).rollout
    dense = np.linspace(0.0, 3.0, 6001)
    fine = CubicSpline(dense, rollout.at(dense)[:, :3])
    frequency, damping = SHAPES.values()

    def rates(t: float, x: FloatArray) -> list[float]:
        surge, _, yaw_rate = fine(t)
        side = fine(t, 1)[1] + yaw_rate * surge
        return [x[1], -2.0 * damping * frequency * x[1] - frequency**2 * (np.sin(x[0]) + side / GRAVITY)]

    solved = solve_ivp(rates, (0.0, 3.0), [0.0, 0.0], t_eval=straight.time, max_step=0.005, rtol=1e-8, atol=1e-9).y[1]
    found = _rate(rollout.at(straight.time), straight, frequency, damping)
    assert np.sqrt(np.mean((found - solved) ** 2)) < 0.02 * np.sqrt(np.mean(solved**2))


def test_a_measured_roll_is_used_as_it_was_measured(turning: Trial) -> None:
    """Its slope is phi', the pendulum plays no part. Rolling port up takes the marker to starboard."""
    angle = 0.1 * np.sin(9.0 * turning.time)
    measured = replace(turning, roll=readonly(angle))
    state = np.zeros((len(angle), 8))
    reads = [
        ROLL.reading(state, {"height": 0.02, "frequency": frequency, "damping": 0.2}, measured)
        for frequency in (2.0, 30.0)
    ]
    assert np.array_equal(*reads)
    np.testing.assert_allclose(reads[0][3:-3, 1], -0.02 * 0.9 * np.cos(9.0 * turning.time[3:-3]), rtol=0.0, atol=2e-5)
    assert not np.any(ROLL.reading(state, {"height": 0.02, **SHAPES}, turning))


def test_a_marker_that_leans_is_seen_beside_the_fish(turning: Trial) -> None:
    """Its sway is the rate at which a camera sees it move aside. Catches a sign, and a roll from another start."""
    fine = replace(turning, time=readonly(np.linspace(0.0, 2.0, 2001)), velocity=np.full((2001, 3), np.nan))
    t, state = fine.time, np.zeros((2001, 8))
    state[:, 0], state[:, 1], state[:, 2] = 0.4, 0.1 * np.sin(8.0 * t), 1.5
    values = {"height": 0.03, **SHAPES}
    aside, read = ROLL.displacement(t, state, values, fine), ROLL.reading(state, values, fine)
    assert np.max(np.abs(aside[:, 1])) > 1e-3
    np.testing.assert_allclose(aside[:, 0], 0.0)
    np.testing.assert_allclose(read[5:-5, 1] - state[5:-5, 1], np.gradient(aside[:, 1], t)[5:-5], atol=1e-4)


@pytest.mark.parametrize(
    ("short", "rolled"), [("height", False), ("frequency", False), ("damping", False), ("height", True)]
)
def test_its_sensitivities_are_those_of_predictions(pike: Fish, turning: Trial, short: str, rolled: bool) -> None:
    trial = replace(turning, roll=readonly(0.1 * np.sin(9.0 * turning.time))) if rolled else turning
    assert derivative_error(pike, trial, ROLL, {"height": 0.02, **SHAPES}, short) < 1e-6


def test_at_the_null_it_has_a_sensitivity(pike: Fish, turning: Trial) -> None:
    assert derivative_error(pike, turning, ROLL, {"height": 0.0, **SHAPES}, "height") < 1e-7


def test_a_hidden_roll_is_found_again_with_its_pendulum(pike: Fish) -> None:
    sizes = {"height": 0.015, **SHAPES}
    found = found_again(pike, ROLL, sizes)
    assert found.sigma["roll.frequency"] < 2.0


def test_with_a_measured_roll_the_height_of_the_marker_is_found(pike: Fish) -> None:
    """The roll is anything, here no answer of a pendulum at all, and has noise of its own."""
    rng = np.random.default_rng(5)
    clean = generate(pike, ["v1", "v3", "v7"], values=TRUTH, noise=NOISE, duration=3.0, seed=4)
    trials = []
    for trial in clean.trials:
        t = trial.time
        rate = 1.1 * np.cos(11.0 * t) - 0.4 * np.sin(3.0 * t)
        angle = 0.1 * np.sin(11.0 * t) + 0.4 / 3.0 * np.cos(3.0 * t) + 2e-3 * rng.standard_normal(len(t))
        velocity = trial.velocity - 0.03 * rate[:, None] * [0.0, 1.0, 0.0]
        trials.append(replace(trial, velocity=readonly(velocity), roll=readonly(angle)))
    dataset = replace(clean, trials=tuple(trials))
    found = refitted(dataset, ROLL, {f"roll.{short}": value for short, value in SHAPES.items()})
    assert found.status == "converged"
    assert abs(deviations(found, ROLL, {"height": 0.03})["height"]) < 4.0
    assert found.sigma["roll.height"] < 0.002
