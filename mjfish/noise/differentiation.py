"""Differentiation noise: white errors of position that went through a Savitzky-Golay derivative.

    v_t = sum_k h_k x_{t+k} + rho q eps_t,   |k| <= w,   x and eps white

h is the filter of [Savitzky1964] of a window of 2 w + 1 samples; q the standard deviation of the first term, rho what
rounding and blur add. Its spectrum has a zero at frequency nought, where slow effects show: an autoregressive model of
finite order cannot follow it there, and would see little of them.

[Savitzky1964] A. Savitzky, M. Golay, Analytical Chemistry 36. [Whittle1953]: see `mjfish.noise.sample`.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass, replace

import numpy as np
from scipy import optimize, signal

from mjfish.data import Trial
from mjfish.noise.autoregressive import Noise
from mjfish.noise.kalman import Gains, gains
from mjfish.noise.sample import NoiseSample, spectrum
from mjfish.numerics.arrays import BoolArray, FloatArray, checked, readonly

#: Windows, degrees and shares rho that are tried. Degree 2 has the derivative of degree 1, and 4 that of 3.
WINDOWS, DEGREES, _SHARES = range(3, 23, 2), (2, 4), (0.02, 0.05, 0.1, 0.2)
#: How far about one of them the likeliest is looked for, and how finely, in the logarithm.
_NEAR, _FINE = 1.5, 0.03


@dataclass(frozen=True, eq=False)
class DifferentiationNoise(Noise):
    """Noise of differentiated positions.

    Attributes:
        sigma: (3,) of the velocities, rounding included; `phi` is empty.
        window, degree: of the filter.
        rounding: rho, white part over the rest, standard deviations.
    """

    window: int = 3
    degree: int = 2
    rounding: float = 0.05

    def filters(self, trial: Trial, seen: BoolArray) -> list[Gains]:
        """Return the Kalman filters of the channels, whose state is the positions under the window."""
        unit = _gains(self.window, self.degree, self.rounding, seen.tobytes())
        return [unit.scaled(sigma) for sigma in self.sigma.tolist()]


@functools.lru_cache(maxsize=256)
def weights(window: int, degree: int) -> FloatArray:
    """Return the filter h (window,), scaled so that white positions of variance 1 become velocities of variance 1."""
    h = signal.savgol_coeffs(window, degree, deriv=1)
    return readonly(h / np.linalg.norm(h))


@functools.lru_cache(maxsize=256)
def _gains(window: int, degree: int, rounding: float, seen: bytes) -> Gains:
    """Make the filter of velocities of variance 1, whose state is the positions under the window."""
    total = 1.0 + rounding**2
    drive = np.zeros((1, window, window))
    drive[0, 0, 0] = 1.0
    return gains(
        np.eye(window, k=-1)[None], drive, weights(window, degree)[None] / np.sqrt(total),
        np.array([rounding**2 / total]), np.eye(window), np.frombuffer(seen, dtype=np.bool_),
    )  # fmt: skip


def differentiation_noise(left: NoiseSample) -> DifferentiationNoise:
    """Estimate the noise from residuals.

    For each share of rounding the filter with the largest likelihood of [Whittle1953]; of those the likeliest.
    """
    seen = spectrum(left)
    step = left.trials[0].step
    power = np.stack([seen.power[:, c, c].real for c in range(3)])
    filters = [(window, degree) for degree in DEGREES for window in WINDOWS if window > degree]
    turn = 2.0 * np.pi * seen.frequency * step
    responses = [np.abs(signal.freqz(weights(*filter_), worN=turn)[1]) ** 2 for filter_ in filters]
    found, bare = [], NoiseSample.of(left.trials, left.masks, left.residuals, left.scale)
    for rounding in _SHARES:
        shapes = [(response + rounding**2) / (1.0 + rounding**2) for response in responses]
        cost = [
            3.0 * seen.count @ np.log(shape) + seen.count.sum() * np.sum(np.log((power / shape) @ seen.count))
            for shape in shapes
        ]
        window, degree = filters[int(np.argmin(cost))]
        unit = DifferentiationNoise(readonly(np.ones(3)), window=window, degree=degree, rounding=rounding)
        found.append(_scaled(unit, bare))
    return max(found, key=bare.log_likelihood)


def sharpened(noise: DifferentiationNoise, left: NoiseSample) -> DifferentiationNoise:
    """Return the noise with the share of rounding and the sigma of the largest restricted likelihood.

    What the saturated model takes, and how, matters most where the filter lets nothing through, and there alone the
    rounding shows. One such place is frequency nought, where an error of the model that changes slowly looks like
    rounding, only much larger. The others are at high frequencies, which slow and beating shapes of single trials
    leave alone; these are taken out.
    """
    left = left.without_trial_shapes()

    def rounded(log_share: float) -> DifferentiationNoise:
        return _scaled(replace(noise, rounding=float(np.exp(log_share))), left)

    middle = np.log(noise.rounding)
    found = optimize.minimize_scalar(
        lambda log_share: -left.log_likelihood(rounded(log_share)),
        bounds=(middle - _NEAR, middle + _NEAR),
        method="bounded",
        options={"xatol": _FINE},
    )
    return rounded(float(checked(np.asarray([found.x, found.fun]))[0]))


def _scaled(noise: DifferentiationNoise, left: NoiseSample) -> DifferentiationNoise:
    """Return the noise with its likeliest sigma."""
    return replace(noise, sigma=readonly(noise.sigma * left.whitened_sigma(noise)))
