"""What the causes of domain ``drive`` have in common: they stand between the command and the joints."""

from __future__ import annotations

import numpy as np

from mjfish.drive.motion import JointMotion
from mjfish.numerics.arrays import FloatArray
from mjfish.numerics.compiled import compiled, merged

#: Rate at which a joint behind its command closes in on it, below the limit [1/s]: position loops of servos.
CATCH_UP = 100.0
#: Exponent n of the corner, and the share of the limit below which it is not there, nor above the inverse.
_SHARP, _OFF_CORNER = 256.0, 0.87
#: Longest Runge-Kutta step of a rate limit, in units of 1 / k: well inside its stability.
_STABLE = 1.0
#: Shortest time constant of a filter of second order [s].
SHORTEST = 1e-3


def balanced(time: FloatArray, angle: FloatArray, rate: FloatArray, acceleration: FloatArray) -> JointMotion:
    """Return a joint motion whose rates and accelerations in mid-step carry what happens between the nodes.

    A joint that meets a flank or a limit changes its rate within a few milliseconds, at any time within a step. By
    Simpson's rule, which a Runge-Kutta step of a known input is, the integral of the acceleration must be the change of
    rate, and that of the rate the change of angle; else the head gets a wrong impulse. Solved for the values in the
    middle: f_1 = (6 INT f dt / h - f_0 - f_2) / 4.

    Args:
        time: (n + 1,) boundaries of the steps [s].
        angle, rate, acceleration: (n, 3, joints); those in mid-step of rate and acceleration are replaced.
    """
    steps = np.diff(time)[:, None]
    rate, acceleration = rate.copy(), acceleration.copy()
    acceleration[:, 1] = 1.5 * (rate[:, 2] - rate[:, 0]) / steps - 0.25 * (acceleration[:, 0] + acceleration[:, 2])
    rate[:, 1] = 1.5 * (angle[:, 2] - angle[:, 0]) / steps - 0.25 * (rate[:, 0] + rate[:, 2])
    return JointMotion(time=time, angle=angle, rate=rate, acceleration=acceleration)


def curved(motion: JointMotion, angle: FloatArray, slope: FloatArray, curvature: FloatArray) -> JointMotion:
    """Return the motion of joints whose angle theta is a function of the command c; theta = c is `motion` itself.

        theta' = slope c',   theta'' = slope c'' + curvature c'^2

    Args:
        motion: the command c.
        angle, slope, curvature: (n, 3, joints) theta and its first two derivatives by c.
    """
    bend = curvature * motion.rate**2
    off = balanced(
        motion.time, angle - motion.angle, (slope - 1.0) * motion.rate, (slope - 1.0) * motion.acceleration + bend
    )
    return JointMotion(
        motion.time, motion.angle + off.angle, motion.rate + off.rate, motion.acceleration + off.acceleration
    )


@merged
def cubic(left: float, slope: float, right: float, slope_right: float, d: float) -> tuple[float, float]:
    """Return a_2, a_3 of the cubic left + slope s + a_2 s^2 + a_3 s^3 through values and slopes at 0 and d."""
    rise = (right - left - slope * d) / (d * d)
    bend = (slope_right - slope) / d
    return 3.0 * rise - bend, (bend - 2.0 * rise) / d


@merged
def _corner(x: float) -> float:
    """Return S(x) / x; off the corner without powers, equal to rounding."""
    size = abs(x)
    if size < _OFF_CORNER:
        return 1.0
    if size * _OFF_CORNER > 1.0:
        return float(1.0 / size)
    return float((1.0 + size**_SHARP) ** (-1.0 / _SHARP))


def limited(motion: JointMotion, slowness: float, catch_up: float = CATCH_UP, forward: float = 1.0) -> JointMotion:
    """Return the motion behind a rate limit, theta' = L sat((f c' - k (theta - c)) / L) from theta(0) = c(0) on.

    Args:
        motion: that is asked for, c.
        slowness: 1 / L [s/rad].
        catch_up: k [1/s].
        forward: f; 1: the joints follow the rate of the command, 0: they close in on its angle.
    """
    angle, rate, acceleration = _limited(
        np.diff(motion.time), motion.angle, motion.rate, motion.acceleration, slowness, catch_up, forward
    )
    return balanced(motion.time, angle, rate, acceleration)


