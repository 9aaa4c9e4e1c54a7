"""Noises whose numbers follow from the spectra of the residuals by Whittle's likelihood ([Whittle1953]).

**Gauss-Markov noise.** White noise on top of an Ornstein-Uhlenbeck process, a slow drift, in each channel.

    v = d + sigma eps,   d' = -d / tau + sqrt(2 / tau) q w

An autoregressive model of finite order needs many numbers for this, because the white part hides the slow one. A Kalman
filter of one state whitens.

**Differentiation noise.** White errors of position that went through a Savitzky-Golay derivative.

    v_t = sum_k h_k x_{t+k} + rho q eps_t,   |k| <= w,   x and eps white

h is the filter of [Savitzky1964] of a window of 2 w + 1 samples; q the standard deviation of the first term, rho what
rounding and blur add. Its spectrum has a zero at frequency nought, where slow effects show: an autoregressive model of
finite order cannot follow it there, and would see little of them.

**Process noise.** Random forces push the fish off its path, and a camera adds white noise.

    dv' = A(t) dv + a,   a' = -a / tau + sqrt(2 / tau) q w,   v = dv + sigma eps

with A the state Jacobian, the equation of motion linearised along the nominal rollout. A Kalman filter whitens it: its
innovations are those of the one-step predictor x^_{k+1} = F(x^_k + K (y_k - x^_k)) to first order, the innovations form
of the fit ([Ljung1999], sec. 7.4). For q, sigma and tau A is averaged over time:

    S(f) = H Q(f) H* + R,   H = (2 pi i f - A)^-1,   Q = 2 q^2 tau / (1 + (2 pi f tau)^2)

[Ljung1999] L. Ljung, System Identification. [Savitzky1964] A. Savitzky, M. Golay, Analytical Chemistry 36.
[Whittle1953] P. Whittle, The analysis of multiple stationary time series, J. R. Statist. Soc. B 15.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy import linalg, optimize, signal

from mjfish.data import Trial
from mjfish.files.plain_data import unsaved
from mjfish.noise.autoregressive import Noise
from mjfish.noise.kalman import Gains, gains
from mjfish.noise.sample import NoiseSample, Spectrum, spectrum
from mjfish.numerics.arrays import BoolArray, FloatArray, checked, readonly

#: Correlation times of a drift from which the best is looked for [s].
_TIMES = (0.05, 0.2, 0.5, 1.0, 2.0)
#: The longest, as a share of a run: what hardly changes within one is not told from an error of the model and counts as
#: such.
_LONGEST = 1.0 / 3.0
#: Draws of the drift that the spectrum leaves open, from a grid of this many sizes and times.
_DRAWS, _SIZES, _BETWEEN = 24, 49, 25
#: Complex step, too small to be rounded.
_IMAGINARY = 1e-30
#: Share of the ordinates of a periodogram that are independent where Hann's window joins neighbours:
#: 1 / (1 + 2 (2/3)^2 + 2 (1/6)^2).
_INDEPENDENT = 18.0 / 35.0


@dataclass(frozen=True, eq=False)
class GaussMarkov(Noise):
    """White noise on top of a slow drift.

    Attributes:
        sigma: (3,) of the white part; `phi` is empty.
        drift: (3,) q, standard deviation of the drift.
        time: (3,) tau [s].
        likely: the same with other drifts, drawn from what the data leave open; a slow one is known from few swings.
    """

    drift: FloatArray = field(default_factory=lambda: np.zeros(3))
    time: FloatArray = field(default_factory=lambda: np.ones(3))
    likely: tuple[GaussMarkov, ...] = unsaved(default=())

    def filters(self, trial: Trial, seen: BoolArray) -> list[Gains]:
        """Return the Kalman filters of the channels, of one state each."""
        decay, there = np.exp(-trial.step / self.time), seen.tobytes()
        return [
            _filter_of_drift(*numbers, there)
            for numbers in zip(*map(np.ndarray.tolist, (self.sigma, self.drift, decay)), strict=True)
        ]


@functools.lru_cache(maxsize=256)
def _filter_of_drift(sigma: float, drift: float, decay: float, seen: bytes) -> Gains:
    unit = np.ones((1, 1))
    return gains(
        decay * unit[None], drift**2 * (1.0 - decay**2) * unit[None], unit, np.array([sigma**2]), drift**2 * unit,
        np.frombuffer(seen, dtype=np.bool_),
    )  # fmt: skip


def longest(left: NoiseSample) -> float:
    """Return the longest correlation time that a drift may have in these trials [s]."""
    return max(_LONGEST * float(np.median([trial.time[-1] - trial.time[0] for trial in left.trials])), _TIMES[0])


def gauss_markov(left: NoiseSample, kept: FloatArray) -> GaussMarkov:
    """Estimate Gauss-Markov noise from residuals.

    Args:
        left: the residuals.
        kept: (bands, 3) which share of the noise's power they have (`mjfish.noise.sample.remaining_power`).
    """
    seen = spectrum(left)
    spread = np.sqrt(np.mean(np.concatenate([block**2 for block in left.residuals]), axis=0))
    rng, most = np.random.default_rng(0), longest(left)
    found, drawn = np.zeros((3, 3)), np.zeros((_DRAWS, 2, 3))
    for c in range(3):
        cost = functools.partial(_cost_of_drift, seen, seen.power[:, c, c].real, kept[:, c], left.trials[0].step)
        level = float(np.log(0.7 * spread[c]))
        bounds = [(level - 9.0, level + 4.0)] * 2 + [(np.log(_TIMES[0]), np.log(most))]
        tried = [
            optimize.minimize(
                cost,
                [level, level, np.log(time)],
                jac=functools.partial(_slopes, cost),
                method="L-BFGS-B",
                bounds=bounds,
            )
            for time in _TIMES
            if time <= most
        ]
        best = min(tried, key=lambda optimum: float(optimum.fun)).x
        found[c] = np.exp(checked(best))
        drawn[:, :, c] = _drawn(cost, best, bounds[2], rng)
    sigma = readonly(found[:, 0])
    return GaussMarkov(
        sigma,
        drift=readonly(found[:, 1]),
        time=readonly(found[:, 2]),
        likely=tuple(GaussMarkov(sigma, drift=readonly(drift), time=readonly(time)) for drift, time in drawn),
    )


def _cost_of_drift(seen: Spectrum, power: FloatArray, share: FloatArray, step: float, x: FloatArray) -> Any:
    """Return minus Whittle's log-likelihood (...) of one channel at logarithms (3, ...) of both sds and of the time.

    Args:
        seen: spectrum.
        power: of the channel there.
        share: of the power that is the noise's.
        step: between samples [s].
        x: the logarithms.
    """
    white, slow, time = np.exp(x)[..., None]
    decay = np.exp(-step / time)
    turn = np.cos(2.0 * np.pi * seen.frequency * step)
    # of the sampled drift, aliases included
    shape = step * (1.0 - decay**2) / (1.0 - 2.0 * decay * turn + decay**2)
    density = share * (white**2 * step + slow**2 * shape)
    return (np.log(density) + power / density) @ (seen.count * share)


def _slopes(cost: Callable[[FloatArray], Any], x: FloatArray) -> FloatArray:
    """Return the gradient (3,) of a cost at x (3,), by complex steps: differences would amplify rounding."""
    return np.asarray(cost(x[:, None] + 1j * _IMAGINARY * np.eye(len(x))).imag / _IMAGINARY)


def _drawn(
    cost_at: Callable[[FloatArray], Any], best: FloatArray, times: tuple[float, float], rng: np.random.Generator
) -> FloatArray:
    """Return (draws, 2) of size and time of a drift as likely as the spectrum has them; the white part is known well.

    Flat in their logarithms, the time within its bounds.
    """
    sizes, slowness = best[1] + np.linspace(-2.0, 2.0, _SIZES), np.linspace(*times, num=_BETWEEN)
    tried = np.stack([np.ravel(axis) for axis in np.meshgrid(best[0], sizes, slowness)])
    cost = _INDEPENDENT * cost_at(tried)
    weight = np.exp(cost.min() - cost)
    return np.asarray(np.exp(tried[1:, rng.choice(len(cost), _DRAWS, p=weight / weight.sum())]).T)


#: Windows and degrees of filters, and shares rho, that are tried. Degree 2 has the derivative of degree 1, and 4 that
#: of 3.
FILTERS = [(window, degree) for degree in (2, 4) for window in range(3, 23, 2) if window > degree]
_SHARES = (0.02, 0.05, 0.1, 0.2)
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
        unit = _filter_of_positions(self.window, self.degree, self.rounding, seen.tobytes())
        return [unit.scaled(sigma) for sigma in self.sigma.tolist()]


@functools.lru_cache(maxsize=256)
def weights(window: int, degree: int) -> FloatArray:
    """Return the filter h (window,), scaled so that white positions of variance 1 become velocities of variance 1."""
    h = signal.savgol_coeffs(window, degree, deriv=1)
    return readonly(h / np.linalg.norm(h))


@functools.lru_cache(maxsize=256)
def _filter_of_positions(window: int, degree: int, rounding: float, seen: bytes) -> Gains:
    """Make the filter of velocities of variance 1, whose state is the positions under the window."""
    total = 1.0 + rounding**2
    return gains(
        np.eye(window, k=-1)[None], np.diag(np.eye(window)[0])[None], weights(window, degree)[None] / np.sqrt(total),
        np.array([rounding**2 / total]), np.eye(window), np.frombuffer(seen, dtype=np.bool_),
    )  # fmt: skip


def differentiation_noise(left: NoiseSample) -> DifferentiationNoise:
    """Estimate the noise from residuals.

    For each share of rounding the filter with the largest likelihood of [Whittle1953]; of those the likeliest.
    """
    seen = spectrum(left)
    power = np.stack([seen.power[:, c, c].real for c in range(3)])
    turn = 2.0 * np.pi * seen.frequency * left.trials[0].step
    responses = [np.abs(signal.freqz(weights(*filter_), worN=turn)[1]) ** 2 for filter_ in FILTERS]
    found, bare = [], NoiseSample.of(left.trials, left.masks, left.residuals, left.scale)
    for rounding in _SHARES:
        shapes = [(response + rounding**2) / (1.0 + rounding**2) for response in responses]
        cost = [
            3.0 * seen.count @ np.log(shape) + seen.count.sum() * np.sum(np.log((power / shape) @ seen.count))
            for shape in shapes
        ]
        window, degree = FILTERS[int(np.argmin(cost))]
        found.append(
            _scaled(DifferentiationNoise(readonly(np.ones(3)), window=window, degree=degree, rounding=rounding), bare)
        )
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


#: Correlation times of forces that are tried [s].
_FORCE_TIMES = (0.1, 0.3, 1.0, 3.0)


@dataclass(frozen=True, eq=False)
class ProcessNoise(Noise):
    """Noise through random forces on the fish.

    Attributes:
        sigma: (3,) of the camera [m/s, m/s, rad/s].
        push: (3,) q, standard deviation of the random accelerations [m/s2, m/s2, rad/s2].
        time: tau [s].
        jacobians: by trial name, A (n, 3, 3) [1/s] on the grid of its samples.
    """

    push: FloatArray = field(default_factory=lambda: np.zeros(3))
    time: float = 1.0
    jacobians: Mapping[str, FloatArray] = unsaved(default_factory=dict)
    _cache: dict[tuple[str, bytes], Gains] = unsaved(default_factory=dict)

    def filters(self, trial: Trial, seen: BoolArray) -> list[Gains]:
        """Return the Kalman filter of a trial, one for all three channels."""
        key = (trial.name, seen.tobytes())
        if key not in self._cache:
            transition, drive, start = self.matrices(self._jacobian(trial, len(seen)), trial.step)
            self._cache[key] = gains(transition, drive[None], np.eye(3, 6), self.sigma**2, start, seen)
        return [self._cache[key]]

    def matrices(self, jacobian: FloatArray, step: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the transition (n, 6, 6), drive (6, 6) and start (6, 6) of the state (dv, a), for A (n, 3, 3)."""
        joint = np.zeros((len(jacobian), 6, 6))
        joint[:, :3, :3], joint[:, :3, 3:], joint[:, 3:, 3:] = jacobian, np.eye(3), -np.eye(3) / self.time
        start = np.diag(np.concatenate([np.zeros(3), self.push**2]))
        return linalg.expm(joint * step), start * (1.0 - np.exp(-2.0 * step / self.time)), start

    def _jacobian(self, trial: Trial, samples: int) -> FloatArray:
        """Return A of a trial; of one that the noise was not estimated from, the mean of the others."""
        if trial.name in self.jacobians and len(self.jacobians[trial.name]) >= samples:
            return self.jacobians[trial.name][:samples]
        return np.asarray(np.mean([jacobian.mean(axis=0) for jacobian in self.jacobians.values()], axis=0))[None]


