"""What the causes of domain ``drive`` have in common: they stand between the command and the joints."""

from __future__ import annotations

import numpy as np

from mjfish.arrays import FloatArray
from mjfish.compiled import compiled, inlined
from mjfish.data import Dataset
from mjfish.drive.motion import JointMotion

#: Rate at which a joint behind its command closes in on it, below the limit [1/s]: position loops of servos.
_CATCH_UP = 100.0
#: Exponent n of the corner, and the share of the limit below which it is not there, nor above the inverse.
_SHARP, _OFF_CORNER = 256.0, 0.87
#: Shortest time constant of a filter of second order [s], and what of it, or of the catching up, a step may last.
SHORTEST = 1e-3
_SHARE = 0.25


def undetectable_behind_measured_joints(dataset: Dataset) -> str:
    """Say why no servo can be detected, where every trial has measured joint angles."""
    if all(trial.joint_angle is not None for trial in dataset.trials):
        return "the joint angles were measured, so no servo stands between them and the model"
    return ""


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


@inlined
def cubic(left: float, slope: float, right: float, slope_right: float, d: float) -> tuple[float, float]:
    """Return a_2, a_3 of the cubic left + slope s + a_2 s^2 + a_3 s^3 through values and slopes at 0 and d."""
    rise = (right - left - slope * d) / (d * d)
    bend = (slope_right - slope) / d
    return 3.0 * rise - bend, (bend - 2.0 * rise) / d


@inlined
def _corner(x: float) -> float:
    """Return S(x) / x; off the corner without powers, equal to rounding."""
    size = abs(x)
    if size < _OFF_CORNER:
        return 1.0
    if size * _OFF_CORNER > 1.0:
        return float(1.0 / size)
    return float((1.0 + size**_SHARP) ** (-1.0 / _SHARP))


def limited(motion: JointMotion, slowness: float) -> JointMotion:
    """Return the motion behind a rate limit of 1 / slowness, see `mjfish.effects.servo_rate_limit.ServoRateLimit`."""
    angle, rate, acceleration = _limited(np.diff(motion.time), motion.angle, motion.rate, motion.acceleration, slowness)
    return balanced(motion.time, angle, rate, acceleration)


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
                        wanted = asked - _CATCH_UP * (error[j] + s * k)
                        k = wanted * _corner(slowness * wanted) - asked
                        total += k if part == 0 or part == 3 else 2.0 * k
                    error[j] += d / 6.0 * total
                wanted = rate[step, stage, j] - _CATCH_UP * error[j]
                x = slowness * wanted
                follow = wanted * _corner(x)
                behind = acceleration[step, stage, j] - _CATCH_UP * (follow - rate[step, stage, j])
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


@inlined
def _asked(at: float, k: int, j: int, nodes: FloatArray, angle: FloatArray, rate: FloatArray) -> float:
    """Return the angle of joint j at a time within half step k, by the cubic; at rest before the first."""
    if at <= nodes[0]:
        return float(angle[0, 0, j])
    width = nodes[k + 1] - nodes[k]
    s = (at - nodes[k]) / width
    rise = angle[k, 1, j] - angle[k, 0, j]
    left, right = rate[k, 0, j] * width, rate[k, 1, j] * width
    return float(angle[k, 0, j] + s * (left + s * (3.0 * rise - 2.0 * left - right + s * (left + right - 2.0 * rise))))


@inlined
def _half_step(at: float, k: int, nodes: FloatArray) -> int:
    """Return the half step that a time is in, from one that it is near."""
    while k + 2 < nodes.shape[0] and nodes[k + 1] <= at:
        k += 1
    while k > 0 and nodes[k] > at:
        k -= 1
    return k


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
    """Integrate theta and theta' by Runge-Kutta steps; write angle, rate, acceleration (3, n, 3, joints)."""
    joints = angle.shape[2]
    here, turn = angle[0, 0].copy(), np.zeros(joints)
    stiffness, friction = 1.0 / (time * time), 2.0 * damping / time
    fastest = max(1.0, 2.0 * damping) / time
    k = 0
    for step in range(edges.shape[0]):
        for stage in range(3):
            begun = edges[step, max(stage - 1, 0)]
            d = edges[step, stage] - begun
            parts = int(np.ceil(d * fastest / _SHARE))
            h = d / max(parts, 1)
            for part in range(parts):
                for j in range(joints):
                    x, w, x0, w0 = 0.0, 0.0, 0.0, 0.0
                    for inner in range(4):
                        ahead = 0.0 if inner == 0 else (h if inner == 3 else 0.5 * h)
                        at = begun + part * h + ahead - delay
                        k = _half_step(at, k, nodes)
                        theta, omega = here[j] + ahead * x0, turn[j] + ahead * w0
                        x0, w0 = omega, stiffness * (_asked(at, k, j, nodes, angle, rate) - theta) - friction * omega
                        weight = 1.0 if inner == 0 or inner == 3 else 2.0
                        x += weight * x0
                        w += weight * w0
                    here[j] += h / 6.0 * x
                    turn[j] += h / 6.0 * w
            at = edges[step, stage] - delay
            k = _half_step(at, k, nodes)
            for j in range(joints):
                asked = _asked(at, k, j, nodes, angle, rate)
                out[0, step, stage, j] = here[j]
                out[1, step, stage, j] = turn[j]
                out[2, step, stage, j] = stiffness * (asked - here[j]) - friction * turn[j]
