"""Turned axes: the same run, read along other axes."""

from __future__ import annotations

import numpy as np
import pytest
from recovery import derivative_error, found_again

from mjfish.data import Trial
from mjfish.effects import find
from mjfish.fish import Fish
from mjfish.model import Model

MISALIGNMENT = find("frame_misalignment")


def test_forward_speed_of_a_fish_whose_recorded_axis_points_to_port_looks_like_drift_to_starboard(
    pike: Fish, turning: Trial
) -> None:
    """Speed and yaw rate stay. Catches a rotation the wrong way round, and one of the yaw rate."""
    model, angle = Model(pike, (MISALIGNMENT,)), 0.1
    right, wrong = (
        model.predict(turning, model.values({"frame_misalignment.angle": a})).velocity for a in (0.0, angle)
    )
    u, v = right[:, 0], right[:, 1]
    expected = np.column_stack([np.cos(angle) * u + np.sin(angle) * v, np.cos(angle) * v - np.sin(angle) * u])
    np.testing.assert_allclose(wrong[:, :2], expected, rtol=0.0, atol=1e-14)
    assert np.array_equal(wrong[:, 2], right[:, 2])
    settled = turning.time < 1.5
    assert np.mean(right[settled, 0]) > 0.1
    assert np.mean(wrong[settled, 1]) < np.mean(right[settled, 1]) - 0.01


@pytest.mark.parametrize("angle", [0.0, -0.07])
def test_its_sensitivity_is_that_of_predictions(pike: Fish, turning: Trial, angle: float) -> None:
    assert derivative_error(pike, turning, MISALIGNMENT, {"angle": angle}, "angle") < 1e-7


def test_a_hidden_misalignment_is_found_again(pike: Fish) -> None:
    sizes = {"angle": -0.03}
    found = found_again(pike, MISALIGNMENT, sizes)
    assert found.sigma["frame_misalignment.angle"] < 0.003
