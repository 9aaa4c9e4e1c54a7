"""A tracked point off the nose, against the same point's way through the world."""

from __future__ import annotations

import numpy as np
import pytest
from recovery import derivative_error, found_again

from mjfish.data import Trial
from mjfish.effects import find
from mjfish.fish import Fish, frames
from mjfish.model import Model

MARKER = find("marker_offset")
R_M = np.array([-0.12, 0.03])


def test_the_recorded_velocity_is_that_of_the_point_behind_the_nose_and_to_port(pike: Fish, turning: Trial) -> None:
    """Differentiates the point's path in the world. Catches either sign of omega x r, and swapped components."""
    model = Model(pike, (MARKER,))
    read = model.predict(turning, model.values({"marker_offset.along": R_M[0], "marker_offset.across": R_M[1]}))
    at, h = np.linspace(0.5, 2.9, 97), 1e-4
    at = at[np.abs(at - 1.5) > 0.01]

    def point(time: np.ndarray) -> np.ndarray:
        state = read.rollout.at(time)
        return np.asarray(state[:, 3:5] + frames.to_world(np.broadcast_to(R_M, (len(time), 2)), state[:, 5]))

    slope = (8.0 * (point(at + h) - point(at - h)) - (point(at + 2 * h) - point(at - 2 * h))) / (12.0 * h)
    state = read.rollout.at(at)
    values = {"along": R_M[0], "across": R_M[1]}
    found = MARKER.reading(state, values, turning)
    np.testing.assert_allclose(found[:, :2], frames.to_body(slope, state[:, 5]), rtol=0.0, atol=2e-3)
    assert np.array_equal(found[:, 2:], state[:, 2:])
    assert np.max(np.abs(found - state)) > 0.3


@pytest.mark.parametrize("short", ["along", "across"])
@pytest.mark.parametrize("values", [{"along": 0.0, "across": 0.0}, {"along": -0.1, "across": 0.02}])
def test_its_sensitivities_are_those_of_predictions(
    pike: Fish, turning: Trial, short: str, values: dict[str, float]
) -> None:
    assert derivative_error(pike, turning, MARKER, values, short) < 1e-7


def test_a_hidden_offset_is_found_again(pike: Fish) -> None:
    sizes = {"along": -0.02, "across": 0.01}
    found = found_again(pike, MARKER, sizes, least=2.0)
    assert found.sigma["marker_offset.across"] < 0.003
