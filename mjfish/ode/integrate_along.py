"""Runge-Kutta integration of a rollout and of many directions along with it, in one pass.

The real part is `mjfish.ode.integrate.integrate`, step for step; the lanes follow the same formulas, differentiated,
and are read at the samples' times only, by the same Hermite interpolation as `mjfish.ode.Rollout.at`.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from mjfish.arrays import BoolArray, FloatArray
from mjfish.compiled import borrowing, merged
from mjfish.hydro.link import MEMORY
from mjfish.hydro.load import ANSWER
from mjfish.ode.algebra import SOLVER
from mjfish.ode.along import along
from mjfish.ode.equation import STATES, derivative
from mjfish.ode.integrate import DIVERGED
from mjfish.ode.linear import KEPT, ROWS, STATE

#: What is evaluated in a step: the end of the step before, the jump, then the four stages.
_END, _JUMP = -2, -1


@borrowing
def integrate_along(
    links: Any, time: FloatArray, cos: FloatArray, sin: FloatArray, rate: FloatArray, acceleration: FloatArray,
    angle_last: FloatArray, jumps: BoolArray, start: FloatArray, tail: FloatArray, printed: bool, hooks: Any,
    hook_parameters: FloatArray, lanes: FloatArray, slack: FloatArray, moving: FloatArray, changes: FloatArray,
    outlines: FloatArray, records: Any, probes: FloatArray, probed: Any, sample_step: Any, sample_at: FloatArray,
    numbers: Any, buffers: Any, states: FloatArray, rates: FloatArray, read: FloatArray,
) -> int:  # fmt: skip
    """Integrate; return the number of steps done before divergence.

    Args:
        links ... hook_parameters: as in `mjfish.ode.integrate.integrate`.
        jumps: (steps,) whether the joint rates jump, those of the motion or of a lane, before a step.
        lanes: (STATES, k) of the start, overwritten.
        slack: (3, k) of the tail.
        moving: (steps, 3, 3 joints, b) of the joints in the first b lanes.
        changes ... probed: of links and loads, see `mjfish.ode.lanes`.
        sample_step, sample_at: (m,) steps in which lanes are read, not decreasing, and where in them, 0 to 1.
        numbers, buffers: of `scratch`.
        states, rates: (steps, 2, STATES), written as by `integrate`.
        read: (m, STATES, k), written as far as the rollout goes.
    """
    steps = time.shape[0] - 1
    state, trial, total, k, turn, bend, tail_now, right, left, force, solver, loaded, slopes, answers, columns, work = (
        numbers
    )
    lane_trial, lane_total, lane_k, before, before_rate, moved, slack_now, longer, carried, pushed = buffers
    _copy(start, state)
    sample = 0
    for step in range(steps + 1):
        over = step == steps
        jump = step > 0 and (over or jumps[step])
        for phase in range(_END if jump else 0, _JUMP if over else 4):
            at = 0 if phase == _JUMP or phase == 0 else (2 if phase == _END or phase == 3 else 1)
            now = step - 1 if phase == _END else step
            if phase <= 0:
                _copy(state, trial)
                _copy_lanes(lanes, lane_trial)
            _copy_lanes(moving[now, at], moved)
            _copy(rate[now, at], turn)
            _copy(acceleration[now, at], bend)
            _copy(tail, tail_now)
            _copy_lanes(slack, slack_now)
            forced = hooks.shape[0]
            probing = probed.shape[0]
            if phase == _JUMP:
                forced = 0
                probing = 0
                _hold(trial, lane_trial, tail_now, slack_now)
                _strike(rate[step, 0], rate[step - 1, 2], moving[step - 1, 2], turn, bend, moved)
            derivative(
                links, cos[now, at], sin[now, at], turn, bend, angle_last[now, at], trial, tail_now, printed,
                hooks[:forced], hook_parameters, force, k,
            )  # fmt: skip
            along(
                links, cos[now, at], sin[now, at], turn, bend, angle_last[now, at], trial, k, lane_trial, moved,
                tail_now, slack_now, printed, hooks[:forced], hook_parameters, changes, outlines, records, probes,
                probed[:probing], right, left, force, solver, loaded, slopes, answers, columns, work, longer, carried,
                pushed, lane_k,
            )  # fmt: skip
            if phase == _JUMP:
                _leap(state, k, lanes, lane_k)
                continue
            if phase == _END or (phase == 0 and step > 0 and not jump):
                _copy(k, rates[step - 1, 1])
                h = time[step] - time[step - 1]
                sample = _read(step - 1, sample, sample_step, sample_at, h, before, before_rate, lanes, lane_k, read)
            if phase == _END:
                continue
            if phase == 0:
                _copy(state, states[step, 0])
                _copy(k, rates[step, 0])
                _copy_lanes(lanes, before)
                _copy_lanes(lane_k, before_rate)
            h = time[step + 1] - time[step]
            ahead = h if phase == 2 else 0.5 * h
            _advance(phase, h, ahead, k, total, trial, state)
            for row in range(lanes.shape[0]):
                _advance(phase, h, ahead, lane_k[row], lane_total[row], lane_trial[row], lanes[row])
        if not over:
            _copy(state, states[step, 1])
            if not (abs(state[0]) < DIVERGED and abs(state[1]) < DIVERGED and abs(state[2]) < DIVERGED):
                return step
    return int(steps)


def scratch(
    joints: int, width: int, bent: int, states: int, longer: FloatArray | None = None
) -> tuple[tuple[FloatArray, ...], tuple[FloatArray, ...]]:
    """Return the scratch of `integrate_along`.

    Args:
        joints: of the fish.
        width: number of lanes.
        bent: of those that move joints.
        states: of the fish and its loads.
        longer: (links, width) of the lengths, where any load is special.
    """
    shapes = (
        states, states, states, states, joints, joints, 3, states, states, ANSWER, SOLVER, (3, 3),
        (ANSWER, 6 + MEMORY), (STATE, ROWS), (joints, 4, ROWS), (joints + 1, KEPT),
    )  # fmt: skip
    lanes = [np.zeros((states, width)) for _ in range(5)]
    carried = 0 if longer is None else width
    return tuple(np.zeros(shape) for shape in shapes), (
        *lanes, np.zeros((3 * joints, bent)), np.zeros((3, width)),
        np.zeros((joints + 1, width)) if longer is None else longer, np.zeros((joints + 1, 6, carried)),
        np.zeros((4, width)),
    )  # fmt: skip


@merged
def _copy(source: FloatArray, target: FloatArray) -> None:
    for i in range(target.shape[0]):
        target[i] = source[i]


@merged
def _copy_lanes(source: FloatArray, target: FloatArray) -> None:
    for row in range(target.shape[0]):
        for k in range(target.shape[1]):
            target[row, k] = source[row, k]


@merged
def _hold(trial: FloatArray, lanes: FloatArray, tail: FloatArray, slack: FloatArray) -> None:
    """Keep heading and deflection only: the fish on which a jump of the joint rates acts is at rest, its tail loose."""
    tail[1] = 0.0
    tail[2] = 0.0
    for row in (0, 1, 2, 3, 4, 7):
        trial[row] = 0.0
    for k in range(lanes.shape[1]):
        for row in (0, 1, 2, 3, 4, 7):
            lanes[row, k] = 0.0
        slack[1, k] = 0.0
        slack[2, k] = 0.0


@merged
def _strike(
    after: FloatArray, before: FloatArray, lanes_before: FloatArray, turn: FloatArray, bend: FloatArray,
    moved: FloatArray,
) -> None:  # fmt: skip
    """Make a jump of the rates an acceleration that acts on joints at rest."""
    joints = turn.shape[0]
    for j in range(joints):
        turn[j] = 0.0
        bend[j] = after[j] - before[j]
        for k in range(moved.shape[1]):
            moved[2 * joints + j, k] = moved[joints + j, k] - lanes_before[joints + j, k]
            moved[joints + j, k] = 0.0


@merged
def _leap(state: FloatArray, k: FloatArray, lanes: FloatArray, lane_k: FloatArray) -> None:
    """Add the answer to a jump of the joint rates to the velocities."""
    for row in (0, 1, 2, 7):
        state[row] += k[row]
        for i in range(lanes.shape[1]):
            lanes[row, i] += lane_k[row, i]


@merged
def _advance(
    phase: int, h: float, ahead: float, k: FloatArray, total: FloatArray, trial: FloatArray, state: FloatArray
) -> None:
    """Take up a stage of Runge-Kutta, in the very order of `mjfish.ode.integrate.integrate`."""
    n = state.shape[0]
    if phase == 0:
        for i in range(n):
            total[i] = k[i]
    else:
        weight = 1.0 if phase == 3 else 2.0
        for i in range(n):
            total[i] += weight * k[i]
    if phase < 3:
        for i in range(n):
            trial[i] = state[i] + ahead * k[i]
    else:
        for i in range(n):
            state[i] += h / 6.0 * total[i]


@merged
def _read(
    step: int, sample: int, sample_step: Any, sample_at: FloatArray, h: float, left: FloatArray, left_rate: FloatArray,
    right: FloatArray, right_rate: FloatArray, read: FloatArray,
) -> int:  # fmt: skip
    """Read the lanes at the samples within a step; return the first sample after it."""
    while sample < sample_step.shape[0] and sample_step[sample] == step:
        s = sample_at[sample]
        a = (1.0 + 2.0 * s) * (1.0 - s) ** 2
        b = s * (1.0 - s) ** 2 * h
        c = s**2 * (s - 1.0) * h
        for row in range(STATES):
            for k in range(left.shape[1]):
                read[sample, row, k] = a * left[row, k] + b * left_rate[row, k]
            for k in range(left.shape[1]):
                read[sample, row, k] += (1.0 - a) * right[row, k] + c * right_rate[row, k]
        sample += 1
    return sample
