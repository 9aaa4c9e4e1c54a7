"""Noise that drifts: white noise on top of a slow wander of each channel.

    v = d + sigma eps,   d' = -d / tau + sqrt(2 / tau) q w

An autoregressive model of finite order cannot say this with few numbers, for the white part hides the slow one. Numbers
follow, channel by channel, from the periodograms by Whittle's likelihood; a Kalman filter of one state whitens.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy import optimize

from mjfish.arrays import BoolArray, FloatArray, readonly
from mjfish.data import Trial
from mjfish.estimation import Noise, Problem
from mjfish.noise.coloured import grid
from mjfish.noise.kalman import Gains, gains, whitened_channels
from mjfish.noise.spectrum import Spectrum, spectrum
from mjfish.serialise import unsaved

#: Correlation times from which the best is looked for [s].
_TIMES = (0.05, 0.2, 0.5, 1.0, 2.0)
#: The longest, as a share of a run: what hardly changes within one is not told from an error of the model and counts as
#: such.
_LONGEST = 1.0 / 3.0
#: Draws of the wander that the spectrum leaves open, from a grid of this many sizes and times.
_DRAWS = 24
_SIZES, _TIMES_BETWEEN = 49, 25
#: Share of the ordinates of a periodogram that are independent where Hann's window joins neighbours:
#: 1 / (1 + 2 (2/3)^2 + 2 (1/6)^2).
_INDEPENDENT = 18.0 / 35.0


@dataclass(frozen=True, eq=False)
class Drifting(Noise):
    """White noise on a slow wander.

    Attributes:
        sigma: (3,) of the white part; `phi` is empty.
        wander: (3,) q, standard deviation of the wander.
        time: (3,) tau [s].
        likely: the same with other wanders, drawn from what the data leave open; a slow one is known from few swings.
    """

    wander: FloatArray = field(default_factory=lambda: np.zeros(3))
    time: FloatArray = field(default_factory=lambda: np.ones(3))
    likely: tuple[Drifting, ...] = unsaved(default=())

    def of_trial(self, trial: Trial, mask: BoolArray, block: FloatArray, starts: Sequence[int]) -> FloatArray:
        """Return the white innovations (n, 3, ...) of columns (n, 3, ...), one row a counted sample."""
        del starts
        seen = grid(trial.time, mask)
        return whitened_channels([self._filter(c, trial, seen) for c in range(3)], seen, block)

    def log_determinant(self, trial: Trial, seen: BoolArray) -> float:
        """Return the log determinant of the noise's covariance."""
        return sum(self._filter(c, trial, seen).log_determinant for c in range(3))

    def numbers(self) -> FloatArray:
        """Return all numbers of the model (9,)."""
        return np.concatenate([self.sigma, self.wander, self.time])

    def _filter(self, channel: int, trial: Trial, seen: BoolArray) -> Gains:
        step = trial.step
        sigma, wander, time = (float(one[channel]) for one in (self.sigma, self.wander, self.time))
        return _gains(sigma, wander, float(np.exp(-step / time)), seen.tobytes())


@functools.lru_cache(maxsize=256)
def _gains(sigma: float, wander: float, decay: float, seen: bytes) -> Gains:
    one = np.ones((1, 1))
    return gains(
        decay * one[None], wander**2 * (1.0 - decay**2) * one[None], one, sigma**2 * one, wander**2 * one,
        np.frombuffer(seen, dtype=np.bool_),
    )  # fmt: skip


def longest(problem: Problem) -> float:
    """Return the longest correlation time that a wander may have in these trials [s]."""
    return max(_LONGEST * float(np.median([trial.time[-1] - trial.time[0] for trial in problem.trials])), _TIMES[0])


def drifting(problem: Problem, residuals: Sequence[FloatArray], kept: FloatArray) -> Drifting:
    """Estimate drifting noise from residuals (n_r, 3) of the trials of a problem.

    Args:
        problem: with the trials.
        residuals: of each.
        kept: (bands, 3) which share of the noise's power they have (`mjfish.noise.saturated.kept`).
    """
    seen = spectrum(problem, residuals)
    spread = np.sqrt(np.mean(np.concatenate([block**2 for block in residuals]), axis=0))
    rng, most = np.random.default_rng(0), longest(problem)
    found, drawn = np.zeros((3, 3)), np.zeros((_DRAWS, 2, 3))
    for c in range(3):
        of = _Whittle(seen, seen.power[:, c, c].real, kept[:, c], problem.trials[0].step)
        level = float(np.log(0.7 * spread[c]))
        bounds = [(level - 9.0, level + 4.0)] * 2 + [(np.log(_TIMES[0]), np.log(most))]
        tried = [
            optimize.minimize(of.cost, [level, level, np.log(time)], method="L-BFGS-B", bounds=bounds)
            for time in _TIMES
            if time <= most
        ]
        best = min(tried, key=lambda one: float(one.fun)).x
        found[c] = np.exp(best)
        drawn[:, :, c] = _drawn(of, best, bounds[2], rng)
    sigma, empty = readonly(found[:, 0]), readonly(np.zeros((3, 0)))
    likely = tuple(Drifting(sigma, empty, readonly(wander), readonly(time)) for wander, time in drawn)
    return Drifting(sigma, empty, readonly(found[:, 1]), readonly(found[:, 2]), likely)


@dataclass(frozen=True, eq=False)
class _Whittle:
    """Whittle's likelihood of one channel: its spectrum, the power there, and which share of it is the noise's."""

    seen: Spectrum
    power: FloatArray
    share: FloatArray
    step: float

    def cost(self, x: FloatArray) -> Any:
        """Return - log L (...) at logarithms (3, ...) of both standard deviations and of the time."""
        white, slow, time = np.exp(x)[..., None]
        decay = np.exp(-self.step / time)
        turn = np.cos(2.0 * np.pi * self.seen.frequency * self.step)
        # of the sampled wander, aliases included
        shape = self.step * (1.0 - decay**2) / (1.0 - 2.0 * decay * turn + decay**2)
        density = self.share * (white**2 * self.step + slow**2 * shape)
        return (np.log(density) + self.power / density) @ (self.seen.count * self.share)


def _drawn(of: _Whittle, best: FloatArray, times: tuple[float, float], rng: np.random.Generator) -> FloatArray:
    """Return (draws, 2) of size and time of a wander as likely as the spectrum has them; the white part is known well.

    Flat in their logarithms, the time within its bounds.
    """
    sizes, slowness = best[1] + np.linspace(-2.0, 2.0, _SIZES), np.linspace(*times, num=_TIMES_BETWEEN)
    tried = np.stack([np.ravel(one) for one in np.meshgrid(best[0], sizes, slowness)])
    cost = _INDEPENDENT * of.cost(tried)
    weight = np.exp(cost.min() - cost)
    return np.asarray(np.exp(tried[1:, rng.choice(len(cost), _DRAWS, p=weight / weight.sum())]).T)
