"""Limited rate of the servos, against the limiter with a sharp corner and against its differential equation."""

from __future__ import annotations

import numpy as np
import pytest
from recovery import derivative_error, found_again, strength
from scipy.integrate import solve_ivp

from mjfish.data import Trial
from mjfish.drive import cpg
from mjfish.drive.motion import JointMotion, grid
from mjfish.effects import find
from mjfish.effects.commanded import CATCH_UP
from mjfish.fish import Fish

LIMIT = find("servo_rate_limit")


def _sinusoid(omega: float, duration: float, step: float = 0.005) -> JointMotion:
    time = grid(np.array([0.0, duration]), step)
    stages = np.stack([time[:-1], 0.5 * (time[:-1] + time[1:]), time[1:]], axis=1)[..., None]
    return JointMotion(
        time, np.sin(omega * stages), omega * np.cos(omega * stages), -(omega**2) * np.sin(omega * stages)
    )


@pytest.mark.parametrize("slowness", [0.06, 0.1, 0.3])
def test_no_joint_turns_faster_than_the_limit(pike: Fish, turning: Trial, slowness: float) -> None:
    """At the ends of steps exactly; in mid-step the rate carries the mean of a step.

    A straight rise by d that meets the limit within a step has its middle at most d / 4 above it.
    """
    command = cpg.joint_motion(pike.cpg, turning.drive, 3.0, 0.005)
    limited = LIMIT.drive(command, {"slowness": slowness})
    assert np.max(np.abs(command.rate)) > 1.0 / slowness / 1.3
    assert np.max(np.abs(limited.rate[:, ::2])) < (1.0 + 1e-12) / slowness
    rise = np.max(np.abs(np.diff(limited.rate[:, ::2], axis=1)))
    assert np.max(np.abs(limited.rate)) < 1.0 / slowness + 0.25 * rise


def test_joints_slower_than_half_the_limit_do_not_feel_it(pike: Fish, turning: Trial) -> None:
    command = cpg.joint_motion(pike.cpg, turning.drive, 3.0, 0.005)
    slowness = 0.5 / np.max(np.abs(command.rate))
    limited = LIMIT.drive(command, {"slowness": slowness})
    np.testing.assert_allclose(limited.angle, command.angle, rtol=0.0, atol=2e-4)


def test_it_solves_its_differential_equation() -> None:
    """Integrates theta' = L S((c' + k (c - theta)) / L) anew, by scipy, for a command at twice the limit."""
    omega, slowness = 8.0, 0.25
    motion = LIMIT.drive(_sinusoid(omega, 2.0, step=0.0025), {"slowness": slowness})

    def rate(t: float, theta: np.ndarray) -> np.ndarray:
        x = slowness * (omega * np.cos(omega * t) + CATCH_UP * (np.sin(omega * t) - theta))
        size = abs(x)
        return np.asarray(
            np.sign(x) * min(size, 1.0) / (1.0 + min(size, 1.0 / size) ** 256) ** (1.0 / 256.0) / slowness
        )

    ends = motion.time
    solved = solve_ivp(rate, (0.0, 2.0), [0.0], t_eval=ends, rtol=1e-9, atol=1e-11, max_step=0.01).y[0]
    np.testing.assert_allclose(motion.angle[:, 2, 0], solved[1:], rtol=0.0, atol=2e-5)
    np.testing.assert_allclose(
        motion.rate[:, 2, 0], [rate(t, y) for t, y in zip(ends[1:], solved[1:], strict=True)], rtol=0.0, atol=3e-3
    )


@pytest.mark.parametrize("share", [0.7, 0.4])
def test_it_is_nearly_the_limiter_with_a_sharp_corner(share: float) -> None:
    """The sharp one moves to the command at the limit at most; limits are a share of the largest rate asked for.

    Far above the limit both swing as triangles of height L T / 4.
    """
    omega = 10.0
    command = _sinusoid(omega, 4.0, step=0.002)
    limit = share * omega
    sharp = np.zeros(len(command.time))
    for i in range(1, len(sharp)):
        reach = limit * (command.time[i] - command.time[i - 1])
        sharp[i] = sharp[i - 1] + np.clip(np.sin(omega * command.time[i]) - sharp[i - 1], -reach, reach)
    found = LIMIT.drive(command, {"slowness": 1.0 / limit}).angle[:, 2, 0]
    settled = command.time[1:] > 2.0
    assert np.sqrt(np.mean((found - sharp[1:])[settled] ** 2)) < 0.1 * np.sqrt(np.mean(sharp[1:][settled] ** 2))
    assert np.sqrt(np.mean((found - command.angle[:, 2, 0])[settled] ** 2)) > 0.1
    if share == 0.4:
        assert np.max(found[settled]) == pytest.approx(limit * (2.0 * np.pi / omega) / 4.0, rel=0.06)


@pytest.mark.parametrize("slowness", [0.08, 0.1])
def test_its_sensitivity_is_that_of_predictions(pike: Fish, turning: Trial, slowness: float) -> None:
    assert derivative_error(pike, turning, LIMIT, {"slowness": slowness}, "slowness") < 1e-5


def test_it_is_refitted_because_at_the_null_nothing_is_felt(pike: Fish) -> None:
    assert not LIMIT.smooth
    assert strength(pike, LIMIT, {"slowness": 0.01}) < 1e-2


def test_a_hidden_limit_is_found_again(pike: Fish) -> None:
    sizes = {"slowness": 0.08}
    found = found_again(pike, LIMIT, sizes)
    assert found.sigma["servo_rate_limit.slowness"] < 0.003
