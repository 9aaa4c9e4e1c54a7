"""Velocities of the links along a rollout."""

from __future__ import annotations

import numpy as np

from mjfish.fish import Fish, frames
from mjfish.numerics.arrays import FloatArray
from mjfish.ode.rollout import Rollout


def link_velocities(fish: Fish, rollout: Rollout) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return u, v, w (n, links) of the links' front joints in their frames (x towards the tail), at starts of steps."""
    state = rollout.state[:, 0]
    angle, rate = rollout.motion.angle[: len(state), 0].copy(), rollout.motion.rate[: len(state), 0].copy()
    if fish.tail_compliance > 0.0:
        angle[:, -1] += state[:, 6]
        rate[:, -1] += state[:, 7]
    u, v, w = frames.flip(state[:, :3]).T
    found = [(u, v, w)]
    for i, link in enumerate(fish.links[:-1]):
        c, s = np.cos(angle[:, i]), np.sin(angle[:, i])
        sway = v + link.length * w
        u, v, w = c * u + s * sway, c * sway - s * u, w + rate[:, i]
        found.append((u, v, w))
    u, v, w = np.moveaxis(np.array(found), 0, 2)
    return u, v, w
