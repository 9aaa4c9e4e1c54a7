"""Velocities of the links along a run, from state and joints, without the package's kinematics."""

from __future__ import annotations

import numpy as np

from mjfish.fish import Fish
from mjfish.numerics.arrays import FloatArray
from mjfish.ode.rollout import Rollout


def link_velocities(fish: Fish, rollout: Rollout) -> FloatArray:
    """Return u, v, w (n, links, 3) of every link's front joint in its own frame, x to the tail, after each jump.

    From the rates of the joints' places in the world: the velocity of a joint is that of the one in front of it, plus
    the rate of turn times the link between them.
    """
    motion, state = rollout.motion, rollout.at_steps()
    angle, rate = (np.concatenate([a[:, 0], a[-1:, 2]]) for a in (motion.angle, motion.rate))
    heading = state[:, 5]
    turn = state[:, 2]
    cos, sin = np.cos(heading), np.sin(heading)
    world = np.stack([cos * state[:, 0] - sin * state[:, 1], sin * state[:, 0] + cos * state[:, 1]], axis=1)
    found = np.empty((len(state), len(fish.links), 3))
    for i, link in enumerate(fish.links):
        ahead = np.stack([np.cos(heading), np.sin(heading)], axis=1)
        port = np.stack([-ahead[:, 1], ahead[:, 0]], axis=1)
        found[:, i, 0] = -np.sum(world * ahead, axis=1)
        found[:, i, 1] = -np.sum(world * port, axis=1)
        found[:, i, 2] = turn
        if i < len(fish.links) - 1:
            world = world - link.length * turn[:, None] * port
            heading, turn = heading + angle[:, i], turn + rate[:, i]
    return found
