"""Loads on one link that is moved as told: what a bench would measure of them, memory included."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from mjfish.hydro.load import ANSWER, Load, LoadBuffers, LoadTable, load_rows, loads_on, memory_of
from mjfish.numerics.arrays import FloatArray
from mjfish.numerics.compiled import compiled


def forced_motion(
    records: Any, link: int, loads: Sequence[tuple[Load, Sequence[float]]], velocity: FloatArray, step: float
) -> FloatArray:
    """Return the force of loads on a link that is moved, its hidden states zero at first.

    Args:
        records: `LINK` records; velocities of the link's one are overwritten.
        link: index of the link.
        loads: with their parameters.
        velocity: (2 n + 1, 3) u, v [m/s], w [rad/s] of the link at start, middle and end of n Runge-Kutta steps.
        step: of the time [s].

    Returns:
        (n + 1, 3) fx, fy [N], mz [N m] at start and end of every step.
    """
    links = len(records)
    states = memory_of(loads, links)
    return np.asarray(_moved(records, link, load_rows(loads, links), velocity, step, max(states, 1)))


@compiled
def _moved(links: Any, link: int, table: LoadTable, velocity: FloatArray, step: float, states: int) -> FloatArray:
    force = np.zeros((velocity.shape[0] // 2 + 1, 3))
    state, trial, rates, total = np.zeros(states), np.zeros(states), np.zeros(states), np.zeros(states)
    output = np.zeros(ANSWER)
    record = links[link]
    for k in range(force.shape[0]):
        trial[:] = state
        for stage in range(4):
            at = 2 * k + (0 if stage == 0 else (2 if stage == 3 else 1))
            if at >= velocity.shape[0]:
                break
            record.u, record.v, record.w = velocity[at, 0], velocity[at, 1], velocity[at, 2]
            rates[:] = 0.0
            fx, fy, mz = loads_on(links, link, link, table, False, LoadBuffers(output, trial, rates))
            if stage == 0:
                force[k, 0], force[k, 1], force[k, 2] = fx, fy, mz
                total[:] = 0.0
            total += rates if stage == 0 or stage == 3 else 2.0 * rates
            trial[:] = state + (0.5 if stage < 2 else 1.0) * step * rates
        state += step / 6.0 * total
    return force
