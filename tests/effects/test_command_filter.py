"""What stands between command and joints, against other solvers on a chirp: the filter and the rate limit."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lsim

from mjfish.drive.motion import JointMotion, grid
from mjfish.effects.commanded import CATCH_UP, SHORTEST, filtered, limited
from mjfish.numerics.arrays import FloatArray

END, START = 2.0, 0.3
#: Steps of the other solvers [s]: with inputs straight in between they are off by 1e-6 of the amplitude.
FINE = 1e-4


def _command(t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return angle, rate and acceleration of a chirp from 1 to 5 Hz that begins off zero and in motion."""
    phase, omega, slope = 2.0 * np.pi * (t + t**2), 2.0 * np.pi * (1.0 + 2.0 * t), 4.0 * np.pi
    sine, cosine = 0.5 * np.sin(phase), 0.5 * np.cos(phase)
    return START + sine, omega * cosine, slope * cosine - omega**2 * sine


def _motion(step: float = 0.005) -> JointMotion:
    time = grid(np.array([0.0, END]), step)
    stages = np.stack([time[:-1], 0.5 * (time[:-1] + time[1:]), time[1:]], axis=1)[..., None]
    return JointMotion(time, *_command(stages))


def _solved(time: float, damping: float, delay: float) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return times, angle, rate and acceleration of T^2 theta'' + 2 zeta T theta' + theta = c(t - delay) by scipy."""
    t = np.linspace(0.0, END, round(END / FINE) + 1)
    asked = np.where(t > delay, _command(np.maximum(t - delay, 0.0))[0], START)
    square = 1.0 / time**2
    matrix = np.array([[0.0, 1.0], [-square, -2.0 * damping / time]])
    system = matrix, np.array([[0.0], [square]]), np.eye(2), np.zeros((2, 1))
    _, state, _ = lsim(system, asked, t, X0=[START, 0.0])
    return t, state[:, 0], state[:, 1], square * (asked - state[:, 0]) - 2.0 * damping / time * state[:, 1]


@pytest.mark.parametrize("delay", [0.0, 0.0123, 0.2])
@pytest.mark.parametrize(("time", "damping"), [(0.02, 0.3), (0.02, 1.0), (0.015, 2.5), (0.15, 0.7)])
def test_the_filter_is_scipys(time: float, damping: float, delay: float) -> None:
    """At the ends of all steps, for little, critical and much damping, with dead times that are no multiple of one.

    What is left is the cubic between samples of the command, and at a dead time the corner of the command within a
    step of the other solver.
    """
    got, (t, *expected) = filtered(_motion(), time, damping, delay), _solved(time, damping, delay)
    at = np.searchsorted(t, got.time[1:] - 1e-9)
    scale = np.array([1.0, 1.0 / time, 1.0 / time**2])
    for found, other, size in zip((got.angle, got.rate, got.acceleration), expected, scale, strict=True):
        np.testing.assert_allclose(found[:, 2, 0], other[at], rtol=0.0, atol=5e-6 * size)
        np.testing.assert_allclose(found[1:, 0, 0], other[at[:-1]], rtol=0.0, atol=5e-6 * size)


def test_it_starts_at_rest_where_the_command_starts_and_stays_for_the_dead_time() -> None:
    got = filtered(_motion(), 0.02, 0.7, 0.1)
    early = got.time[1:] < 0.1
    assert np.all(got.angle[:-1][early[1:]] == START)
    assert not got.rate[: np.count_nonzero(early)].any()
    assert np.abs(got.rate).max() > 1.0


@pytest.mark.parametrize("damping", [1.0 - 1e-6, 1.0, 1.0 + 1e-6])
def test_it_goes_smoothly_through_critical_damping(damping: float) -> None:
    """Catches a division by the root that vanishes there."""
    middle, near = filtered(_motion(), 0.02, 1.0), filtered(_motion(), 0.02, damping)
    np.testing.assert_allclose(near.angle, middle.angle, rtol=0.0, atol=1e-6)
    np.testing.assert_allclose(near.acceleration, middle.acceleration, rtol=0.0, atol=1e-2)


def test_a_step_of_the_integrator_does_not_matter() -> None:
    """The filter is solved exactly: half the step gives the same but for the cubic between samples of the command.

    A cubic through ends and slopes of a chirp of w = 31 / s is off by h^4 w^4 / 384 of its amplitude, 5e-8 at h =
    2.5 ms.
    """
    coarse, fine = (filtered(_motion(step), 0.02, 0.4, 0.013) for step in (0.005, 0.0025))
    np.testing.assert_allclose(coarse.angle[:, 2], fine.angle[1::2, 2], rtol=0.0, atol=1e-7)


def test_a_shorter_filter_than_the_shortest_is_that_one() -> None:
    shortest, shorter = (filtered(_motion(), time, 1.0) for time in (SHORTEST, 0.1 * SHORTEST))
    assert shortest.angle.tobytes() == shorter.angle.tobytes()


@pytest.mark.parametrize(
    ("slowness", "catch_up", "forward"),
    [(0.07, CATCH_UP, 1.0), (0.12, CATCH_UP, 1.0), (0.12, 400.0, 1.0), (0.12, 300.0, 0.0)],
)
def test_the_limit_is_that_of_an_explicit_integration(slowness: float, catch_up: float, forward: float) -> None:
    """By Heun's steps of 0.02 ms of theta' = L S((f c' + k (c - theta)) / L), of a chirp that goes beyond the limit.

    Less exact where the rate turns round within one step of the integrator.
    """
    got, h = limited(_motion(0.0025), slowness, catch_up, forward), 2e-5
    t = np.arange(round(END / h) + 1) * h
    angle, rate, _ = _command(t)

    def follow(theta: float, k: int) -> float:
        x = slowness * (forward * rate[k] + catch_up * (angle[k] - theta))
        return float(x / (1.0 + abs(x) ** 256) ** (1.0 / 256.0) / slowness) if abs(x) < 10.0 else np.sign(x) / slowness

    theta = np.empty(len(t))
    theta[0] = START
    for k in range(len(t) - 1):
        first = follow(theta[k], k)
        theta[k + 1] = theta[k] + 0.5 * h * (first + follow(theta[k] + h * first, k + 1))
    at = np.searchsorted(t, got.time[1:] - 1e-9)
    assert np.abs(angle - theta).max() > 0.01
    np.testing.assert_allclose(got.angle[:, 2, 0], theta[at], rtol=0.0, atol=3e-4)