def process_noise(left: NoiseSample, jacobians: Mapping[str, FloatArray]) -> ProcessNoise:
    """Estimate process noise from residuals.

    Args:
        left: the residuals.
        jacobians: by trial name, A (n, 3, 3) on the grid of its samples; of other trials, too.
    """
    own = {trial.name: jacobians[trial.name] for trial in left.trials}
    step, seen = left.trials[0].step, spectrum(left)
    mean = np.mean([a.mean(axis=0) for a in own.values()], axis=0)
    spread = np.sqrt(np.mean(np.concatenate(left.residuals) ** 2, axis=0))
    start = np.log(np.concatenate([0.7 * spread, 0.7 * spread * np.abs(np.diag(mean))]))
    options: dict[str, Any] = {"jac": True, "method": "L-BFGS-B", "bounds": [(s - 9.0, s + 4.0) for s in start]}
    found = [
        (optimize.minimize(_cost_of_forces, start, (time, mean, seen, step), **options), time) for time in _FORCE_TIMES
    ]
    best, time = min(found, key=lambda pair: float(pair[0].fun))
    checked(np.asarray(best.fun))
    return ProcessNoise(readonly(np.exp(best.x[:3])), push=readonly(np.exp(best.x[3:])), time=time, jacobians=own)


def _cost_of_forces(
    x: FloatArray, time: float, mean: FloatArray, seen: Spectrum, step: float
) -> tuple[float, FloatArray]:
    """Return minus Whittle's log-likelihood, and its gradient (6,), at logarithms x of both standard deviations."""
    (sigma, push), turn = np.exp(x.reshape(2, 3)), 2.0 * np.pi * seen.frequency
    h = np.linalg.inv(1j * turn[:, None, None] * np.eye(3) - mean)
    q = 2.0 * push**2 * time / (1.0 + (turn[:, None] * time) ** 2)
    density = np.einsum("fij,fj,fkj->fik", h, q, h.conj()) + np.diag(sigma**2) * step
    inverse = np.linalg.inv(density)
    explained = inverse @ seen.power
    value = float(seen.count @ (np.linalg.slogdet(density)[1] + np.einsum("fii->f", explained).real))
    slopes = inverse - explained @ inverse
    white = 2.0 * sigma**2 * step * (seen.count @ np.einsum("fcc->fc", slopes).real)
    pushed = 2.0 * seen.count @ (q * np.einsum("fij,fik,fkj->fj", h.conj(), slopes, h).real)
    return value, np.concatenate([white, pushed])
