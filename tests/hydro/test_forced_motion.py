"""Loads on a link that is moved as told."""

from __future__ import annotations

from typing import Any

import numpy as np

from mjfish.fish import Fish
from mjfish.hydro.forced_motion import forced_motion
from mjfish.hydro.link import link_records
from mjfish.hydro.load import load


@load
def plain(link: Any, parameters: Any) -> tuple[float, float, float]:
    """Push against u, v, w, each with its own number."""
    return -parameters[0] * link.u, -2.0 * link.v, -3.0 * link.w


@load(memory=1)
def late(link: Any, parameters: Any) -> tuple[float, float, float, float]:
    """Push against the velocity across that was, by a lag."""
    return 0.0, -link.memory[0], 0.0, (link.v - link.memory[0]) / parameters[0]


def test_forces_are_those_of_the_velocity_at_every_step_and_of_what_is_remembered(pike: Fish) -> None:
    """A lag behind a speed that rises by a from rest: a (t - tau + tau exp(-t / tau)), to the order of the step."""
    step, tau = 0.01, 0.05
    time = 0.5 * step * np.arange(81)
    velocity = np.stack([0.1 + 0.0 * time, 3.0 * time, -time], axis=1)
    found = forced_motion(link_records(pike), 2, [(plain, [4.0]), (late, [tau])], velocity, step)
    at = time[::2]
    assert found.shape == (41, 3)
    np.testing.assert_allclose(found[:, 0], -0.4, rtol=1e-12)
    np.testing.assert_allclose(found[:, 2], 3.0 * at, rtol=1e-12)
    lagged = 3.0 * (at - tau + tau * np.exp(-at / tau))
    np.testing.assert_allclose(found[:, 1] + 6.0 * at, -lagged, rtol=0.0, atol=1e-6)


def test_without_loads_there_is_no_force(pike: Fish) -> None:
    assert not forced_motion(link_records(pike), 0, [], np.ones((5, 3)), 0.01).any()
