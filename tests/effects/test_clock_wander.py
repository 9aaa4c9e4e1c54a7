"""A drive whose clock wanders, in simulations."""

from __future__ import annotations

import numpy as np
import pytest

import mjfish
from mjfish.drive.motion import JointMotion
from mjfish.drive.wave import Wave, joint_motion
from mjfish.effects import find

WANDER = find("clock_wander")


def _ahead(draw: float, times: np.ndarray) -> np.ndarray:
    """Return w [s] of a walk of 0.01 s^0.5: a joint that turns evenly is ahead by its angle."""
    even = joint_motion(Wave(1e-9, (1.0,), (0.0,), (0.0,)), 0.0, 6.0, 0.01)
    turning = JointMotion(even.time, even.angle * 0.0 + _stages(even.time), even.rate * 0.0 + 1.0, even.acceleration)
    return WANDER.drive(turning, {"size": 0.01, "draw": draw}).angle_at(times)[:, 0] - times


def _stages(time: np.ndarray) -> np.ndarray:
    return np.stack([time[:-1], 0.5 * (time[:-1] + time[1:]), time[1:]], axis=1)[..., None]


def test_the_clock_is_ahead_by_size_times_the_root_of_the_time() -> None:
    times = np.array([1.0, 2.0, 5.0])
    spread = np.sqrt(np.mean([_ahead(float(draw), times) ** 2 for draw in range(400)], axis=0))
    np.testing.assert_allclose(spread, 0.01 * np.sqrt(times), rtol=0.15)


def test_a_walk_is_the_same_whenever_it_is_drawn_again() -> None:
    times = np.linspace(0.0, 5.0, 30)
    np.testing.assert_array_equal(_ahead(3.0, times), _ahead(3.0, times))
    assert np.abs(_ahead(3.0, times) - _ahead(4.0, times)).max() > 1e-3


def test_every_run_has_a_walk_of_its_own_and_the_noise_stays() -> None:
    noise = (0.006, 0.006, 0.04)
    still = mjfish.generate("pike", ["v1", "v1"], noise=noise, duration=4.0, seed=5)
    moved = mjfish.generate("pike", ["v1", "v1"], noise=noise, duration=4.0, seed=5, values={"clock_wander.size": 0.01})
    first, second = (a.velocity - b.velocity for a, b in zip(moved.trials, still.trials, strict=True))
    assert np.abs(first - second).max() > 0.1
    nothing = mjfish.generate(
        "pike", ["v1", "v1"], noise=noise, duration=4.0, seed=5, values={"clock_wander.size": 0.0}
    )
    np.testing.assert_array_equal(nothing.trials[1].velocity, still.trials[1].velocity)


@pytest.mark.parametrize("recorded", [{"joints": "measured"}, {"observe": "pose"}])
def test_data_that_cannot_show_it_say_so(recorded: dict[str, str]) -> None:
    pool = mjfish.generate("pike", ["v1"], duration=2.0, noise=(0.001, 0.001, 0.01), **recorded)  # type: ignore[arg-type]
    assert WANDER.not_applicable(pool)
    assert not WANDER.not_applicable(mjfish.generate("pike", ["v1"], duration=2.0))
