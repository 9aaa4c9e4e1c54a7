"""Joint motion: what the joints do, sampled on the grid of the integrator.

The model takes joint motion as its input ([Yu2016], after eq. (19)). It is sampled once, at the start, middle and
end of every integration step, which is all that a fourth-order Runge-Kutta step asks for. Start and end are kept
apart, so that the rate may jump between two steps: a CPG whose frequency or bias changes as a step does that.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Callable
from dataclasses import dataclass
from typing import ParamSpec

import numpy as np

from mjfish.numerics.arrays import BoolArray, FloatArray, readonly
from mjfish.numerics.compiled import compiled
from mjfish.numerics.sized_cache import sized_cache

P = ParamSpec("P")

#: Smallest jump of a joint's rate between two steps [rad/s]: rounding is none.
_JUMP = 1e-9


@dataclass(frozen=True, eq=False)
class JointMotion:
    """Angles, rates and accelerations of all joints at start, middle and end of each step.

    Attributes:
        time: (n + 1,) boundaries of the steps [s].
        angle: (n, 3, joints) [rad].
        rate: (n, 3, joints) [rad/s].
        acceleration: (n, 3, joints) [rad/s2].
    """

    time: FloatArray
    angle: FloatArray
    rate: FloatArray
    acceleration: FloatArray

    def __post_init__(self) -> None:
        """Make the arrays read-only."""
        for name in ("time", "angle", "rate", "acceleration"):
            object.__setattr__(self, name, readonly(getattr(self, name)))

    @property
    def joints(self) -> int:
        """Number of joints."""
        return int(self.angle.shape[2])

    @property
    def nbytes(self) -> int:
        """Bytes of the motion with its `trigonometry`."""
        return int(self.time.nbytes + 5 * self.angle.nbytes)

    @functools.cached_property
    def trigonometry(self) -> tuple[FloatArray, FloatArray]:
        """Cosines and sines of the angles, each (n, 3, joints); kept, because many rollouts share a motion."""
        return _trigonometry(self.angle)

    @functools.cached_property
    def jumps(self) -> BoolArray:
        """Whether the rates jump before each step (n,)."""
        jumps = np.zeros(len(self.rate), dtype=bool)
        jumps[1:] = (np.abs(self.rate[1:, 0] - self.rate[:-1, 2]) > _JUMP).any(axis=1)
        return jumps

    def angle_at(self, time: FloatArray) -> FloatArray:
        """Return the angles (m, joints) [rad] at any times, by cubic Hermite interpolation inside each half step."""
        step = np.clip(np.searchsorted(self.time, time, side="right") - 1, 0, len(self.angle) - 1)
        width = 0.5 * (self.time[step + 1] - self.time[step])
        s = np.clip((time - self.time[step]) / width, 0.0, 2.0)
        half = (s >= 1.0).astype(int)
        s, width = (s - half)[:, None], width[:, None]
        left, right = self.angle[step, half], self.angle[step, half + 1]
        slope_left, slope_right = self.rate[step, half] * width, self.rate[step, half + 1] * width
        return np.asarray(
            (1 + 2 * s) * (1 - s) ** 2 * left
            + s * (1 - s) ** 2 * slope_left
            + s**2 * (3 - 2 * s) * right
            + s**2 * (s - 1) * slope_right
        )

    def half_steps(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return half-step nodes (2n + 1,) and angle, rate at both ends of each half step (2n, 2, joints)."""
        nodes = np.sort(np.concatenate([self.time, 0.5 * (self.time[:-1] + self.time[1:])]))
        pairs = [(0, 1), (1, 2)]
        angle = np.stack([self.angle[:, pair] for pair in pairs], axis=1).reshape(-1, 2, self.joints)
        rate = np.stack([self.rate[:, pair] for pair in pairs], axis=1).reshape(-1, 2, self.joints)
        return nodes, angle, rate


def cached(limit: float) -> Callable[[Callable[P, JointMotion]], Callable[P, JointMotion]]:
    """Return a decorator that keeps the motions that a function returns, up to `limit` bytes of them."""
    return sized_cache(lambda motion: motion.nbytes, limit)


#: Shortest step after a break [s]: a servo that follows a step of the drive does so within milliseconds.
_FIRST = 1e-4


def grid(breaks: FloatArray, step: float, *, graded: bool = False) -> FloatArray:
    """Return step boundaries [s] that hit every break, equal within a stretch and never longer than `step`.

    Args:
        breaks: increasing times: start, changes of the drive, end [s].
        step: longest step [s].
        graded: cut the first step after each break into steps that double in length from 0.1 ms on.
    """
    stretches = []
    for a, b in itertools.pairwise(breaks):
        even = np.linspace(a, b, max(int(np.ceil((b - a) / step - 1e-9)), 1) + 1)[:-1]
        if graded:
            first = (even[1] if len(even) > 1 else b) - a
            doublings = int(np.log2(first / _FIRST)) if first > 2.0 * _FIRST else 0
            even = np.concatenate([even[:1], a + first * 0.5 ** np.arange(doublings, 0, -1), even[1:]])
        stretches.append(even)
    return np.concatenate([*stretches, breaks[-1:]])


@compiled
def _trigonometry(angle: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return cosines and sines (n, 3, joints); a step that starts where the one before ended takes those over."""
    steps, _, joints = angle.shape
    cos = np.empty(angle.shape)
    sin = np.empty(angle.shape)
    for step in range(steps):
        for stage in range(3):
            for i in range(joints):
                here = angle[step, stage, i]
                if stage == 0 and step > 0 and here == angle[step - 1, 2, i]:
                    cos[step, 0, i] = cos[step - 1, 2, i]
                    sin[step, 0, i] = sin[step - 1, 2, i]
                else:
                    cos[step, stage, i] = np.cos(here)
                    sin[step, stage, i] = np.sin(here)
    return cos, sin
