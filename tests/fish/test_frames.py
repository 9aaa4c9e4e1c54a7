"""The half turn between the model's frame and the one that users see, and the world."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mjfish import ode
from mjfish.drive import cpg, modes
from mjfish.fish import Fish
from mjfish.fish.frames import CHANNELS, UNITS, flip, to_body, to_world

numbers = st.floats(-10.0, 10.0)


def test_forward_is_minus_x_of_the_model_port_is_minus_y_and_yaw_is_yaw() -> None:
    """x_0 runs to the tail, both z axes point up."""
    assert flip(np.array([-0.5, 0.0, 0.0])).tolist() == [0.5, 0.0, 0.0]
    assert flip(np.array([0.0, -0.2, 0.0])).tolist() == [0.0, 0.2, 0.0]
    assert flip(np.array([0.0, 0.0, 1.5])).tolist() == [0.0, 0.0, 1.5]


def test_the_flip_is_half_a_turn_about_z() -> None:
    """A rotation, not a mirror: the sense of y against x is kept, or port and starboard would be swapped."""
    x, y = flip(np.array([1.0, 0.0, 0.0])), flip(np.array([0.0, 1.0, 0.0]))
    assert x[0] * y[1] - x[1] * y[0] == 1.0
    assert np.allclose(x[:2], to_world(np.array([1.0, 0.0]), np.array(np.pi)))


@given(st.lists(st.tuples(numbers, numbers, numbers), min_size=1, max_size=5))
def test_the_flip_is_its_own_inverse_on_any_shape(rows: list[tuple[float, float, float]]) -> None:
    planar = np.array(rows)
    assert np.array_equal(flip(flip(planar)), planar)
    assert np.array_equal(flip(planar[:, None, :])[:, 0], flip(planar))


@given(numbers, numbers, numbers)
def test_world_and_body_undo_each_other_and_keep_length(x: float, y: float, yaw: float) -> None:
    world = np.array([x, y])
    body = to_body(world, np.array(yaw))
    np.testing.assert_allclose(to_world(body, np.array(yaw)), world, atol=1e-12)
    assert np.hypot(*body) == pytest.approx(np.hypot(x, y), abs=1e-12)


def test_a_fish_that_heads_port_sees_the_worlds_x_on_its_starboard() -> None:
    """Yaw is positive to port; turned by 90 degrees, body x is world y."""
    np.testing.assert_allclose(to_body(np.array([1.0, 0.0]), np.array(np.pi / 2)), [0.0, -1.0], atol=1e-15)
    np.testing.assert_allclose(to_world(np.array([1.0, 0.0]), np.array(np.pi / 2)), [0.0, 1.0], atol=1e-15)


def test_rows_are_turned_each_by_its_own_yaw() -> None:
    yaw = np.array([0.0, np.pi / 2, np.pi])
    turned = to_world(np.tile([1.0, 0.0], (3, 1)), yaw)
    np.testing.assert_allclose(turned, [[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0]], atol=1e-15)


def test_the_channels_have_units() -> None:
    assert CHANNELS == ("surge", "sway", "yaw_rate")
    assert UNITS == {"surge": "m/s", "sway": "m/s", "yaw_rate": "rad/s"}


def test_a_driven_fish_swims_forward_and_its_path_is_that_of_its_velocity(pike: Fish) -> None:
    """End to end: surge is positive, x grows, and the world's path is the body's velocity turned by the yaw."""
    motion = cpg.joint_motion(pike.cpg, modes.drive("v1-t2"), 8.0, 0.002)
    rollout = ode.simulate(pike, motion)
    settled = rollout.state[1000:, 0]
    assert np.mean(settled[:, 0]) > 0.3
    assert settled[1500, 3] > settled[0, 3] + 0.5
    speed = to_world(rollout.state[:, 0, :2], rollout.state[:, 0, 5])
    np.testing.assert_allclose(rollout.derivative[:, 0, 3:5], speed, atol=1e-12)
    assert np.array_equal(rollout.derivative[:, :, 5], rollout.state[:, :, 2])


def test_a_turn_of_the_tail_to_one_side_turns_the_fish_to_it(pike: Fish) -> None:
    """Positive joint angles bend the tail to starboard of the stretched fish, seen from above, and it turns so.

    Positive about z, up, from the model's x, which points to the tail: the tail swings towards the model's +y, which
    is starboard. A fish bent so swims a circle to starboard: its yaw falls.
    """
    turn = tuple(cpg.DriveSegment(0.0, 18.0, bias) for bias in ((0.0, 1.0, 1.5, 2.0),))
    yaw = ode.simulate(pike, cpg.joint_motion(pike.cpg, turn, 8.0, 0.005)).state[-1, 1, 5]
    other = tuple(cpg.DriveSegment(0.0, 18.0, bias) for bias in ((0.0, -1.0, -1.5, -2.0),))
    mirrored = ode.simulate(pike, cpg.joint_motion(pike.cpg, other, 8.0, 0.005)).state[-1, 1, 5]
    assert yaw < -1.0 < 1.0 < mirrored
