"""Joint motions given in closed form, so that no error of an oscillator or a spline is in the way."""

from __future__ import annotations

import numpy as np

from mjfish.drive.motion import JointMotion
from mjfish.numerics.arrays import FloatArray

LAGS = np.array([0.0, 1.2, 2.4, 3.6])
AMPLITUDES = np.array([0.15, 0.25, 0.35, 0.45])


def stages(time: FloatArray) -> FloatArray:
    """Return start, middle and end of every step (n, 3)."""
    return np.stack([time[:-1], 0.5 * (time[:-1] + time[1:]), time[1:]], axis=1)


def waving(
    duration: float, steps: int, frequency: float = 1.5, bias: FloatArray | None = None, sign: float = 1.0
) -> JointMotion:
    """Return a travelling wave, theta_i = bias_i + A_i sin(2 pi f t - lag_i), with exact rate and acceleration."""
    time = np.linspace(0.0, duration, steps + 1)
    pulse = 2.0 * np.pi * frequency
    phase = pulse * stages(time)[:, :, None] - LAGS
    angle = AMPLITUDES * np.sin(phase) + (0.0 if bias is None else bias)
    rate = AMPLITUDES * pulse * np.cos(phase)
    acceleration = -AMPLITUDES * pulse**2 * np.sin(phase)
    return JointMotion(time, sign * angle, sign * rate, sign * acceleration)


def still(duration: float, steps: int, angle: tuple[float, ...] = (0.3, 0.2, -0.4, 0.5)) -> JointMotion:
    """Return joints held at `angle`."""
    time = np.linspace(0.0, duration, steps + 1)
    held = np.broadcast_to(np.array(angle), (steps, 3, len(angle)))
    return JointMotion(time, held, np.zeros_like(held), np.zeros_like(held))
