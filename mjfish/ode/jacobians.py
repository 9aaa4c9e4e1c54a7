"""Jacobians of the equation of motion along a rollout, and the response of the velocity to small disturbances.

    dv' = A(t) dv + B(t) (dq, dq', dq''),   A = d(u', v', w') / d(u, v, w),   B = d(u', v', w') / d(q, q', q'')

Both are exact (`mjfish.ode.linearisation`), but for loads that read place, heading or bend of a link: these are held,
like pose, tail deflection and the hidden states of loads.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy import linalg

from mjfish.fish import Fish, frames
from mjfish.hydro.load import Load, load_rows
from mjfish.numerics.arrays import FloatArray
from mjfish.numerics.compiled import borrowing
from mjfish.ode.equation import STATES, Joints, System, derivative
from mjfish.ode.linearisation import ANGLE, Linearisation, linearise
from mjfish.ode.rollout import Rollout, system_of

_ALL = slice(None)


def jacobians(
    fish: Fish,
    rollout: Rollout,
    *,
    values: Mapping[str, float] | None = None,
    loads: Sequence[tuple[Load, Sequence[float]]] = (),
    steps: slice = _ALL,
    joints: bool = True,
) -> tuple[FloatArray, FloatArray]:
    """Return A (n, 3, 3) [1/s; yaw in rad] and B (n, 3, 3, joints) at the start of every step, in the forward frame.

    The last but one axis of B: by the joints' angles [rad], rates [rad/s] and accelerations [rad/s2].

    Args:
        fish: the fish.
        rollout: of the fish.
        values: coefficients by name that replace the fish's.
        loads: extra forces on every link, with their parameters.
        steps: which ones.
        joints: whether B is asked for; else there are no joints in it.
    """
    motion, states = rollout.motion, rollout.at_steps()[:-1][steps].copy()
    states[:, :3], states[:, 3:6] = frames.flip(states[:, :3]), frames.flip(states[:, 3:6])
    by_state, by_joints = np.zeros((len(states), 3, 3)), np.zeros((len(states), 3, 3, motion.joints * joints))
    cos, sin = motion.trigonometry
    starts = (
        part[: len(rollout.state), 0][steps].copy()
        for part in (cos, sin, motion.rate, motion.acceleration, motion.angle[..., -1])
    )
    system = system_of(fish, values, "corrected", load_rows(loads, len(fish.links), STATES))
    linear = Linearisation.empty(motion.joints, states.shape[1], len(loads))
    _write_jacobians(system, Joints(*starts), states, np.zeros(states.shape[1]), linear, by_state, by_joints)
    signs = frames.flip(np.ones(3))
    by_state *= signs[:, None] * signs
    by_joints *= signs[:, None, None]
    return by_state, by_joints


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


@borrowing
def _write_jacobians(
    system: System, joints: Joints, states: FloatArray, rates: FloatArray, linear: Linearisation, by_state: FloatArray,
    by_joints: FloatArray,
) -> None:  # fmt: skip
    for k in range(states.shape[0]):
        at = Joints(joints.cos[k], joints.sin[k], joints.rate[k], joints.acceleration[k], joints.angle_last[k])
        derivative(system, at, states[k], linear.output, rates)
        linearise(system, at, states[k], rates, by_joints.shape[3] > 0, False, linear)
        for i in range(3):
            for j in range(3):
                by_state[k, i, j] = linear.by_state[j, i]
                for joint in range(by_joints.shape[3]):
                    by_joints[k, i, j, joint] = linear.by_joints[joint, ANGLE + j, i]
