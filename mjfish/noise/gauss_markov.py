"""Gauss-Markov noise: white noise on top of an Ornstein-Uhlenbeck process, a slow drift, in each channel.

    v = d + sigma eps,   d' = -d / tau + sqrt(2 / tau) q w

An autoregressive model of finite order needs many numbers for this, because the white part hides the slow one. The
numbers of each channel follow from the periodograms by Whittle's likelihood; a Kalman filter of one state whitens.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy import optimize

from mjfish.data import Trial
from mjfish.files.plain_data import unsaved
from mjfish.noise.autoregressive import Noise
from mjfish.noise.kalman import Gains, gains
from mjfish.noise.sample import NoiseSample, Spectrum, spectrum
from mjfish.numerics.arrays import BoolArray, FloatArray, checked, readonly

#: Correlation times from which the best is looked for [s].
_TIMES = (0.05, 0.2, 0.5, 1.0, 2.0)
#: The longest, as a share of a run: what hardly changes within one is not told from an error of the model and counts as
#: such.
_LONGEST = 1.0 / 3.0
#: Draws of the drift that the spectrum leaves open, from a grid of this many sizes and times.
_DRAWS, _SIZES, _TIMES_BETWEEN = 24, 49, 25
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
            _gains(*numbers, there)
            for numbers in zip(*map(np.ndarray.tolist, (self.sigma, self.drift, decay)), strict=True)
        ]


@functools.lru_cache(maxsize=256)
def _gains(sigma: float, drift: float, decay: float, seen: bytes) -> Gains:
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
        cost = functools.partial(_whittle, seen, seen.power[:, c, c].real, kept[:, c], left.trials[0].step)
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
    likely = tuple(GaussMarkov(sigma, drift=readonly(drift), time=readonly(time)) for drift, time in drawn)
    return GaussMarkov(sigma, drift=readonly(found[:, 1]), time=readonly(found[:, 2]), likely=likely)


def _whittle(seen: Spectrum, power: FloatArray, share: FloatArray, step: float, x: FloatArray) -> Any:
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
    sizes, slowness = best[1] + np.linspace(-2.0, 2.0, _SIZES), np.linspace(*times, num=_TIMES_BETWEEN)
    tried = np.stack([np.ravel(axis) for axis in np.meshgrid(best[0], sizes, slowness)])
    cost = _INDEPENDENT * cost_at(tried)
    weight = np.exp(cost.min() - cost)
    return np.asarray(np.exp(tried[1:, rng.choice(len(cost), _DRAWS, p=weight / weight.sum())]).T)
