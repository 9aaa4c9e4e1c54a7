"""Growth of small deviations along a rollout against differences of the equation of motion."""

from __future__ import annotations

import numpy as np
import pytest
from joint_motions import waving

from mjfish import ode
from mjfish.fish import COEFFICIENTS, Fish
from mjfish.ode.linearised import growth

VALUES = dict(zip(COEFFICIENTS, (1.0, 0.5, 0.6, 2.0, 1.5, 2.5, 0.02, 0.01, 0.02), strict=True))


@pytest.mark.parametrize("compliance", [0.0, 0.4])
def test_growth_is_the_slope_of_the_acceleration(pike: Fish, compliance: float) -> None:
    """A slope in the wrong frame, transposed, or at the wrong end of the step."""
    fish = pike.model_copy(update={"munk_moment": 0.7, "tail_compliance": compliance})
    motion, start = waving(0.2, 50), np.array([0.3, 0.02, -0.4])
    found = growth(fish, ode.simulate(fish, motion, values=VALUES, velocity=start), values=VALUES)
    h = 1e-5
    for column in range(3):
        step = h * np.eye(3)[column]
        right, left = (
            ode.simulate(fish, motion, values=VALUES, velocity=start + side).derivative[0, 0, :3]
            for side in (step, -step)
        )
        np.testing.assert_allclose(found[0, :, column], (right - left) / (2.0 * h), rtol=1e-6, atol=1e-6)
