"""The grid of steps, and joint motions read from it."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mjfish.drive.motion import JointMotion, grid

gaps = st.lists(st.floats(1e-3, 3.0), min_size=1, max_size=4)


@settings(deadline=None, derandomize=True, max_examples=60, database=None)
@given(gaps, st.floats(2e-3, 0.5), st.booleans())
def test_grid_hits_every_break_and_no_step_is_longer_than_asked(gap: list[float], step: float, graded: bool) -> None:
    breaks = np.concatenate([[0.0], np.cumsum(gap)])
    time = grid(breaks, step, graded=graded)
    for instant in breaks:
        assert np.min(np.abs(time - instant)) < 1e-12
    assert (time[0], time[-1]) == pytest.approx((breaks[0], breaks[-1]))
    assert np.all(np.diff(time) > 0.0)
    assert np.max(np.diff(time)) <= step * (1.0 + 1e-6)


@settings(deadline=None, derandomize=True, max_examples=60, database=None)
@given(gaps, st.floats(2e-3, 0.5))
def test_an_even_grid_wastes_no_step_and_is_even_within_a_stretch(gap: list[float], step: float) -> None:
    breaks = np.concatenate([[0.0], np.cumsum(gap)])
    time = grid(breaks, step)
    assert len(time) - 1 <= np.sum(np.ceil(np.array(gap) / step + 1e-6))
    for a, b in itertools.pairwise(breaks):
        steps = np.diff(time[(time >= a - 1e-12) & (time <= b + 1e-12)])
        assert np.ptp(steps) < 1e-9


def test_a_stretch_that_is_a_whole_number_of_steps_gets_exactly_these() -> None:
    """10.4 s at 5 ms are 2080 steps, whatever rounding says about 10.4 / 0.005."""
    assert len(grid(np.array([0.0, 5.2, 10.4]), 0.005)) == 2081
    assert len(grid(np.array([0.0, 0.3]), 0.1)) == 4


def test_a_graded_grid_starts_finely_behind_every_break_and_is_even_after() -> None:
    time = grid(np.array([0.0, 1.0, 2.0]), 0.005, graded=True)
    for start in (0.0, 1.0):
        first = np.diff(time[time >= start - 1e-12])[0]
        assert 5e-5 < first < 4e-4
    assert np.diff(time)[-100:] == pytest.approx(0.005)


def _motion() -> JointMotion:
    """Return theta = (t^3, 1 - t): a cubic, which Hermite interpolation gives exactly."""
    time = np.array([0.0, 0.4, 1.0])
    at = np.stack([time[:-1], 0.5 * (time[:-1] + time[1:]), time[1:]], axis=1)
    angle = np.stack([at**3, 1.0 - at], axis=-1)
    rate = np.stack([3.0 * at**2, -np.ones_like(at)], axis=-1)
    return JointMotion(time, angle, rate, np.stack([6.0 * at, np.zeros_like(at)], axis=-1))


def test_angles_are_read_between_the_samples_to_third_degree() -> None:
    time = np.linspace(0.0, 1.0, 37)
    np.testing.assert_allclose(_motion().angle_at(time), np.stack([time**3, 1.0 - time], axis=1), atol=1e-14)


def test_before_and_after_the_motion_the_end_angle_is_held() -> None:
    np.testing.assert_allclose(_motion().angle_at(np.array([-1.0, 5.0])), [[0.0, 1.0], [1.0, 0.0]], atol=1e-14)


def test_cosines_and_sines_are_those_of_the_angles_and_computed_once() -> None:
    motion = _motion()
    cos, sin = motion.trigonometry
    assert motion.trigonometry[0] is cos
    np.testing.assert_allclose(np.arctan2(sin, cos), motion.angle, atol=1e-15)


def test_an_angle_that_jumps_between_steps_has_the_cosine_of_each_side() -> None:
    angle = np.random.default_rng(0).uniform(-1.0, 1.0, (5, 3, 2))
    motion = JointMotion(np.arange(6.0), angle, angle, angle)
    np.testing.assert_allclose(motion.trigonometry, (np.cos(angle), np.sin(angle)), atol=1e-15)


def test_a_motion_cannot_be_written_to() -> None:
    motion = _motion()
    assert motion.joints == 2
    with pytest.raises(ValueError, match="read-only"):
        motion.angle[0, 0, 0] = 1.0
