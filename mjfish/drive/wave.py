"""A wave as a drive: the joint law of firmware that sends every joint a sinusoid.

    theta_j = r(t) [bias_j + A_j sin(2 pi f t + phi_j)]

r rises from 0 to 1 over the ramp as 10 s^3 - 15 s^4 + 6 s^5 with s = t / ramp, which starts and ends without a step of
rate or acceleration; without a ramp r = 1, and the fish is swimming when the record begins.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mjfish.drive.motion import JointMotion, cached, grid
from mjfish.errors import InputError
from mjfish.numerics.arrays import FloatArray

#: A ramp that is shorter is none [s].
_SUDDEN = 1e-6


@dataclass(frozen=True)
class Wave:
    """A sinusoid for every joint.

    Attributes:
        frequency: f [Hz].
        amplitude: A_j [rad], one a joint.
        phase: phi_j [rad], one a joint.
        bias: [rad], one a joint.
        ramp: [s]; 0 where the fish swims when the record begins.
        free: whether frequency and phase are known only roughly, because drive and camera have no common clock.
    """

    frequency: float
    amplitude: tuple[float, ...]
    phase: tuple[float, ...]
    bias: tuple[float, ...]
    ramp: float = 0.0
    free: bool = False

    @property
    def joints(self) -> int:
        """Number of joints."""
        return len(self.amplitude)

    def moved(self, *, frequency: float = 0.0, phase: float = 0.0, scale: float = 1.0) -> Wave:
        """Return the wave with a frequency [Hz] and a phase of all joints [rad] so much higher, its angles scaled."""
        return Wave(
            frequency=self.frequency + frequency,
            amplitude=tuple(scale * own for own in self.amplitude),
            phase=tuple(own + phase for own in self.phase),
            bias=tuple(scale * own for own in self.bias),
            ramp=self.ramp,
            free=self.free,
        )


def travelling(lengths: Sequence[float]) -> Wave:
    """Return a wave that any fish swims by: once a second from head to tail, one wave on the body, widest at the tail.

    Args:
        lengths: of the links, nose first [m].
    """
    place = np.cumsum(lengths)[:-1] / np.sum(lengths)  # of the joints, 0 at the nose
    amplitude = 0.35 * place / place[-1]
    return Wave(1.0, tuple(amplitude), tuple(-2.0 * np.pi * place), (0.0,) * len(place), ramp=1.0)


@cached(0.1e9)
def joint_motion(wave: Wave, start: float, end: float, step: float) -> JointMotion:
    """Sample the joint motion on the half-step grid, rates and accelerations exactly.

    Args:
        wave: the law.
        start, end: [s]; a wave with a ramp starts at 0.
        step: longest integration step [s].

    Raises:
        InputError: amplitudes, phases and biases are not one a joint.
    """
    if not len(wave.amplitude) == len(wave.phase) == len(wave.bias):
        raise InputError(
            f"a wave has {len(wave.amplitude)} amplitudes, {len(wave.phase)} phases and {len(wave.bias)} biases, "
            "expected one of each a joint"
        )
    boundaries = grid(np.array([start, *([wave.ramp] if start < wave.ramp < end else []), end]), step)
    stages = np.stack([boundaries[:-1], 0.5 * (boundaries[:-1] + boundaries[1:]), boundaries[1:]], axis=1)
    omega = 2.0 * np.pi * wave.frequency
    phase = omega * stages[..., None] + np.array(wave.phase)
    amplitude = np.array(wave.amplitude)
    swing = np.array(wave.bias) + amplitude * np.sin(phase)
    swing_rate = omega * amplitude * np.cos(phase)
    swing_second = -(omega**2) * amplitude * np.sin(phase)
    r, r_rate, r_second = (part[..., None] for part in _ramp(stages, wave.ramp))
    return JointMotion(
        time=boundaries,
        angle=r * swing,
        rate=r_rate * swing + r * swing_rate,
        acceleration=r_second * swing + 2.0 * r_rate * swing_rate + r * swing_second,
    )


def _ramp(time: FloatArray, length: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return r, r' [1/s], r'' [1/s2] at times of any shape."""
    if length <= _SUDDEN:
        return np.ones_like(time), np.zeros_like(time), np.zeros_like(time)
    s = np.clip(time / length, 0.0, 1.0)
    value = s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
    rate = 30.0 * s**2 * (1.0 - s) ** 2 / length
    return value, rate, 60.0 * s * (1.0 - s) * (1.0 - 2.0 * s) / length**2
