"""Exact sensitivities of a rollout: the same compiled code, run on complex numbers that carry a derivative.

An analytic function at x + i e d is f(x) + i e f'(x) d - O(e^2); with e = 1e-30 the imaginary part is the directional
derivative to rounding, without a difference of large numbers and without a second set of equations that could drift
from the first [Squire1998]. Absolute values and signs of the drag follow real parts; their kinks add nothing, for the
integrand vanishes where it changes sign.

[Squire1998] W. Squire, G. Trapp: Using complex variables to estimate derivatives of real functions, SIAM Review 40.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mjfish.arrays import FloatArray
from mjfish.drive.motion import JointMotion
from mjfish.fish import Fish
from mjfish.hydro.link import COMPLEX_LINK, LINK, link_records
from mjfish.hydro.load import Load, load_table
from mjfish.hydro.load_tangent import TINY
from mjfish.ode.rollout import Coriolis, Rollout, integrated, start_of, tail_of

ComplexArray = NDArray[np.complex128]
_NUMBERS = LINK.itemsize // 8


@dataclass(frozen=True, eq=False)
class Direction:
    """What a rollout is derived by: rates of change of its inputs; None is zero.

    Attributes:
        links: (links, numbers of `LINK`) of the link records.
        tail: (3,) of the flexible tail, see `mjfish.ode.equation`.
        velocity: (3,) of the velocity at the start, in the forward frame.
        motion: (3, n, 3, joints) of angle, rate and acceleration of the joints.
        loads: (k, PARAMETERS) of the parameters of the loads.
    """

    links: FloatArray | None = None
    tail: FloatArray | None = None
    velocity: FloatArray | None = None
    motion: FloatArray | None = None
    loads: FloatArray | None = None


def numbers_of(fish: Fish, values: Mapping[str, float] | None = None) -> FloatArray:
    """Return the link records as rows of numbers (links, numbers of `LINK`)."""
    rows: FloatArray = link_records(fish, values).view(np.float64).reshape(-1, _NUMBERS)
    return rows


def simulate_along(
    fish: Fish,
    motion: JointMotion,
    direction: Direction,
    *,
    values: Mapping[str, float] | None = None,
    velocity: FloatArray | None = None,
    coriolis: Coriolis = "corrected",
    loads: Sequence[tuple[Load, Sequence[float]]] = (),
) -> Rollout:
    """Simulate like `mjfish.ode.simulate`, and along with it the derivative in one direction.

    Returns:
        A rollout of complex numbers: the imaginary part of `state`, `derivative` and `at(time)` is TINY times the
        derivative along `direction`; the real part is the rollout.
    """
    addresses, parameters = load_table(loads)
    return integrated(
        motion,
        _along(numbers_of(fish, values), direction.links).view(COMPLEX_LINK).ravel(),
        _still(motion) if direction.motion is None else _moving(motion, direction.motion),
        _along(start_of(velocity), None if direction.velocity is None else start_of(direction.velocity)),
        _along(tail_of(fish), direction.tail),
        coriolis,
        (addresses, _along(parameters, direction.loads)),
    )


def _along(numbers: FloatArray, rate: FloatArray | None) -> ComplexArray:
    made = np.array(numbers, dtype=np.complex128, order="C")
    if rate is not None:
        made.imag = TINY * rate
    return made


@functools.lru_cache(maxsize=32)
def _still(motion: JointMotion) -> tuple[ComplexArray, ...]:
    return _moving(motion, np.zeros((3, 1, 1, 1)))


def _moving(motion: JointMotion, rate: FloatArray) -> tuple[ComplexArray, ...]:
    """Return cosine, sine, rate, acceleration of the joints and the angle of the last, with their derivatives."""
    cos, sin = motion.trigonometry
    turn = rate[0]
    last = motion.angle[:, :, -1]
    return (
        _along(cos, -sin * turn),
        _along(sin, cos * turn),
        _along(motion.rate, rate[1]),
        _along(motion.acceleration, rate[2]),
        _along(last, np.broadcast_to(turn, motion.angle.shape)[:, :, -1]),
    )
