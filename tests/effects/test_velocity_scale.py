"""Scale of the camera: the same run, measured with a wrong ruler."""

from __future__ import annotations

import numpy as np
import pytest
from recovery import derivative_error, found_again

from mjfish.data import Trial
from mjfish.effects import find
from mjfish.fish import Fish
from mjfish.model import Model

SCALE = find("velocity_scale")


def test_translations_are_read_too_large_and_the_yaw_rate_is_right(pike: Fish, turning: Trial) -> None:
    """Catches a scale that is applied to all channels, or divided by."""
    model = Model(pike, (SCALE,))
    right, wrong = (
        model.predict(turning, model.values({"velocity_scale.error": error})).velocity for error in (0.0, 0.05)
    )
    np.testing.assert_allclose(wrong[:, :2], 1.05 * right[:, :2], rtol=1e-14)
    assert np.array_equal(wrong[:, 2], right[:, 2])


@pytest.mark.parametrize("error", [0.0, 0.04])
def test_its_sensitivity_is_that_of_predictions(pike: Fish, turning: Trial, error: float) -> None:
    assert derivative_error(pike, turning, SCALE, {"error": error}, "error") < 1e-7


def test_a_hidden_scale_is_found_again(pike: Fish) -> None:
    sizes = {"error": 0.03}
    found = found_again(pike, SCALE, sizes)
    assert found.sigma["velocity_scale.error"] < 0.03
