"""Jacobians along a rollout against differences of the equation of motion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from joint_motions import stages, waving
from pike_coefficients import COEFFICIENTS

from mjfish import ode
from mjfish.fish import Fish
from mjfish.ode.jacobians import jacobians, linear_response

VALUES = dict(zip(COEFFICIENTS, (1.0, 0.5, 0.6, 2.0, 1.5, 2.5, 0.02, 0.01, 0.02), strict=True))


@pytest.mark.parametrize("compliance", [0.0, 0.4])
def test_state_jacobian_is_the_derivative_of_the_acceleration(pike: Fish, compliance: float) -> None:
    """A derivative in the wrong frame, transposed, or at the wrong end of the step."""
    fish = pike.model_copy(update={"munk_moment": 0.7, "tail_compliance": compliance})
    motion, start = waving(0.2, 50), np.array([0.3, 0.02, -0.4])
    found, _ = jacobians(fish, ode.simulate(fish, motion, values=VALUES, velocity=start), values=VALUES)
    h = 1e-5
    for column in range(3):
        step = h * np.eye(3)[column]
        right, left = (
            ode.simulate(fish, motion, values=VALUES, velocity=start + side).derivative[0, 0, :3]
            for side in (step, -step)
        )
        np.testing.assert_allclose(found[0, :, column], (right - left) / (2.0 * h), rtol=1e-6, atol=1e-6)


def test_wrong_joint_motion_moves_the_fish_as_the_linear_response_says(pike: Fish) -> None:
    """Rates or accelerations forgotten, joints exchanged, or a response that does not die."""
    motion, start = waving(2.0, 800), np.array([0.3, 0.02, -0.4])
    rollout = ode.simulate(pike, motion, values=VALUES, velocity=start)
    steps = len(rollout.state)
    grid = stages(motion.time)
    push, moved = np.zeros((steps, 3, 2)), []
    by_state, by_joints = jacobians(pike, rollout, values=VALUES)
    for k, (joint, omega) in enumerate([(0, 9.0), (3, 14.0)]):
        error = 1e-5 * np.array(
            [np.sin(omega * grid), omega * np.cos(omega * grid), -(omega**2) * np.sin(omega * grid)]
        )
        push[:, :, k] = np.einsum("nio,on->ni", by_joints[..., joint], error[:, :, 0])
        pair = []
        for sign in (1.0, -1.0):
            there = [getattr(motion, name).copy() for name in ("angle", "rate", "acceleration")]
            for value, change in zip(there, error, strict=True):
                value[:, :, joint] += sign * change
            wrong = replace(motion, angle=there[0], rate=there[1], acceleration=there[2])
            pair.append(ode.simulate(pike, wrong, values=VALUES, velocity=start).state[:, 0, :3])
        moved.append(0.5 * (pair[0] - pair[1]))
    found = linear_response(by_state, push, motion.time[:steps])
    for k, expected in enumerate(moved):
        np.testing.assert_allclose(found[:, :, k], expected, atol=2e-3 * np.abs(expected).max())
