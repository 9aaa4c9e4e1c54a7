"""Roll: a pendulum that leans as the water pushes the fish sideways; its marker goes with it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from studies.battery.generator.compiled import compiled
from studies.battery.generator.world import Motion

_GRAVITY = 9.81
#: Natural frequency [rad/s] and damping of a fish whose roll is no cause.
FREQUENCY, DAMPING = 8.0, 0.2


def rolled(motion: Motion, psi: Mapping[str, float]) -> Motion:
    """Return roll [rad] and its rate at all nodes of a motion, from rest.

    phi'' + 2 zeta omega phi' + omega^2 sin phi = -(omega^2 / g) (sway' + yaw_rate surge). With q = phi' + (omega^2 / g)
    sway, which goes on where the sway jumps, no acceleration is needed.
    """
    if psi.get("roll_slip.size"):
        return Motion(tuple((times, seen[:, 8:9]) for times, seen in motion.stretches))
    frequency, damping = psi.get("roll.frequency", FREQUENCY), psi.get("roll.damping", DAMPING)
    state = np.zeros(2)
    state[1] = frequency**2 / _GRAVITY * motion.stretches[0][1][0, 1]
    parts = []
    for times, seen in motion.stretches:
        out = np.empty((len(times), 2))
        _swing(times, seen, frequency, damping, state, out)
        parts.append((times, out))
    return Motion(tuple(parts))


@compiled
def _swing(times, seen, frequency, damping, state, out):  # type: ignore[no-untyped-def]
    """Heun's rule from node to node; the state is phi and q."""
    k = frequency * frequency / _GRAVITY
    for i in range(times.shape[0]):
        rate = state[1] - k * seen[i, 1]
        out[i, 0] = state[0]
        out[i, 1] = rate
        if i + 1 < times.shape[0]:
            h = times[i + 1] - times[i]
            pull = -2.0 * damping * frequency * rate - frequency**2 * np.sin(state[0]) - k * seen[i, 2] * seen[i, 0]
            phi = state[0] + h * rate
            ahead = state[1] + h * pull - k * seen[i + 1, 1]
            pull_ahead = -2.0 * damping * frequency * ahead - frequency**2 * np.sin(phi)
            pull_ahead -= k * seen[i + 1, 2] * seen[i + 1, 0]
            state[0] += 0.5 * h * (rate + ahead)
            state[1] += 0.5 * h * (pull + pull_ahead)
