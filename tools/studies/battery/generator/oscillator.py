"""The CPG once more: eq. (20) of [Yu2016] by the 3/8 rule of Runge and Kutta, half a step at a time.

Angles and rates only: the momentum form of the swimmer asks for no accelerations.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np

from mjfish.drive.cpg import DriveSegment
from mjfish.fish import Cpg
from mjfish.numerics.arrays import FloatArray
from studies.battery.generator.compiled import compiled


@dataclass(frozen=True, eq=False)
class Stretch:
    """Joint motion between two changes of the drive, at start, middle and end of every step.

    Attributes:
        start: [s].
        step: [s].
        angle, rate: (steps, 3, joints) [rad, rad/s].
    """

    start: float
    step: float
    angle: FloatArray
    rate: FloatArray

    @property
    def steps(self) -> int:
        """Number of steps."""
        return len(self.angle)


@functools.lru_cache(maxsize=64)
def command(cpg: Cpg, segments: tuple[DriveSegment, ...], duration: float, step: float) -> tuple[Stretch, ...]:
    """Return what the CPG asks of the joints, one stretch a segment."""
    joints = len(cpg.amplitude)
    state = np.concatenate([np.full(joints, 0.1), np.array(segments[0].bias)])
    ends = [*(s.start for s in segments[1:]), np.inf]
    stretches = []
    for segment, end in zip(segments, ends, strict=True):
        length = min(end, duration) - segment.start
        if length <= 1e-12:
            break
        steps = max(int(np.ceil(length / step - 1e-9)), 1)
        psi, rate = np.empty((steps, 3, joints)), np.empty((steps, 3, joints))
        amplitude, bias = np.array(cpg.amplitude), np.array(segment.bias)
        _run(state, length / steps, segment.omega, bias, amplitude, cpg.h1, cpg.h2, cpg.phase, psi, rate)
        gain = cpg.beta * cpg.unit
        stretches.append(Stretch(segment.start, length / steps, gain * psi, gain * rate))
    return tuple(stretches)


@compiled
def _run(state, h, omega, bias, amplitude, h1, h2, phase, psi, rate):  # type: ignore[no-untyped-def]
    """Advance `state` (zeta, psi) over all steps; write psi and its rate at start, middle, end of each."""
    joints = bias.shape[0]
    k = np.empty((4, 2 * joints))
    trial = np.empty(2 * joints)
    d = 0.5 * h
    for n in range(psi.shape[0]):
        for node in range(3):
            if node > 0:
                for i in range(2 * joints):
                    trial[i] = state[i] + d / 3.0 * k[0, i]
                _rates(trial, omega, bias, amplitude, h1, h2, phase, k[1])
                for i in range(2 * joints):
                    trial[i] = state[i] + d * (k[1, i] - k[0, i] / 3.0)
                _rates(trial, omega, bias, amplitude, h1, h2, phase, k[2])
                for i in range(2 * joints):
                    trial[i] = state[i] + d * (k[0, i] - k[1, i] + k[2, i])
                _rates(trial, omega, bias, amplitude, h1, h2, phase, k[3])
                for i in range(2 * joints):
                    state[i] += d / 8.0 * (k[0, i] + 3.0 * k[1, i] + 3.0 * k[2, i] + k[3, i])
            _rates(state, omega, bias, amplitude, h1, h2, phase, k[0])
            for i in range(joints):
                psi[n, node, i] = state[joints + i]
                rate[n, node, i] = k[0, joints + i]


@compiled
def _rates(state, omega, bias, amplitude, h1, h2, phase, out):  # type: ignore[no-untyped-def]
    joints = bias.shape[0]
    c = np.cos(phase)
    s = np.sin(phase)
    for i in range(joints):
        z = state[i]
        d = state[joints + i] - bias[i]
        growth = amplitude[i] - z * z - d * d
        out[i] = z * growth - omega * d
        out[joints + i] = d * growth + omega * z
        if i > 0:
            out[i] += h1 * (state[i - 1] * c + (state[joints + i - 1] - bias[i - 1]) * s)
        if i < joints - 1:
            out[joints + i] += h2 * (state[i + 1] * s + (state[joints + i + 1] - bias[i + 1]) * c)
