"""Roll learned: the nose's acceleration drives it too, and its two limits are the formulas."""

from __future__ import annotations

import numpy as np
import pytest
from link_forces import VALUES
from recovery import derivative_error
from scipy import integrate
from scipy.interpolate import CubicSpline

from mjfish.data import Trial
from mjfish.effects import find
from mjfish.effects.effect import Effect
from mjfish.effects.roll_law import RollLaw
from mjfish.fish import Fish
from mjfish.model import Model

ROLL = {"square": 1.0, "frequency": 9.0, "damping": 0.3, "inertial": 0.6, "nose": 0.0, "height": 0.0}


@pytest.fixture(scope="module")
def effect(pike: Fish) -> Effect:
    """The cause as the pike has it."""
    own = RollLaw().for_fish(pike)
    assert own is not None
    return own


def _values(**given: float) -> dict[str, float]:
    return {**VALUES, **{f"roll_law.{short}": value for short, value in (ROLL | given).items()}}


def test_without_the_nose_it_is_the_loss_of_drag(pike: Fish, effect: Effect, straight: Trial) -> None:
    loss = find("roll_loss").for_fish(pike)
    assert loss is not None
    own = {f"roll_loss.{short}": ROLL[short] for short in ("square", "frequency", "damping", "inertial")}
    expected = Model(pike, (loss,)).predict(straight, VALUES | own).velocity
    assert np.array_equal(Model(pike, (effect,)).predict(straight, _values()).velocity, expected)


def test_without_a_loss_the_camera_reads_the_roll(pike: Fish, effect: Effect, straight: Trial) -> None:
    own = {"roll.height": 0.03, "roll.frequency": ROLL["frequency"], "roll.damping": ROLL["damping"]}
    expected = Model(pike, (find("roll"),)).predict(straight, VALUES | own).velocity
    got = Model(pike, (effect,)).predict(straight, _values(square=0.0, height=0.03)).velocity
    np.testing.assert_allclose(got, expected, rtol=0.0, atol=1e-12)


def test_the_acceleration_of_the_nose_leans_it_like_the_side_force(pike: Fish, effect: Effect, straight: Trial) -> None:
    """Psi'' + 2 zeta omega psi' + omega^2 psi = omega^2 mu (v' + w u) / g, where next to nothing is lost."""
    mu, omega, zeta = 8.0, ROLL["frequency"], ROLL["damping"]
    rollouts = [Model(pike, (effect,)).predict(straight, _values(square=1e-9, nose=nose)).rollout for nose in (mu, 0.0)]
    assert rollouts[0].memory is not None
    assert rollouts[1].memory is not None
    time = rollouts[0].time[:-1]
    lean = rollouts[0].memory[:, 0, 0] - rollouts[1].memory[:, 0, 0]
    surge, sway, turn = rollouts[0].state[:, 0, :3].T
    forcing = CubicSpline(time, rollouts[0].derivative[:, 0, 1] + turn * surge)
    sign = -1.0  # the model's y is the forward frame's, turned by half a turn

    def swing(t: float, y: np.ndarray) -> list[float]:
        return [y[1], omega**2 * (sign * mu * float(forcing(t)) / 9.81 - y[0]) - 2.0 * zeta * omega * y[1]]

    begun = [0.0, omega**2 * mu * sign * sway[0] / 9.81]
    solved = integrate.solve_ivp(swing, (0.0, time[-1]), begun, t_eval=time, rtol=1e-8, atol=1e-10, max_step=0.005)
    np.testing.assert_allclose(lean, solved.y[0], rtol=0.0, atol=2e-2 * np.abs(lean).max())


@pytest.mark.parametrize("short", ["square", "frequency", "damping", "inertial", "nose"])
def test_its_derivatives(pike: Fish, effect: Effect, turning: Trial, short: str) -> None:
    assert derivative_error(pike, turning, effect, ROLL | {"nose": 1.0}, short) < 1e-6


def test_it_begins_at_the_numbers_of_its_formulas() -> None:
    learned = RollLaw()
    assert learned.like("roll_loss", {k: ROLL[k] for k in ("square", "frequency", "damping", "inertial")}) == ROLL
    assert learned.like("roll", {"height": 0.01, "frequency": 5.0, "damping": 0.1})["square"] == 0.0
    assert learned.like("servo_lag", {"time_constant": 0.1}) == {}
