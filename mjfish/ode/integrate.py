"""Classical Runge-Kutta integration of the head-frame equation on the half-step grid of the joint motion."""

from __future__ import annotations

from typing import Any

import numpy as np

from mjfish.arrays import FloatArray
from mjfish.compiled import compiled
from mjfish.hydro.load import ANSWER
from mjfish.ode.equation import STATES, derivative, derivative_inlined

#: A rollout has diverged once a velocity passes this [m/s or rad/s]: no fish does.
DIVERGED = 1e3


@compiled
def integrate(
    links: Any,
    time: FloatArray,
    cos: FloatArray,
    sin: FloatArray,
    rate: FloatArray,
    acceleration: FloatArray,
    angle_last: FloatArray,
    start: FloatArray,
    tail: FloatArray,
    printed: bool,
    hooks: Any,
    hook_parameters: FloatArray,
    states: FloatArray,
    rates: FloatArray,
) -> int:
    """Integrate from `start`; return the number of steps done before divergence (all of them where it stays finite).

    Where the joint rates jump between two steps, the head's velocity jumps with them: no impulse acts on the fish, so
    that sum_i T_i^T (M_i + M_ad,i) dV_i = 0.

    Args:
        links: (n,) `LINK` records, scratch in u, v, w.
        time: (steps + 1,).
        cos, sin, rate, acceleration: (steps, 3, joints); angle_last: (steps, 3).
        start: (STATES + hidden,).
        tail, printed, hooks, hook_parameters: as in `derivative`.
        states, rates: (steps, 2, STATES + hidden), written: the state and its derivative at start and end of each step.
    """
    steps = time.shape[0] - 1
    n = start.shape[0]
    joints = rate.shape[2]
    state = start.copy()
    trial = np.empty_like(start)
    total = np.empty_like(start)
    k = np.empty_like(start)
    scratch = np.zeros(ANSWER)
    still = np.zeros_like(rate[0, 0])
    jump = np.empty_like(rate[0, 0])
    no_hooks = hooks[:0]
    slack = np.zeros_like(tail)
    slack[0] = tail[0]
    for step in range(steps):
        h = time[step + 1] - time[step]
        if step > 0:
            jumps = False
            for i in range(joints):
                jump[i] = rate[step, 0, i] - rate[step - 1, 2, i]
                jumps = jumps or abs(jump[i]) > 1e-9
            if jumps:
                # The end of the step before keeps its own derivative, with the motion from before the jump.
                derivative(
                    links, cos[step - 1, 2], sin[step - 1, 2], rate[step - 1, 2], acceleration[step - 1, 2],
                    angle_last[step - 1, 2], state, tail, printed, hooks, hook_parameters, scratch, rates[step - 1, 1],
                )  # fmt: skip
                trial[:] = 0.0
                trial[5] = state[5]
                trial[6] = state[6]
                derivative(
                    links, cos[step, 0], sin[step, 0], still, jump, angle_last[step, 0], trial, slack, printed,
                    no_hooks, hook_parameters, scratch, k,
                )  # fmt: skip
                state[0] += k[0]
                state[1] += k[1]
                state[2] += k[2]
                state[7] += k[7]
        for stage in range(4):
            at = 0 if stage == 0 else (2 if stage == 3 else 1)
            if stage == 0:
                trial[:] = state
            derivative_inlined(
                links, cos[step, at], sin[step, at], rate[step, at], acceleration[step, at], angle_last[step, at],
                trial, tail, printed, hooks, hook_parameters, scratch, k,
            )  # fmt: skip
            if stage == 0:
                states[step, 0] = state
                rates[step, 0] = k
                if step > 0 and not jumps:
                    rates[step - 1, 1] = k
                total[:] = k
            else:
                weight = 1.0 if stage == 3 else 2.0
                for i in range(STATES):
                    total[i] += weight * k[i]
                for i in range(STATES, n):
                    total[i] += weight * k[i]
            ahead = h if stage == 2 else 0.5 * h
            for i in range(STATES):
                trial[i] = state[i] + ahead * k[i]
            for i in range(STATES, n):
                trial[i] = state[i] + ahead * k[i]
        for i in range(STATES):
            state[i] += h / 6.0 * total[i]
        for i in range(STATES, n):
            state[i] += h / 6.0 * total[i]
        states[step, 1] = state
        if not (abs(state[0]) < DIVERGED and abs(state[1]) < DIVERGED and abs(state[2]) < DIVERGED):
            return step
    last = steps - 1
    derivative(
        links, cos[last, 2], sin[last, 2], rate[last, 2], acceleration[last, 2], angle_last[last, 2],
        state, tail, printed, hooks, hook_parameters, scratch, rates[last, 1],
    )  # fmt: skip
    return int(steps)
