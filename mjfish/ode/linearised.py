"""The equation of motion linearised along a rollout: how a small deviation of velocity or joints grows or dies.

    dv' = A(t) dv + B(t) (dq, dq', dq''),   A = d(u', v', w') / d(u, v, w),   B = d(u', v', w') / d(q, q', q'')

A is exact (`mjfish.ode.linear`), B by central differences; pose, tail deflection and the memory of loads are held.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from scipy import linalg

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

#: Of the differences by joint angles, rates and accelerations [rad, rad/s, rad/s2].
_STEP = 1e-5


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
    motion, steps, state = rollout.motion, len(rollout.state), _states(rollout)
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


def steered(
    fish: Fish,
    rollout: Rollout,
    *,
    values: Mapping[str, float] | None = None,
    loads: Sequence[tuple[Load, Sequence[float]]] = (),
) -> FloatArray:
    """Return B (n, 3, 3, joints) at the start of every step of a rollout, in the forward frame.

    The last but one axis: by the joints' angles [rad], rates [rad/s] and accelerations [rad/s2].

    Args:
        fish: the fish.
        rollout: of the fish.
        values: coefficients by name that replace the fish's.
        loads: extra forces on every link, with their parameters.
    """
    motion, steps, state = rollout.motion, len(rollout.state), _states(rollout)
    out = np.zeros((steps, 3, 3, motion.joints))
    numbers, _ = scratch(motion.joints, 0, 0, state.shape[1])
    run: Any = _steered
    run(
        link_records(fish, values), motion.angle[:steps, 0], motion.rate[:steps, 0], motion.acceleration[:steps, 0],
        state, tail_of(fish), *load_rows(loads, len(fish.links), STATES), numbers, np.empty((5, motion.joints)), out,
    )  # fmt: skip
    return np.asarray(frames.flip(np.ones(3))[:, None, None] * out)


def deviations(growing: FloatArray, push: FloatArray, time: FloatArray) -> FloatArray:
    """Return dv (n, 3, k) of dv' = A dv + p from dv = 0, exact in A over a step and of second order in p.

    Args:
        growing: A (n, 3, 3) at the times [1/s].
        push: p (n, 3, k), columns of accelerations.
        time: (n,) increasing [s].
    """
    step = np.diff(time)[:, None, None]
    over = linalg.expm(0.5 * step * (growing[:-1] + growing[1:]))
    result = np.zeros_like(push)
    for k in range(len(step)):
        half = 0.5 * step[k]
        result[k + 1] = over[k] @ (result[k] + half * push[k]) + half * push[k + 1]
    return result


def _states(rollout: Rollout) -> FloatArray:
    """Return the states (n, STATES + hidden) at the start of every step, in the model's frame."""
    hidden = np.zeros((len(rollout.state), 0)) if rollout.memory is None else rollout.memory[:, 0]
    state = np.concatenate([rollout.state[:, 0], hidden], axis=1)
    state[:, :3], state[:, 3:6] = frames.flip(state[:, :3]), frames.flip(state[:, 3:6])
    return state


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


@borrowing
def _steered(
    links: Any, angle: FloatArray, rate: FloatArray, acceleration: FloatArray, state: FloatArray, tail: FloatArray,
    hooks: Any, hook_parameters: FloatArray, numbers: Any, here: FloatArray, out: FloatArray,
) -> None:  # fmt: skip
    _, _, _, moved, _, _, _, _, _, force, _, _, _, _, _, _ = numbers
    joints = angle.shape[1]
    for k in range(out.shape[0]):
        for order in range(3):
            for joint in range(joints):
                for sign in (1.0, -1.0):
                    for i in range(joints):
                        here[0, i] = angle[k, i]
                        here[1, i] = rate[k, i]
                        here[2, i] = acceleration[k, i]
                    here[order, joint] += sign * _STEP
                    for i in range(joints):
                        here[3, i] = np.cos(here[0, i])
                        here[4, i] = np.sin(here[0, i])
                    derivative(
                        links, here[3], here[4], here[1], here[2], here[0, -1], state[k], tail, False, hooks,
                        hook_parameters, force, moved,
                    )  # fmt: skip
                    for i in range(3):
                        out[k, i, order, joint] += sign * moved[i] / (2.0 * _STEP)
