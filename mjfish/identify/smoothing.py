"""Smoothing of recorded velocities: the prediction goes through the filter that the recording went through.

A simulation that is compared with smoothed velocities must be smoothed alike, or what the filter took from the motion
looks like an effect; never the data, for a filter takes noise, too [Ljung1999, sec. 14.4].

[Ljung1999] L. Ljung, System Identification: Theory for the User, 2nd ed. [Savitzky1964] A. Savitzky, M. Golay,
Analytical Chemistry 36. [Gustafsson1996] F. Gustafsson, IEEE Transactions on Signal Processing 44.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np
from scipy import interpolate, signal

from mjfish.arrays import FloatArray
from mjfish.trial import Trial

#: Rounds of van Cittert's iteration that undoes the smoothing of a heading.
_ROUNDS = 5


@dataclass(frozen=True)
class Smoothing(ABC):
    """A filter without delay that the velocities of a recording went through."""

    def of_trial(self, trial: Trial, block: FloatArray) -> FloatArray:
        """Smooth columns (n, 3, ...) of a trial, one row a sample; what is missing in between is interpolated."""
        flat, rows = block.reshape(len(block), -1), np.rint((trial.time - trial.time[0]) / trial.step).astype(np.int64)
        if rows[-1] + 1 > len(rows):
            every = interpolate.CubicSpline(rows, flat)(np.arange(rows[-1] + 1))
            return np.asarray(self._filtered(every, trial.step)[rows].reshape(block.shape))
        return self._filtered(flat, trial.step).reshape(block.shape)

    @property
    @abstractmethod
    def words(self) -> str:
        """Say which filter it is."""

    @abstractmethod
    def reach(self, step: float) -> float:
        """Return how far [s] a sample is felt to either side, samples being `step` [s] apart."""

    @abstractmethod
    def _filtered(self, columns: FloatArray, step: float) -> FloatArray:
        """Smooth columns (n, k) of samples at equal steps."""


@dataclass(frozen=True)
class Differentiator(Smoothing):
    """Velocities are the derivative of positions by a Savitzky-Golay filter [Savitzky1964].

    Attributes:
        window: samples; 3 of degree 2 are central differences.
        degree: of the polynomial.
        turned: whether positions were differentiated along the axes of the tank and turned into the fish's by a heading
            that was not smoothed; else as if along its own.
    """

    window: int
    degree: int
    turned: bool = False

    def of_trial(self, trial: Trial, block: FloatArray) -> FloatArray:
        """Smooth columns (n, 3, ...) of a trial."""
        if not self.turned:
            return super().of_trial(trial, block)
        recorded = _integral(trial.time, trial.velocity[:, 2])
        heading = recorded
        for _ in range(_ROUNDS):  # it was smoothed itself
            heading = heading + recorded - super().of_trial(trial, np.tile(heading[:, None], 3))[:, 0]
        return _turned(super().of_trial(trial, _turned(block, heading)), -heading)

    @property
    def words(self) -> str:
        """Say which filter it is."""
        along = "the tank" if self.turned else "the fish"
        return f"positions along the axes of {along}, differentiated over {self.window} samples, degree {self.degree}"

    def reach(self, step: float) -> float:
        """Return half the window [s]."""
        return 0.5 * self.window * step

    def _filtered(self, columns: FloatArray, step: float) -> FloatArray:
        time = step * np.arange(len(columns), dtype=np.float64)
        path = _integral(time, columns)
        return np.asarray(signal.savgol_filter(path, self.window, self.degree, deriv=1, delta=step, axis=0))


@dataclass(frozen=True)
class LowPass(Smoothing):
    """Velocities went through a Butterworth filter forth and back [Gustafsson1996]: 1 / (1 + (f / cutoff)^(2 order)).

    Attributes:
        cutoff: frequency [Hz] at which half of the amplitude is left.
        order: of the filter.
    """

    cutoff: float
    order: int

    @property
    def words(self) -> str:
        """Say which filter it is."""
        return f"like a Butterworth filter of order {self.order} forth and back, half gone at {self.cutoff:g} Hz"

    def reach(self, step: float) -> float:
        """Return the time [s] in which an impulse has died away, nearly."""
        del step
        return 0.5 / self.cutoff

    def _filtered(self, columns: FloatArray, step: float) -> FloatArray:
        sections = signal.butter(self.order, self.cutoff, fs=1.0 / step, output="sos")
        return np.asarray(signal.sosfiltfilt(sections, columns, axis=0))


def _integral(time: FloatArray, columns: FloatArray) -> FloatArray:
    """Return the integral from the first sample on of columns (n, ...) of samples."""
    return np.asarray(interpolate.CubicSpline(time, columns).antiderivative()(time))


def _turned(block: FloatArray, angle: FloatArray) -> FloatArray:
    """Turn the first two of three components (n, 3, ...) by angles (n,)."""
    shape = (len(angle), *[1] * (block.ndim - 2))
    c, s = np.cos(angle).reshape(shape), np.sin(angle).reshape(shape)
    return np.stack([c * block[:, 0] - s * block[:, 1], s * block[:, 0] + c * block[:, 1], block[:, 2]], axis=1)
