"""A clock that walks: spread, motion by it, and how the motion goes along a mode."""

from __future__ import annotations

import numpy as np
import pytest

from mjfish.drive import wave
from mjfish.drive.motion import JointMotion
from mjfish.drive.walk import along_mode, count, walk, walked
from mjfish.drive.wave import Wave

LAW = Wave(1.3, (0.3, 0.5), (0.0, -1.0), (0.1, 0.0))


def _motion(step: float = 0.005) -> JointMotion:
    return wave.joint_motion(LAW, 0.0, 6.0, step)


def test_the_spread_of_a_walk_grows_with_time() -> None:
    """<w^2> = size^2 t, less the share of it that is faster than one wave a second."""
    times, rng = np.array([1.0, 2.0, 4.0, 6.0]), np.random.default_rng(0)
    ahead = [walk(times, 0.0, 6.0, 0.02 * rng.standard_normal(count(6.0)))[0] for _ in range(4000)]
    np.testing.assert_allclose(np.mean(np.square(ahead), axis=0), 0.02**2 * times, rtol=0.12)


@pytest.mark.parametrize("level", [False, True])
def test_a_walk_is_the_sum_of_its_modes_less_its_line_where_asked(level: bool) -> None:
    times, sizes = np.linspace(1.0, 6.0, 4001), np.random.default_rng(1).standard_normal(9)
    found = walk(times, 1.0, 6.0, sizes, level=level)
    wave = (np.arange(9) + 0.5) * np.pi / 5.0
    expected = np.sqrt(0.4) * (np.sin((times[:, None] - 1.0) * wave) / wave) @ sizes
    if level:
        expected = expected - np.polyval(np.polyfit(times, expected, 1), times)
    np.testing.assert_allclose(found[0], expected, atol=1e-3)
    np.testing.assert_allclose(found[1][1:-1], np.gradient(found[0], times)[1:-1], atol=1e-4)
    np.testing.assert_allclose(found[2][1:-1], np.gradient(found[1], times)[1:-1], atol=1e-3)


def test_a_walked_motion_is_the_motion_that_is_due() -> None:
    sizes = tuple(0.02 * np.random.default_rng(2).standard_normal(12))
    motion = walked(_motion(), sizes)
    ahead, speed, _ = walk(motion.time, 0.0, 6.0, sizes)
    due = motion.time + ahead
    omega = 2.0 * np.pi * LAW.frequency
    phase = omega * due[:-1, None] + np.array(LAW.phase)
    np.testing.assert_allclose(
        motion.angle[:, 0], np.array(LAW.bias) + np.array(LAW.amplitude) * np.sin(phase), atol=1e-9
    )
    rate = omega * np.array(LAW.amplitude) * np.cos(phase) * (1.0 + speed[:-1, None])
    np.testing.assert_allclose(motion.rate[:, 0], rate, atol=1e-7)
    middle = np.diff(motion.angle[:, [0, 2]], axis=1)[:, 0] / np.diff(motion.time)[:, None]
    np.testing.assert_allclose(motion.rate[:, 1], middle, atol=2e-3)


def test_without_sizes_a_motion_is_as_it_was() -> None:
    motion = _motion()
    assert walked(motion, ()) is motion


def test_steps_of_the_rate_stay_between_steps_of_the_motion() -> None:
    motion = _motion()
    rate = motion.rate.copy()
    rate[600:] += 1.0
    kicked = JointMotion(motion.time, motion.angle, rate, motion.acceleration)
    sizes = tuple(0.02 * np.random.default_rng(3).standard_normal(12))
    assert list(np.flatnonzero(walked(kicked, sizes).jumps)) == [600]


@pytest.mark.parametrize("mode", [0, 4, 11])
@pytest.mark.parametrize("level", [False, True])
def test_a_motion_goes_along_a_mode_as_differences_say(mode: int, level: bool) -> None:
    sizes = 0.02 * np.random.default_rng(4).standard_normal(12)
    here = walked(_motion(), tuple(sizes), level=level)
    times = here.time[100:-100]

    def angle(by: float) -> np.ndarray:
        moved = sizes.copy()
        moved[mode] += by
        return walked(_motion(), tuple(moved), level=level).angle_at(times)

    found = JointMotion(here.time, *along_mode(_motion(), tuple(sizes), mode, level=level))
    expected = (angle(1e-4) - angle(-1e-4)) / 2e-4
    np.testing.assert_allclose(found.angle_at(times), expected, atol=2e-3 * np.abs(expected).max())
    slopes = np.gradient(found.angle[:, 0], found.time[:-1], axis=0)[2:-2]
    np.testing.assert_allclose(found.rate[2:-2, 0], slopes, atol=1e-3 * np.abs(slopes).max())
    bends = np.gradient(found.rate[:, 0], found.time[:-1], axis=0)[2:-2]
    np.testing.assert_allclose(found.acceleration[2:-2, 0], bends, atol=2e-3 * np.abs(bends).max())
