"""Noise of differentiated positions: white errors of position that went through a Savitzky-Golay derivative.

    v_t = sum_k h_k x_{t+k} + rho q eps_t,   |k| <= w,   x and eps white

h is the filter of [Savitzky1964] of a window of 2 w + 1 samples; q the standard deviation of the first term, rho what
rounding and blur add. Its spectrum has a zero at frequency nought, where slow effects show: an autoregressive model of
finite order cannot follow it there, and would see little of them.

[Savitzky1964] A. Savitzky, M. Golay, Analytical Chemistry 36. [Whittle1953]: see `mjfish.noise.spectrum`.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import optimize, signal

from mjfish.arrays import BoolArray, FloatArray, readonly
from mjfish.data import Trial
from mjfish.estimation import Noise, Problem
from mjfish.noise.coloured import grid
from mjfish.noise.kalman import Gains, gains, whitened_channels
from mjfish.noise.saturated import Saturated, likelihood, spread
from mjfish.noise.spectrum import spectrum

#: Windows, degrees and shares rho that are tried. Degree 2 has the derivative of degree 1, and 4 that of 3.
WINDOWS, DEGREES, _SHARES = range(3, 23, 2), (2, 4), (0.02, 0.05, 0.1, 0.2)
#: How far about one of them the likeliest is looked for, and how finely, in the logarithm.
_NEAR, _FINE = 1.5, 0.03


@dataclass(frozen=True, eq=False)
class Differentiated(Noise):
    """Noise of differentiated positions.

    Attributes:
        sigma: (3,) of the velocities, rounding included; `phi` is empty.
        window, degree: of the filter.
        rounding: rho, white part over the rest, standard deviations.
    """

    window: int = 3
    degree: int = 2
    rounding: float = 0.05

    def of_trial(self, trial: Trial, mask: BoolArray, block: FloatArray, starts: Sequence[int]) -> FloatArray:
        """Return the white innovations (n, 3, ...) of columns (n, 3, ...), one row a counted sample."""
        del starts
        seen = grid(trial.time, mask)
        scaled = block / self.sigma.reshape(1, 3, *[1] * (block.ndim - 2))
        return whitened_channels([self._filter(seen)] * 3, seen, scaled)

    def log_determinant(self, trial: Trial, seen: BoolArray) -> float:
        """Return the log determinant of the noise's covariance."""
        del trial
        scale = float(np.count_nonzero(seen) * np.sum(np.log(self.sigma**2)))
        return scale + 3.0 * self._filter(seen).log_determinant

    def numbers(self) -> FloatArray:
        """Return all numbers of the model (6,)."""
        return np.array([*self.sigma, self.window, self.degree, self.rounding])

    def _filter(self, seen: BoolArray) -> Gains:
        return _gains(self.window, self.degree, self.rounding, seen.tobytes())


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
        np.array([[rounding**2 / total]]), np.eye(window), np.frombuffer(seen, dtype=np.bool_),
    )  # fmt: skip


def differentiated(problem: Problem, residuals: Sequence[FloatArray]) -> Differentiated:
    """Estimate the noise from residuals (n_r, 3) of the trials of a problem.

    For each share of rounding the filter with the largest likelihood of [Whittle1953]; of those the likeliest.
    """
    seen = spectrum(problem, residuals)
    step = problem.trials[0].step
    power = np.stack([seen.power[:, c, c].real for c in range(3)])
    filters = [(window, degree) for degree in DEGREES for window in WINDOWS if window > degree]
    responses = [
        np.abs(signal.freqz(weights(*one), worN=2.0 * np.pi * seen.frequency * step)[1]) ** 2 for one in filters
    ]
    chosen = []
    for rounding in _SHARES:
        shapes = [(response + rounding**2) / (1.0 + rounding**2) for response in responses]
        cost = [
            3.0 * seen.count @ np.log(shape) + seen.count.sum() * np.sum(np.log((power / shape) @ seen.count))
            for shape in shapes
        ]
        chosen.append(filters[int(np.argmin(cost))])
    made = [_scaled(problem, residuals, *one, rounding) for one, rounding in zip(chosen, _SHARES, strict=True)]
    return min(made, key=lambda one: one[1])[0]


def sharpened(one: Differentiated, problem: Problem, left: Saturated) -> Differentiated:
    """Return the noise with the share of rounding and the sigma of the largest restricted likelihood.

    What the saturated model takes, and how, matters most where the filter lets nothing through, and there alone the
    rounding shows.
    """

    def rounded(log_share: float) -> Differentiated:
        made = replace(one, rounding=float(np.exp(log_share)))
        return replace(made, sigma=readonly(made.sigma * spread(made, problem, left)))

    middle = np.log(one.rounding)
    found = optimize.minimize_scalar(
        lambda x: -likelihood(rounded(x), problem, left),
        bounds=(middle - _NEAR, middle + _NEAR),
        method="bounded",
        options={"xatol": _FINE},
    )
    return rounded(float(found.x))


def _scaled(
    problem: Problem, residuals: Sequence[FloatArray], window: int, degree: int, rounding: float
) -> tuple[Differentiated, float]:
    """Return the noise with its likeliest sigma, and minus twice its log-likelihood less a constant."""
    unit = Differentiated(readonly(np.ones(3)), readonly(np.zeros((3, 0))), window, degree, rounding)
    masks = [problem.mask(i) for i in range(len(problem.trials))]
    white = [unit.of_trial(*one, ()) for one in zip(problem.trials, masks, residuals, strict=True)]
    variance = np.mean(np.concatenate(white) ** 2, axis=0)
    seen = [grid(trial.time, mask) for trial, mask in zip(problem.trials, masks, strict=True)]
    determinant = sum(unit.log_determinant(trial, there) for trial, there in zip(problem.trials, seen, strict=True))
    cost = sum(len(block) for block in white) * float(np.sum(np.log(variance))) + determinant
    return replace(unit, sigma=readonly(np.sqrt(variance))), cost
