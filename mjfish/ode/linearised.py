"""The equation of motion linearised along a rollout: how a small deviation of the velocity grows or dies.

    dv' = A(t) dv,   A = d(u', v', w') / d(u, v, w)

exact (`mjfish.ode.linear`); pose, tail deflection and the memory of loads are held.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from mjfish import frames
from mjfish.arrays import FloatArray
from mjfish.compiled import borrowing
from mjfish.fish import Fish
from mjfish.hydro.link import link_records
from mjfish.hydro.load import Load, load_rows
from mjfish.ode.equation import STATES, derivative
from mjfish.ode.integrate_along import scratch
from mjfish.ode.linear import gather, travel
from mjfish.ode.rollout import Rollout, tail_of


def growth(
    fish: Fish,
    rollout: Rollout,
    *,
    values: Mapping[str, float] | None = None,
    loads: Sequence[tuple[Load, Sequence[float]]] = (),
) -> FloatArray:
    """Return A (n, 3, 3) [1/s; yaw in rad] at the start of every step of a rollout, in the forward frame.

    Args:
        fish: the fish.
        rollout: of the fish.
        values: coefficients by name that replace the fish's.
        loads: extra forces on every link, with their parameters.
    """
    motion, steps = rollout.motion, len(rollout.state)
    hidden = np.zeros((steps, 0)) if rollout.memory is None else rollout.memory[:, 0]
    state = np.concatenate([rollout.state[:, 0], hidden], axis=1)
    state[:, :3], state[:, 3:6] = frames.flip(state[:, :3]), frames.flip(state[:, 3:6])
    out = np.zeros((steps, 3, 3))
    cos, sin = motion.trigonometry
    numbers, _ = scratch(motion.joints, 0, 0, state.shape[1])
    run: Any = _growth
    run(
        link_records(fish, values), cos[:steps, 0], sin[:steps, 0], motion.rate[:steps, 0],
        motion.acceleration[:steps, 0], motion.angle[:steps, 0, -1], state, tail_of(fish),
        *load_rows(loads, len(fish.links), STATES), numbers, out,
    )  # fmt: skip
    signs = frames.flip(np.ones(3))
    return np.asarray(signs[:, None] * out * signs)


@borrowing
def _growth(
    links: Any, cos: FloatArray, sin: FloatArray, rate: FloatArray, acceleration: FloatArray, last: FloatArray,
    state: FloatArray, tail: FloatArray, hooks: Any, hook_parameters: FloatArray, numbers: Any, out: FloatArray,
) -> None:  # fmt: skip
    _, _, _, moved, _, _, _, rates, _, force, solver, loaded, _, answers, columns, work = numbers
    for k in range(out.shape[0]):
        derivative(
            links, cos[k], sin[k], rate[k], acceleration[k], last[k], state[k], tail, False, hooks, hook_parameters,
            force, moved,
        )  # fmt: skip
        travel(links, cos[k], sin[k], rate[k], acceleration[k], last[k], state[k], moved, tail[0] > 0.0, work)
        gather(
            links, work, tail, False, hooks, hook_parameters, False, False, state[k], rates, force, loaded, columns,
            answers, solver,
        )  # fmt: skip
        for i in range(3):
            for j in range(3):
                out[k, i, j] = answers[j, i]
