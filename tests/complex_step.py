"""A referee for derivatives of rollouts: the same equation of motion compiled for complex numbers.

An analytic function at x + i e d is f(x) + i e f'(x) d - O(e^2); with e = 1e-30 the imaginary part is the derivative to
rounding [Squire1998]. Loads are real, so that there is none here.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from mjfish.drive.motion import JointMotion
from mjfish.fish import Fish
from mjfish.hydro.link import LINK, numbers_of
from mjfish.hydro.load import load_rows
from mjfish.numerics.arrays import FloatArray
from mjfish.ode.equation import STATES, Joints, System, tail_of
from mjfish.ode.rollout import Rollout, Workspace, integrate, start_of
from mjfish.ode.tangents import Direction

TINY = 1e-30
#: The record of a link of complex numbers, in the same order.
COMPLEX_LINK = np.dtype([(name, np.complex128, LINK[name].shape) for name in LINK.names or ()], align=True)


def rollout_along(
    fish: Fish,
    motion: JointMotion,
    direction: Direction,
    values: Mapping[str, float],
    velocity: FloatArray | None = None,
    coriolis: str = "corrected",
) -> Rollout:
    """Return a rollout of complex numbers: the imaginary part of its state is TINY times the derivative."""
    rate = np.zeros((3, *motion.angle.shape)) if direction.motion is None else direction.motion
    cos, sin = motion.trigonometry
    start = _along(start_of(velocity), None if direction.velocity is None else start_of(direction.velocity))
    states, rates = np.zeros((2, len(motion.time) - 1, 2, STATES), dtype=np.complex128)
    system = System(
        _along(numbers_of(fish, values), direction.links).view(COMPLEX_LINK).ravel(),
        _along(tail_of(fish), direction.tail),
        coriolis == "printed",
        load_rows([]),
    )
    joints = Joints(
        _along(cos, -sin * rate[0]),
        _along(sin, cos * rate[0]),
        _along(motion.rate, rate[1]),
        _along(motion.acceleration, rate[2]),
        _along(motion.angle[:, :, -1], rate[0][:, :, -1]),
    )
    workspace = Workspace.of(STATES, motion.joints, np.complex128)
    done = integrate(system, joints, motion.time, motion.jumps, start, workspace, states, rates)
    return Rollout.of(motion, states, rates, done)


def _along(numbers: FloatArray, rate: FloatArray | None) -> Any:
    made = np.array(numbers, dtype=np.complex128, order="C")
    if rate is not None:
        made.imag = TINY * rate
    return made
