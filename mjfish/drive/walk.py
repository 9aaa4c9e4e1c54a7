"""A clock that walks: what is due at t + w(t) is done at t, w a random walk of the time since the start.

w is the sum of modes of Karhunen and Loeve ([Loeve1978], sec. 37) with random sizes,

    w(t) = sum_m a_m sqrt(2 / T) sin(k_m t) / k_m,   k_m = (m - 1/2) pi / T,   <w(t)^2> = <a^2> t,

T the length of the run. Waves faster than one a second are left out.

[Loeve1978] M. Loeve, Probability Theory II (4th ed.).
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.polynomial.polynomial import polyval

from mjfish.drive.motion import JointMotion, cached
from mjfish.numerics.arrays import FloatArray

#: Modes for every second of a run, at least and at most: a drive has no walk faster than one wave a second.
_RATE, _FEWEST, _MOST = 2.0, 8, 60
#: Newton's steps from the time when something is due to that when it is done.
_INVERTED = 4


def count(length: float) -> int:
    """Return the number of modes of a run of some length [s]."""
    return int(np.clip(_RATE * length, _FEWEST, _MOST))


def walk(
    time: FloatArray, start: float, end: float, sizes: Sequence[float], *, first: int = 0, level: bool = False
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return w at times of any shape [s], its rate and acceleration, as polynomials of exp(i pi t / T).

    Args:
        time: of any shape [s].
        start, end: of the walk [s].
        sizes: a_m [s^0.5].
        first: the mode, counted from 0, of the first of them; those before it are 0.
        level: the line nearest to w is taken off it, where phase and frequency are known of the whole run.
    """
    length, modes = end - start, first + np.arange(len(sizes))
    wave = (modes + 0.5) * np.pi / length
    phase = (np.asarray(time) - start) * (np.pi / length)
    turn, half = np.exp(1j * phase), np.sqrt(2.0 / length) * np.exp((first + 0.5) * 1j * phase)
    ahead, rate, second = (half * polyval(turn, sizes * wave**power) for power in (-1, 0, 1))
    mean = slope = 0.0
    if level:  # INT sin k t dt = 1 / k, INT t sin k t dt = (-1)^m / k^2 from 0 to T
        weights = np.sqrt(2.0 / length) * np.asarray(sizes) / wave**2
        mean = float(np.sum(weights)) / length
        slope = 12.0 / length**3 * (float(weights @ ((-1.0) ** modes / wave)) - 0.5 * length**2 * mean)
    line = mean + slope * (np.asarray(time) - 0.5 * (start + end))
    return ahead.imag - line, rate.real - slope, -second.imag


@dataclass(frozen=True, eq=False)
class _Clock:
    """Steps of a motion by a clock that walks.

    Attributes:
        time: (n + 1,) their boundaries [s].
        share: (n, 1) of a step that is due in its middle.
        speed: (n, 3, 1) of the clock, 1 + w'.
        second: (n, 3, 1) w'' [1/s].
    """

    time: FloatArray
    share: FloatArray
    speed: FloatArray
    second: FloatArray


@functools.lru_cache(maxsize=128)
def _clock(boundaries: bytes, sizes: tuple[float, ...], level: bool) -> _Clock:
    """Return the steps that begin where those with other boundaries [s] are due."""
    due = np.frombuffer(boundaries)
    start, end, when = float(due[0]), float(due[-1]), due
    for _ in range(_INVERTED):
        ahead, rate, _ = walk(when, start, end, sizes, level=level)
        when = when - (when + ahead - due) / (1.0 + rate)
    stages = np.stack([when[:-1], 0.5 * (when[:-1] + when[1:]), when[1:]], axis=1)
    ahead, rate, second = walk(stages, start, end, sizes, level=level)
    share = (stages[:, 1] + ahead[:, 1] - due[:-1]) / np.diff(due)
    return _Clock(when, share[:, None], 1.0 + rate[..., None], second[..., None])


@cached(0.1e9)
def walked(motion: JointMotion, sizes: tuple[float, ...], *, level: bool = False) -> JointMotion:
    """Return a motion by a clock that walks from its start to its end, with sizes a_m [s^0.5]; as it is without any.

    Its steps begin where those of the motion are due, so that rates jump between steps as they did.
    """
    if not sizes:
        return motion
    clock = _clock(motion.time.tobytes(), sizes, level)
    late, width = clock.share - 0.5, np.diff(motion.time)[:, None]
    angle, rate, second = (part.copy() for part in (motion.angle, motion.rate, motion.acceleration))
    angle[:, 1] += motion.rate[:, 1] * late * width
    rate[:, 1] += motion.acceleration[:, 1] * late * width
    second[:, 1] += (motion.acceleration[:, 2] - motion.acceleration[:, 0]) * late
    return JointMotion(clock.time, angle, rate * clock.speed, second * clock.speed**2 + rate * clock.second)


def along_mode(due: JointMotion, sizes: tuple[float, ...], mode: int, *, level: bool = False) -> FloatArray:
    """Return rates of angle, rate and acceleration (3, n, 3, joints) of `walked` by a mode, at its times.

    With g = theta' / (1 + w'), by how much an angle moves as the clock goes on, they are (g e, (g e)', (g e)'') of the
    mode e. A step of the drive comes later, too; that part is left out.
    """
    motion, clock = walked(due, sizes, level=level), _clock(due.time.tobytes(), sizes, level)
    start, end, time = float(due.time[0]), float(due.time[-1]), motion.time
    stages = np.stack([time[:-1], 0.5 * (time[:-1] + time[1:]), time[1:]], axis=1)
    e, slope, bend = (part[..., None] for part in walk(stages, start, end, (1.0,), first=mode, level=level))
    g = motion.rate / clock.speed
    turn = (motion.acceleration - g * clock.second) / clock.speed
    third = np.gradient(turn, axis=1, edge_order=2) / (0.5 * np.diff(time)[:, None, None])
    return np.stack([g * e, turn * e + g * slope, third * e + 2.0 * turn * slope + g * bend])
