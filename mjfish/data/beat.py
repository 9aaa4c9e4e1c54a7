"""How many beats of the body measured joint angles contain."""

from __future__ import annotations

import numpy as np

from mjfish.arrays import FloatArray

#: Joints that move less than this do not beat [rad].
_STILL = 1e-6
#: Beats that a periodogram tells apart from a drift; below it, sinusoids are fitted.
_RESOLVED = 3
_STEP = 0.05


def count(time: FloatArray, angle: FloatArray) -> float | None:
    """Return the number of beats: the dominant frequency of the joint angles times the duration.

    With three beats or more that is the largest line of the periodogram of all joints, their linear drift removed.
    With fewer, a line of the periodogram cannot be told from a drift: there it is the frequency at which the least
    squares fit of mean, drift and one sinusoid leaves the smallest residual.

    Args:
        time: (n,) increasing, n > 6 [s].
        angle: (n, joints) [rad].

    Returns:
        The number of beats, or None where the joints are still.
    """
    share = (time - time[0]) / (time[-1] - time[0])
    drift = np.stack([np.ones_like(share), share], axis=1)
    rest = _residual(drift, angle)
    if np.ptp(rest, axis=0).max() < _STILL:
        return None
    lines = np.square(np.abs(np.fft.rfft(rest, axis=0))).sum(axis=1)
    strongest = int(np.argmax(lines))
    if strongest >= _RESOLVED:
        return float(strongest)
    beats = np.arange(2 * _STEP, _RESOLVED + 1, _STEP)
    left = [np.square(_residual(_with_sinusoid(drift, share, turns), angle)).sum() for turns in beats]
    return float(beats[int(np.argmin(left))])


def _with_sinusoid(drift: FloatArray, share: FloatArray, turns: float) -> FloatArray:
    phase = 2.0 * np.pi * turns * share
    return np.column_stack([drift, np.cos(phase), np.sin(phase)])


def _residual(design: FloatArray, signal: FloatArray) -> FloatArray:
    return np.asarray(signal - design @ np.linalg.lstsq(design, signal)[0], dtype=np.float64)