@compiled
def _limited(
    steps: FloatArray,
    angle: FloatArray,
    rate: FloatArray,
    acceleration: FloatArray,
    slowness: float,
    catch_up: float,
    forward: float,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Integrate e' = theta' - c' for e = theta - c by Runge-Kutta steps, one a half step or more, c' as a cubic.

    theta'' = S'(x) (f c'' - k e'), x = slowness (f c' - k e), S'(x) = (S(x) / x)^(n + 1).
    """
    n, _, joints = angle.shape
    limited = np.empty_like(angle)
    limited_rate = np.empty_like(rate)
    limited_acceleration = np.empty_like(acceleration)
    error = np.zeros(joints)
    for step in range(n):
        d = 0.5 * steps[step]
        parts = max(int(np.ceil(d * catch_up / _STABLE)), 1)
        h = d / parts
        for stage in range(3):
            for j in range(joints):
                if stage > 0:
                    a0 = rate[step, stage - 1, j]
                    a1 = acceleration[step, stage - 1, j]
                    a2, a3 = cubic(a0, a1, rate[step, stage, j], acceleration[step, stage, j], d)
                    for part in range(parts):
                        total = 0.0
                        k = 0.0
                        for quarter in range(4):
                            ahead = 0.0 if quarter == 0 else (h if quarter == 3 else 0.5 * h)
                            s = part * h + ahead
                            asked = a0 + s * (a1 + s * (a2 + s * a3))
                            wanted = forward * asked - catch_up * (error[j] + ahead * k)
                            k = wanted * _corner(slowness * wanted) - asked
                            total += k if quarter == 0 or quarter == 3 else 2.0 * k
                        error[j] += h / 6.0 * total
                wanted = forward * rate[step, stage, j] - catch_up * error[j]
                x = slowness * wanted
                follow = wanted * _corner(x)
                behind = forward * acceleration[step, stage, j] - catch_up * (follow - rate[step, stage, j])
                limited[step, stage, j] = angle[step, stage, j] + error[j]
                limited_rate[step, stage, j] = follow
                limited_acceleration[step, stage, j] = behind * _corner(x) ** (_SHARP + 1.0)
    return limited, limited_rate, limited_acceleration


def filtered(motion: JointMotion, time: float, damping: float, delay: float = 0.0) -> JointMotion:
    """Return the motion behind a dead time and a filter of second order, whose output starts at rest.

        T^2 theta'' + 2 zeta T theta' + theta = c(t - delay),   c at rest before,   theta(0) = c(0), theta'(0) = 0

    Args:
        motion: that is asked for, c.
        time: T [s]; not below `SHORTEST`.
        damping: zeta.
        delay: dead time [s].
    """
    nodes, angle, rate = motion.half_steps()
    edges = np.stack([motion.time[:-1], 0.5 * (motion.time[:-1] + motion.time[1:]), motion.time[1:]], axis=1)
    got = np.empty((3, *motion.angle.shape))
    _filter(edges, nodes, angle, rate, max(time, SHORTEST), damping, delay, got)
    return balanced(motion.time, got[0], got[1], got[2])


@merged
def _decay(t: float, time: float, damping: float) -> tuple[float, float]:
    """Return E C and E S of the free filter, E = exp(-zeta t / T), with w^2 = (1 - zeta^2) / T^2.

    C = cos w t, S = sin(w t) / w; where zeta > 1, cosh and sinh.
    """
    a = damping / time
    square = (1.0 - damping * damping) / (time * time)
    if abs(square) * t * t < 1e-8:
        decay = np.exp(-a * t)
        return decay, decay * t
    w = np.sqrt(abs(square))
    if square > 0.0:
        decay = np.exp(-a * t)
        return decay * np.cos(w * t), decay * np.sin(w * t) / w
    slow, fast = np.exp((w - a) * t), np.exp(-(w + a) * t)
    return 0.5 * (slow + fast), 0.5 * (slow - fast) / w


@compiled
def _filter(
    edges: FloatArray,
    nodes: FloatArray,
    angle: FloatArray,
    rate: FloatArray,
    time: float,
    damping: float,
    delay: float,
    out: FloatArray,
) -> None:
    """Solve the filter exactly, its input cubic in every half step; write angle, rate, acceleration (3, n, 3, joints).

    Behind a cubic c the filter's own motion is sum_k g_k c^(k), with 1 / (1 + 2 zeta T D + T^2 D^2) = sum_k g_k D^k;
    what differs from it decays freely.
    """
    joints, last = angle.shape[2], nodes.shape[0] - 2
    here, turn = angle[0, 0].copy(), np.zeros(joints)
    stiffness, friction = 1.0 / (time * time), 2.0 * damping / time
    g1 = -2.0 * damping * time
    g2 = -2.0 * damping * time * g1 - time * time
    g3 = -2.0 * damping * time * g2 - time * time * g1
    k = 0
    for step in range(edges.shape[0]):
        for stage in range(3):
            end = edges[step, stage]
            now = edges[step, max(stage - 1, 0)]
            while now < end:
                at = now - delay
                resting = at < nodes[0] - 1e-12
                while not resting and k < last and nodes[k + 1] <= at + 1e-12:
                    k += 1
                until = end if not resting and k == last else min(end, (nodes[0] if resting else nodes[k + 1]) + delay)
                t = until - now
                c, s = _decay(t, time, damping)
                width = nodes[k + 1] - nodes[k]
                x = at - nodes[k]
                for j in range(joints):
                    c0, c1, c2, c3 = angle[0, 0, j], 0.0, 0.0, 0.0
                    if not resting:
                        left = rate[k, 0, j]
                        b2, c3 = cubic(angle[k, 0, j], left, angle[k, 1, j], rate[k, 1, j], width)
                        c0 = angle[k, 0, j] + x * (left + x * (b2 + x * c3))
                        c1 = left + x * (2.0 * b2 + 3.0 * c3 * x)
                        c2 = b2 + 3.0 * c3 * x
                    p0 = c0 + g1 * c1 + 2.0 * g2 * c2 + 6.0 * g3 * c3
                    p1 = c1 + 2.0 * g1 * c2 + 6.0 * g2 * c3
                    p2 = c2 + 3.0 * g1 * c3
                    y, v = here[j] - p0, turn[j] - p1
                    a = damping / time
                    here[j] = p0 + t * (p1 + t * (p2 + t * c3)) + (c + a * s) * y + s * v
                    turn[j] = p1 + t * (2.0 * p2 + 3.0 * t * c3) + (c - a * s) * v - stiffness * s * y
                now = until
            at = end - delay
            for j in range(joints):
                asked = angle[0, 0, j]
                if at > nodes[0]:
                    while k < last and nodes[k + 1] <= at:
                        k += 1
                    x = at - nodes[k]
                    left = rate[k, 0, j]
                    b2, c3 = cubic(angle[k, 0, j], left, angle[k, 1, j], rate[k, 1, j], nodes[k + 1] - nodes[k])
                    asked = angle[k, 0, j] + x * (left + x * (b2 + x * c3))
                out[0, step, stage, j] = here[j]
                out[1, step, stage, j] = turn[j]
                out[2, step, stage, j] = stiffness * (asked - here[j]) - friction * turn[j]
