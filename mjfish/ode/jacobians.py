"""Jacobians of the equation of motion along a rollout, and the response of the velocity to small disturbances.

    dv' = A(t) dv + B(t) (dq, dq', dq''),   A = d(u', v', w') / d(u, v, w),   B = d(u', v', w') / d(q, q', q'')

The state Jacobian A is exact (`mjfish.ode.linearisation`), the input Jacobian B is by central differences. Pose, tail
deflection and the hidden states of loads are held.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy import linalg

from mjfish import frames
from mjfish.arrays import FloatArray
from mjfish.compiled import borrowing
from mjfish.fish import Fish
from mjfish.hydro.load import ANSWER, Load, LoadBuffers, load_rows
from mjfish.ode.equation import STATES, Joints, System, derivative
from mjfish.ode.linearisation import Linearisation, linearise
from mjfish.ode.rollout import Rollout, system_of

#: Step of the differences by joint angles, rates and accelerations [rad, rad/s, rad/s2].
_STEP = 1e-5
_ALL = slice(None)


def state_jacobian(
    fish: Fish,
    rollout: Rollout,
    *,
    values: Mapping[str, float] | None = None,
    loads: Sequence[tuple[Load, Sequence[float]]] = (),
    steps: slice = _ALL,
) -> FloatArray:
    """Return A (n, 3, 3) [1/s; yaw in rad] at the start of every step of a rollout, in the forward frame.

    Args:
        fish: the fish.
        rollout: of the fish.
        values: coefficients by name that replace the fish's.
        loads: extra forces on every link, with their parameters.
        steps: which ones.
    """
    motion, states = rollout.motion, _states(rollout, steps)
    out = np.zeros((len(states), 3, 3))
    cos, sin = motion.trigonometry
    starts = (
        part[: len(rollout.state), 0][steps].copy()
        for part in (cos, sin, motion.rate, motion.acceleration, motion.angle[..., -1])
    )
    system = system_of(fish, values, "corrected", load_rows(loads, len(fish.links), STATES))
    linear = Linearisation.empty(motion.joints, states.shape[1], len(loads))
    _write_state_jacobian(system, Joints(*starts), states, np.zeros(states.shape[1]), linear, out)
    signs = frames.flip(np.ones(3))
    out *= signs[:, None] * signs
    return out


def input_jacobian(
    fish: Fish,
    rollout: Rollout,
    *,
    values: Mapping[str, float] | None = None,
    loads: Sequence[tuple[Load, Sequence[float]]] = (),
    steps: slice = _ALL,
) -> FloatArray:
    """Return B (n, 3, 3, joints) at the start of every step of a rollout, in the forward frame.

    The last but one axis: by the joints' angles [rad], rates [rad/s] and accelerations [rad/s2].

    Args:
        fish: the fish.
        rollout: of the fish.
        values: coefficients by name that replace the fish's.
        loads: extra forces on every link, with their parameters.
        steps: which ones.
    """
    motion, states = rollout.motion, _states(rollout, steps)
    out = np.zeros((len(states), 3, 3, motion.joints))
    every = (motion.angle, motion.rate, motion.acceleration)
    sampled = np.stack([part[: len(rollout.state), 0][steps] for part in every], axis=1)
    system = system_of(fish, values, "corrected", load_rows(loads, len(fish.links), STATES))
    buffers = LoadBuffers(np.zeros(ANSWER), states[0], np.zeros(states.shape[1]))
    _write_input_jacobian(system, sampled, states, buffers, np.empty((5, motion.joints)), out)
    out *= frames.flip(np.ones(3))[:, None, None]
    return out


def linear_response(jacobian: FloatArray, forcing: FloatArray, time: FloatArray) -> FloatArray:
    """Return dv (n, 3, k) of dv' = A dv + p from dv = 0, exact in A over a step and of second order in p.

    Args:
        jacobian: A (n, 3, 3) at the times [1/s].
        forcing: p (n, 3, k), columns of accelerations.
        time: (n,) increasing [s].
    """
    step = np.diff(time)[:, None, None]
    transition = linalg.expm(0.5 * step * (jacobian[:-1] + jacobian[1:]))
    response = np.zeros_like(forcing)
    for k in range(len(step)):
        half = 0.5 * step[k]
        response[k + 1] = transition[k] @ (response[k] + half * forcing[k]) + half * forcing[k + 1]
    return response


def _states(rollout: Rollout, steps: slice) -> FloatArray:
    """Return the states (n, STATES + memory) at the start of steps, in the model's frame."""
    parts = (rollout.state,) if rollout.memory is None else (rollout.state, rollout.memory)
    state = np.concatenate([part[steps, 0] for part in parts], axis=1)
    state[:, :3], state[:, 3:6] = frames.flip(state[:, :3]), frames.flip(state[:, 3:6])
    return state


@borrowing
def _write_state_jacobian(
    system: System, joints: Joints, states: FloatArray, rates: FloatArray, linear: Linearisation, out: FloatArray
) -> None:
    for k in range(out.shape[0]):
        at = Joints(joints.cos[k], joints.sin[k], joints.rate[k], joints.acceleration[k], joints.angle_last[k])
        derivative(system, at, states[k], linear.output, rates)
        linearise(system, at, states[k], rates, False, False, linear)
        for i in range(3):
            for j in range(3):
                out[k, i, j] = linear.by_state[j, i]


@borrowing
def _write_input_jacobian(
    system: System, motion: FloatArray, states: FloatArray, buffers: LoadBuffers, trial: FloatArray, out: FloatArray
) -> None:
    """Write differences by joint motion (n, 3, joints); `trial` (5, joints) and `buffers` are scratch."""
    joints = motion.shape[2]
    for k in range(out.shape[0]):
        for order in range(3):
            for joint in range(joints):
                for sign in (1.0, -1.0):
                    for i in range(joints):
                        trial[0, i], trial[1, i], trial[2, i] = motion[k, 0, i], motion[k, 1, i], motion[k, 2, i]
                    trial[order, joint] += sign * _STEP
                    for i in range(joints):
                        trial[3, i], trial[4, i] = np.cos(trial[0, i]), np.sin(trial[0, i])
                    at = Joints(trial[3], trial[4], trial[1], trial[2], trial[0, joints - 1])
                    derivative(system, at, states[k], buffers.output, buffers.rates)
                    for i in range(3):
                        out[k, i, order, joint] += sign * buffers.rates[i] / (2.0 * _STEP)
