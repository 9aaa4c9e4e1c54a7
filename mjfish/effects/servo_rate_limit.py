"""Servos of limited speed."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from mjfish.arrays import FloatArray
from mjfish.compiled import compiled, inlined
from mjfish.data import Dataset
from mjfish.drive.motion import JointMotion
from mjfish.effects.commanded import balanced, cubic, undetectable_behind_measured_joints
from mjfish.effects.effect import Effect, Family, Fingerprint, Values
from mjfish.parameter import Parameter

#: Rate at which a joint behind its command closes in on it, below the limit [1/s]: position loops of servos.
CATCH_UP = 100.0
#: Exponent n of the corner, and the share of the limit below which it is not there, nor above the inverse.
_SHARP, _OFF_CORNER = 256.0, 0.87


class ServoRateLimit(Effect):
    """The joints turn no faster than L = 1 / slowness: they fall behind a faster command and catch up with it.

        theta' = L S((c' + k (c - theta)) / L),  S(x) = x / (1 + |x|^n)^(1/n),  n = 256,  theta(0) = c(0),  k = 100 / s

    with the command c. Below the limit S(x) = x, to 1e-14 at nine tenths of it, so that theta = c; above,
    |theta'| < L. As k and n grow this is the rate limiter with a sharp corner that tracks its command,
    sat(x) = sign(x) min(|x|, 1). The corner is as sharp as the step of the integrator can follow: a rounder one takes
    speed from joints that only come near the limit, which is most of what a limit that is hardly met does.

    Not smooth at the null: joints slower than the limit do not feel it, so that the derivatives there are all zero.
    """

    name: ClassVar[str] = "servo_rate_limit"
    family: ClassVar[Family] = "drive"
    summary: ClassVar[str] = "the servos are too slow for their command"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("servo_rate_limit.slowness", "s/rad", 0.0, 0.0, 0.5, 0.1, 0.03, about="1 / (largest rate)"),
    )
    source: ClassVar[str] = "Rate limiter of an actuator: Fielding and Flux, Aeronautical Journal 107 (2003)"
    signature: ClassVar[str] = (
        "nothing at low frequency; above a frequency the tail swings less and later, as triangles"
    )
    confirm: ClassVar[str] = "log the joint angles on the bench while the command steps, and read the largest rate"
    fingerprint: ClassVar[Fingerprint] = Fingerprint(odd=False, part="everywhere")
    resembles: ClassVar[tuple[str, ...]] = ("stuck-clipped",)
    smooth: ClassVar[bool] = False

    def not_applicable(self, dataset: Dataset) -> str:
        """Measured joint angles leave nothing between command and joint."""
        return undetectable_behind_measured_joints(dataset)

    def drive(self, motion: JointMotion, values: Values) -> JointMotion:
        """Let the joints follow as fast as they may."""
        angle, rate, acceleration = _limited(
            np.diff(motion.time), motion.angle, motion.rate, motion.acceleration, values["slowness"]
        )
        return balanced(motion.time, angle, rate, acceleration)


@inlined
def _corner(x: float) -> float:
    """Return S(x) / x; off the corner without powers, equal to rounding."""
    size = abs(x)
    if size < _OFF_CORNER:
        return 1.0
    if size * _OFF_CORNER > 1.0:
        return float(1.0 / size)
    return float((1.0 + size**_SHARP) ** (-1.0 / _SHARP))


@compiled
def _limited(
    steps: FloatArray, angle: FloatArray, rate: FloatArray, acceleration: FloatArray, slowness: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Integrate e' = theta' - c' for e = theta - c, one Runge-Kutta step a half step, c' as a cubic.

    theta'' = S'(x) (c'' - k e'), x = slowness (c' - k e), S'(x) = (S(x) / x)^(n + 1).
    """
    n, _, joints = angle.shape
    limited = np.empty_like(angle)
    limited_rate = np.empty_like(rate)
    limited_acceleration = np.empty_like(acceleration)
    error = np.zeros(joints)
    for step in range(n):
        d = 0.5 * steps[step]
        for stage in range(3):
            for j in range(joints):
                if stage > 0:
                    a0 = rate[step, stage - 1, j]
                    a1 = acceleration[step, stage - 1, j]
                    a2, a3 = cubic(a0, a1, rate[step, stage, j], acceleration[step, stage, j], d)
                    total = 0.0
                    k = 0.0
                    for part in range(4):
                        s = 0.0 if part == 0 else (d if part == 3 else 0.5 * d)
                        asked = a0 + s * (a1 + s * (a2 + s * a3))
                        wanted = asked - CATCH_UP * (error[j] + s * k)
                        k = wanted * _corner(slowness * wanted) - asked
                        total += k if part == 0 or part == 3 else 2.0 * k
                    error[j] += d / 6.0 * total
                wanted = rate[step, stage, j] - CATCH_UP * error[j]
                x = slowness * wanted
                follow = wanted * _corner(x)
                behind = acceleration[step, stage, j] - CATCH_UP * (follow - rate[step, stage, j])
                limited[step, stage, j] = angle[step, stage, j] + error[j]
                limited_rate[step, stage, j] = follow
                limited_acceleration[step, stage, j] = behind * _corner(x) ** (_SHARP + 1.0)
    return limited, limited_rate, limited_acceleration
