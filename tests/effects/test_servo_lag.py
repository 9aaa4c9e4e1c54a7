"""First-order lag of the servos, against its differential equation and against closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import make_interp_spline

from mjfish.data import Dataset, Trial
from mjfish.drive import cpg
from mjfish.drive.cpg import DriveSegment
from mjfish.drive.motion import JointMotion, grid
from mjfish.effects import find
from mjfish.effects.servo_lag import SHORTEST
from mjfish.fish import Fish
from mjfish.model import Model
from mjfish.numerics.arrays import FloatArray, readonly

LAG = find("servo_lag")


def _lagged(motion: JointMotion, tau: float) -> JointMotion:
    return LAG.drive(motion, {"time_constant": tau})


def _command(fish: Fish, trial: Trial) -> JointMotion:
    return cpg.joint_motion(fish.cpg, trial.drive, 3.0, 0.001)


def _sinusoid(omega: float, duration: float = 2.0, step: float = 0.005) -> JointMotion:
    time = grid(np.array([0.0, duration]), step)
    stages = np.stack([time[:-1], 0.5 * (time[:-1] + time[1:]), time[1:]], axis=1)[..., None]
    return JointMotion(
        time, np.sin(omega * stages), omega * np.cos(omega * stages), -(omega**2) * np.sin(omega * stages)
    )


def _starts(values: FloatArray) -> FloatArray:
    """Return values at the boundaries of the steps, after a jump."""
    return np.concatenate([values[:, 0], values[-1:, 2]])


@pytest.mark.parametrize("tau", [0.002, 0.05])
def test_it_solves_its_differential_equation_across_a_step_of_the_drive(pike: Fish, tau: float) -> None:
    """Integrates tau theta' = command - theta anew, by scipy and from the command's angles alone."""
    drive = (DriveSegment(0.0, 22.0, (0.0,) * 4), DriveSegment(0.4, 18.0, (0.0, 1.0, 1.5, 2.0)))
    command = cpg.joint_motion(pike.cpg, drive, 0.8, 0.001)
    lagged = _lagged(command, tau)
    state = lagged.angle[0, 0]
    for inside in (command.time <= 0.4, command.time >= 0.4):
        time = command.time[inside]
        asked = make_interp_spline(time, command.angle_at(time), k=5)
        solved = solve_ivp(
            lambda t, theta, asked=asked: (asked(t) - theta) / tau,
            (time[0], time[-1]),
            state,
            method="LSODA",
            t_eval=time,
            rtol=1e-9,
            atol=1e-10,
        )
        np.testing.assert_allclose(_starts(lagged.angle)[inside], solved.y.T, rtol=0.0, atol=2e-7)
        state = solved.y[:, -1]


def test_angle_rate_and_acceleration_belong_to_each_other(pike: Fish, turning: Trial) -> None:
    """At every stage tau theta' = command - theta, and the same once differentiated; the rate is the angle's slope."""
    command, tau = _command(pike, turning), 0.03
    lagged = _lagged(command, tau)
    np.testing.assert_allclose(tau * lagged.rate, command.angle - lagged.angle, rtol=0.0, atol=1e-13)
    np.testing.assert_allclose(tau * lagged.acceleration, command.rate - lagged.rate, rtol=0.0, atol=1e-12)
    simpson = (lagged.rate[:, 0] + 4.0 * lagged.rate[:, 1] + lagged.rate[:, 2]) * np.diff(command.time)[:, None] / 6.0
    np.testing.assert_allclose(lagged.angle[:, 2] - lagged.angle[:, 0], simpson, rtol=0.0, atol=1e-8)


@pytest.mark.parametrize("tau", [0.005, 0.05, 0.3])
def test_a_sinusoid_comes_out_smaller_and_later_as_the_transfer_function_says(tau: float) -> None:
    """Gain 1 / sqrt(1 + (w tau)^2), phase -atan(w tau), once exp(-t / tau) has died away."""
    omega = 18.0
    motion = _sinusoid(omega, duration=10.0 * max(tau, 0.1))
    expected = np.sin(omega * motion.time - np.arctan(omega * tau)) / np.hypot(1.0, omega * tau)
    start = _lagged(motion, tau).angle[0, 0, 0] - expected[0]
    rest = start * np.exp(-motion.time / tau)
    found = _starts(_lagged(motion, tau).angle)[:, 0]
    np.testing.assert_allclose(found, expected + rest, rtol=0.0, atol=1e-7)
    assert np.max(np.abs(found - np.sin(omega * motion.time))) > 0.05


def test_a_short_lag_is_a_delay_by_its_time_constant_to_second_order() -> None:
    """theta(t) = command(t - tau) + O(tau^2). Catches a time constant off by a factor."""
    motion = _sinusoid(18.0)
    errors = []
    for tau in 0.016 / 2.0 ** np.arange(5):
        delayed = np.sin(18.0 * (motion.time - tau))
        settled = motion.time > 1.0
        errors.append(np.sqrt(np.mean((_starts(_lagged(motion, tau).angle)[:, 0] - delayed)[settled] ** 2)))
    assert np.log2(np.array(errors[:-1]) / np.array(errors[1:])) == pytest.approx(2.0, abs=0.15)


def test_the_rate_of_the_joints_no_longer_jumps_where_the_commands_does(pike: Fish, turning: Trial) -> None:
    command = _command(pike, turning)
    jumps = [np.abs(motion.rate[1:, 0] - motion.rate[:-1, 2]).max() for motion in (command, _lagged(command, 0.02))]
    assert jumps[0] > 1.0
    assert jumps[1] < 1e-12


def test_the_joints_start_at_rest_where_the_command_starts(pike: Fish, straight: Trial) -> None:
    command = _command(pike, straight)
    lagged = _lagged(command, 0.04)
    np.testing.assert_array_equal(lagged.angle[0, 0], command.angle[0, 0])
    np.testing.assert_array_equal(lagged.rate[0, 0], 0.0)
    assert np.all(np.abs(command.rate[0, 0]) > 0.1)


def test_the_shortest_lag_is_resolved_and_a_shorter_one_is_none(pike: Fish, turning: Trial) -> None:
    command = _command(pike, turning)
    assert _lagged(command, 0.99 * SHORTEST) is command
    shortest = _lagged(command, SHORTEST)
    np.testing.assert_allclose(shortest.angle, command.angle, rtol=0.0, atol=2e-3)
    settled = command.time[:-1] > 20.0 * SHORTEST
    settled &= np.abs(command.time[:-1] - 1.5) > 20.0 * SHORTEST
    np.testing.assert_allclose(shortest.rate[settled], command.rate[settled], rtol=0.0, atol=0.05)
    model = Model(pike, (LAG,))
    assert model.predict(turning, model.values({"servo_lag.time_constant": SHORTEST})).status == "ok"


def test_measured_joint_angles_are_what_the_joints_got(pike: Fish) -> None:
    time = np.linspace(0.0, 1.0, 51)
    angle = 0.3 * np.sin(18.0 * time[:, None] - np.arange(4))
    measured = Trial("m", None, readonly(time), readonly(np.zeros((51, 3))), joint_angle=readonly(angle))
    model = Model(pike, (LAG,))
    got = [model.predict(measured, model.values({"servo_lag.time_constant": tau})).velocity for tau in (0.0, 0.1)]
    assert got[0].tobytes() == got[1].tobytes()
    assert "joint angles were measured" in LAG.not_applicable(Dataset("m", pike, (measured,)))


def test_one_driven_trial_makes_it_a_candidate(pike: Fish, straight: Trial) -> None:
    time = np.linspace(0.0, 1.0, 51)
    measured = Trial("m", None, readonly(time), readonly(np.zeros((51, 3))), joint_angle=readonly(np.zeros((51, 4))))
    assert LAG.not_applicable(Dataset("both", pike, (measured, straight))) == ""
