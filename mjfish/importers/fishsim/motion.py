"""Beat, smoothing, velocities and their noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.signal import savgol_coeffs, savgol_filter

from mjfish import frames
from mjfish.arrays import FloatArray
from mjfish.importers.fishsim.head import HeadTrack, nose_covariance
from mjfish.importers.fishsim.markers import RATE

#: Local polynomials of fifth order: flat up to the third harmonic, and a narrower band than a cubic of equal bias.
_ORDER = 5
#: Least gain of the derivative at the third harmonic of the beat.
_GAIN = 0.97
_WINDOWS = range(9, 91, 2)
#: Frequencies among which the beat is searched [Hz].
_SLOWEST, _FASTEST = 0.15, 6.0


def beat_frequency(time: FloatArray, lateral: FloatArray) -> float:
    """Return the frequency [Hz] of the sinusoid that, with a drift, leaves the least of a lateral motion (n,) [m]."""
    share = time / max(float(np.ptp(time)), 1e-9)

    def left(frequency: float) -> float:
        phase = 2.0 * np.pi * frequency * time
        design = np.column_stack([np.ones_like(time), share, np.cos(phase), np.sin(phase)])
        return float(np.square(lateral - design @ np.linalg.lstsq(design, lateral)[0]).sum())

    slowest = max(_SLOWEST, 1.0 / float(np.ptp(time)))
    step = 0.1 / float(np.ptp(time))
    trial = np.arange(slowest, _FASTEST, step)
    best = float(trial[int(np.argmin([left(f) for f in trial]))])
    refined = minimize_scalar(left, bounds=(max(best - step, 0.5 * slowest), best + step), method="bounded")
    return float(refined.x)


@dataclass(frozen=True)
class Smoother:
    """Local polynomials over a window of frames ([SavitzkyGolay1964]).

    Attributes:
        window: frames, odd.
    """

    window: int

    @classmethod
    def for_beat(cls, frequency: float) -> Smoother:
        """Return the widest window whose derivative keeps 97 % of the third harmonic of the beat."""
        good = [window for window in _WINDOWS if cls(window).gain(3.0 * frequency) >= _GAIN]
        return cls(max(good, default=_WINDOWS.start))

    @property
    def edge(self) -> int:
        """Frames at either end of a stretch that no full window covers."""
        return self.window // 2

    def gain(self, frequency: float) -> float:
        """Return the gain of the derivative at a frequency [Hz]; 1 is exact."""
        weights = savgol_coeffs(self.window, _ORDER, deriv=1, delta=1.0 / RATE, use="dot")
        phase = 2.0 * np.pi * frequency * np.arange(-self.edge, self.edge + 1) / RATE
        return float(weights @ np.sin(phase) / (2.0 * np.pi * frequency))

    def smooth(self, signal: FloatArray) -> FloatArray:
        """Smooth along the first axis."""
        return np.asarray(savgol_filter(signal, self.window, _ORDER, axis=0))

    def rate(self, signal: FloatArray) -> FloatArray:
        """Differentiate along the first axis [1/s]."""
        return np.asarray(savgol_filter(signal, self.window, _ORDER, deriv=1, delta=1.0 / RATE, axis=0))


def velocities(pose: FloatArray, smoother: Smoother) -> FloatArray:
    """Return surge, sway [m/s] and yaw rate [rad/s] of the nose (n, 3) from its measured pose (n, 3)."""
    rate = smoother.rate(pose)
    return np.column_stack([frames.to_body(rate[:, :2], smoother.smooth(pose)[:, 2]), rate[:, 2]])


def noise(head: HeadTrack, smoother: Smoother) -> FloatArray:
    """Return sigma of surge, sway [m/s] and yaw rate [rad/s], as this head was measured (3,).

    Three markers give six numbers for a pose of three. What is left over of them goes through the same
    differentiation as the pose: its mean square, over three degrees of freedom a frame, is the velocity variance of
    one marker, whatever its spectrum; least squares carries it to the nose.
    """
    left = smoother.rate(head.residual)[smoother.edge : -smoother.edge]
    variance = np.einsum("m,nmi->", head.weight, np.square(left)) / (3 * len(left))
    return np.asarray(np.sqrt(variance * np.diag(nose_covariance(head.weight))))
