"""Velocities that were smoothed, or made by differentiating positions: the prediction goes through the same filter.

A Savitzky-Golay derivative [Savitzky1964] smooths the motion as it smooths the noise. A simulation that is compared
with such velocities must be smoothed alike, or what the filter took looks like an effect. The data are never filtered:
that takes their noise, and any model gains [Ljung1999, ch. 14].

[Savitzky1964] A. Savitzky, M. Golay, Analytical Chemistry 36. [Ljung1999] L. Ljung, System Identification: Theory for
the User, 2nd ed. [VanCittert1931] P. van Cittert, Zeitschrift fuer Physik 69.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy import interpolate, ndimage, signal

from mjfish.numerics.arrays import FloatArray

if TYPE_CHECKING:
    from mjfish.data.trial import Trial

#: Rounds of the iteration that undoes the smoothing of a heading [VanCittert1931].
_ROUNDS = 5


@dataclass(frozen=True)
class Differentiator:
    """A Savitzky-Golay derivative of positions.

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
        """Return the columns (n, 3, ...) of velocities of a trial, one row a sample, as this filter would make them."""
        if not self.turned:
            return self._filtered(trial, block)
        recorded = np.asarray(interpolate.CubicSpline(trial.time, trial.velocity[:, 2]).antiderivative()(trial.time))
        heading = recorded
        for _ in range(_ROUNDS):  # the recorded one comes of a rate that was smoothed
            heading = heading + recorded - self._filtered(trial, heading)
        return _turned(self._filtered(trial, _turned(block, heading)), -heading)

    def reach(self, step: float) -> float:
        """Return how far [s] a sample is felt to either side, samples being `step` [s] apart."""
        return 0.5 * self.window * step

    @property
    def words(self) -> str:
        """The filter in words."""
        along = "the tank" if self.turned else "the fish"
        return f"positions along the axes of {along}, differentiated over {self.window} samples, degree {self.degree}"

    def _filtered(self, trial: Trial, columns: FloatArray) -> FloatArray:
        """Integrate columns (n, ...) to positions, at missing samples, too, and differentiate these by the filter."""
        rows = trial.rows
        flat, grid = columns.reshape(len(columns), -1), np.interp(np.arange(rows[-1] + 1), rows, trial.time)
        path = interpolate.CubicSpline(trial.time, flat).antiderivative()(grid)
        smooth = signal.savgol_filter(path, self.window, self.degree, deriv=1, delta=trial.step, axis=0)
        return np.asarray(smooth[rows].reshape(columns.shape))


#: Standard deviations beyond which a Gaussian is cut.
_CUT = 3.0


@dataclass(frozen=True)
class GaussianFilter:
    """A Gaussian that velocities were smoothed with.

    Attributes:
        sd: of it [s]. A wave of frequency f keeps exp(-(2 pi f sd)^2 / 2) of its amplitude.
    """

    sd: float

    def of_trial(self, trial: Trial, block: FloatArray) -> FloatArray:
        """Return the columns (n, 3, ...) of velocities of a trial, one row a sample, as this filter would make them."""
        rows, flat = trial.rows, block.reshape(len(block), -1)
        grid = np.interp(np.arange(rows[-1] + 1), rows, trial.time)
        dense = flat if len(grid) == len(flat) else interpolate.CubicSpline(trial.time, flat)(grid)
        smooth = ndimage.gaussian_filter1d(dense, self.sd / trial.step, axis=0, mode="nearest", truncate=_CUT)
        return np.asarray(smooth[rows].reshape(block.shape))

    def reach(self, step: float) -> float:
        """Return how far [s] a sample is felt to either side, samples being `step` [s] apart."""
        return max(_CUT * self.sd, step)

    @property
    def words(self) -> str:
        """The filter in words."""
        return f"velocities smoothed by a Gaussian of {1e3 * self.sd:.3g} ms"


#: What recorded velocities went through.
Filter = Differentiator | GaussianFilter


def restored_filter(fields: Mapping[str, Any] | None) -> Filter | None:
    """Return the filter whose fields these are."""
    kind = GaussianFilter if fields and "sd" in fields else Differentiator
    return kind(**fields) if fields else None


def _turned(block: FloatArray, angle: FloatArray) -> FloatArray:
    """Turn the first two of three components (n, 3, ...) by angles (n,)."""
    shape = (len(angle), *[1] * (block.ndim - 2))
    c, s = np.cos(angle).reshape(shape), np.sin(angle).reshape(shape)
    return np.stack([c * block[:, 0] - s * block[:, 1], s * block[:, 0] + c * block[:, 1], block[:, 2]], axis=1)
