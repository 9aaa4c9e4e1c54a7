"""Velocities of the links along a rollout."""

from __future__ import annotations

import numpy as np
import pytest
from joint_motions import waving

from mjfish import ode
from mjfish.fish import Fish, frames
from mjfish.ode.forces import link_velocities

START = np.array([0.4, 0.1, -0.5])


@pytest.mark.parametrize("compliance", [0.0, 0.4])
def test_they_are_the_slopes_of_the_places_of_the_joints(pike: Fish, compliance: float) -> None:
    """Places in the world by adding up links, differentiated over 0.1 ms: off by h^2 / 6 of the third derivative."""
    fish = pike.model_copy(update={"tail_compliance": compliance, "tail_damping": 0.03})
    rollout = ode.simulate(fish, waving(0.4, 4000), velocity=START)
    state, h = rollout.state[:, 0], 1e-4
    angle = rollout.motion.angle[:, 0].copy()
    angle[:, -1] += state[:, 6]
    pose = frames.flip(state[:, 3:6])
    heading = pose[:, 2:] + np.cumsum(np.column_stack([np.zeros(len(state)), angle]), axis=1)
    lengths = np.array([link.length for link in fish.links])
    x, y = (
        pose[:, k : k + 1] + np.cumsum(np.column_stack([np.zeros(len(state)), lengths[:-1] * turn[:, :-1]]), axis=1)
        for k, turn in ((0, np.cos(heading)), (1, np.sin(heading)))
    )
    slope = [(part[2:] - part[:-2]) / (2.0 * h) for part in (x, y, heading)]
    c, s = np.cos(heading[1:-1]), np.sin(heading[1:-1])
    expected = c * slope[0] + s * slope[1], c * slope[1] - s * slope[0], slope[2]
    for found, other, size in zip(link_velocities(fish, rollout), expected, (1.0, 1.0, 10.0), strict=True):
        assert found.shape == (len(state), 5)
        np.testing.assert_allclose(found[1:-1], other, rtol=0.0, atol=1e-4 * size)
        assert np.abs(found).max() > 0.2
