"""Play between the servos and the joints."""

from __future__ import annotations

import numpy as np

from mjfish.drive.motion import JointMotion
from mjfish.effects.commanded import balanced
from mjfish.effects.effect import Effect, Fingerprint, Values, each_joint, variant
from mjfish.fish import Fish
from mjfish.numerics.arrays import FloatArray
from mjfish.numerics.compiled import compiled, merged
from mjfish.parameters import Parameter

#: Parts of each half step of the drive, in which the play is straight.
_PARTS = 2

_PLAY = Parameter("servo_backlash.joint", "rad", 0.0, 0.0, 0.3, 0.02, 0.02, about="width of the gap of joint")
_CONTACT = Parameter(
    "servo_backlash.contact", "s", 0.003, 0.0002, 0.02, 0.003, 0.002, about="how long a flank gives", shape=True
)


class ServoBacklash(Effect):
    """The gears have play of the total width w: when the command reverses, the joint waits until the gap is crossed.

    The play operator holds p within half a width of the command c, p(t) = max(c - w/2, min(c + w/2, p(t-))), and
    starts in the middle of the gap. Its rate jumps where a flank is met. Gears and horns give a little: what the play
    takes off, d = p - c, comes out through a critically damped second-order lag of time constant T,

        theta = c + x,  T^2 x'' + 2 T x' + x = d,  x(0) = x'(0) = 0,

    so that rate and acceleration are continuous where those of the command are. With w = 0 both d and x are zero. How
    hard gears meet is not known beforehand: T is a shape. It matters where the play is small, for the joint then spends
    less time in the gap than on its flank. Gears wear one by one: every joint has a width of its own, and `for_fish`
    has as many as the fish.

    Not smooth at the null: at first order in w, d is half a width times the sign of the command's rate.
    """

    name, domain, mechanism = "servo_backlash", "drive", "servo_play"
    summary = "the gears of the servos have play"
    parameters = (*each_joint(_PLAY, 4), _CONTACT)
    source = (
        "Play operator: Visintin, Differential Models of Hysteresis (1994), ch. III; Nordin and Gutman, Automatica 38 "
        "(2002)"
    )
    signature = "the joints are late by an angle, not by a time, and swing less by the width of the gap"
    confirm = "hold the servo and rock the joint by hand; the free angle is the play"
    fingerprint = Fingerprint(exponent=0.0, odd=False, part="everywhere")
    smooth = False

    @classmethod
    def for_fish(cls, fish: Fish) -> Effect:
        """Return the effect with a width for every joint of the fish."""
        return variant(ServoBacklash, parameters=(*each_joint(_PLAY, fish.joints), _CONTACT))

    def drive(self, motion: JointMotion, values: Values) -> JointMotion:
        """Take the play off the command."""
        plays = np.array([values[f"joint_{j + 1}"] for j in range(motion.joints)])
        angle, rate, acceleration = _played(np.diff(motion.time), motion.angle, motion.rate, plays, values["contact"])
        return balanced(motion.time, motion.angle + angle, motion.rate + rate, motion.acceleration + acceleration)


@merged
def _advance(x: FloatArray, start: float, end: float, h: float, contact: float) -> None:
    """Advance (x, x') in `x` by h [s], exactly, while d goes straight from `start` to `end`.

    x(s) = d(s) - 2 T m + (A + B s) exp(-s / T),  A = x_0 - d_0 + 2 T m,  B = x_0' - m + A / T,  m the slope of d.
    """
    if h > 0.0:
        slope = (end - start) / h
        a = x[0] - start + 2.0 * contact * slope
        b = x[1] - slope + a / contact
        decay = np.exp(-h / contact)
        x[0] = end - 2.0 * contact * slope + (a + b * h) * decay
        x[1] = slope + (b - (a + b * h) / contact) * decay


@compiled
def _played(
    steps: FloatArray, angle: FloatArray, rate: FloatArray, plays: FloatArray, contact: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return x, x', x'' (n, 3, joints); in each part of a half step the command is straight, so a flank has a time."""
    n, _, joints = angle.shape
    x = np.empty_like(angle)
    x_rate = np.empty_like(angle)
    x_acceleration = np.empty_like(angle)
    off = np.zeros(joints)  # d
    lagged = np.zeros((joints, 2))
    for step in range(n):
        d = 0.5 * steps[step]
        for stage in range(3):
            for j in range(joints):
                if stage > 0:
                    left, right = angle[step, stage - 1, j], angle[step, stage, j]
                    down, up = d * rate[step, stage - 1, j], d * rate[step, stage, j]
                    before = left
                    for part in range(1, _PARTS + 1):
                        s = part / _PARTS
                        here = (1.0 + 2.0 * s) * (1.0 - s) ** 2 * left + s * (1.0 - s) ** 2 * down
                        here += s * s * (3.0 - 2.0 * s) * right + s * s * (s - 1.0) * up
                        free = off[j] + before - here
                        held = max(-0.5 * plays[j], min(0.5 * plays[j], free))
                        crossing = d / _PARTS if free == held else d / _PARTS * (held - off[j]) / (free - off[j])
                        _advance(lagged[j], off[j], held, crossing, contact)
                        _advance(lagged[j], held, held, d / _PARTS - crossing, contact)
                        off[j] = held
                        before = here
                x[step, stage, j] = lagged[j, 0]
                x_rate[step, stage, j] = lagged[j, 1]
                x_acceleration[step, stage, j] = (off[j] - lagged[j, 0] - 2.0 * contact * lagged[j, 1]) / contact**2
    return x, x_rate, x_acceleration
