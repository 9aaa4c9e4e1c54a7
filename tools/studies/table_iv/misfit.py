"""Least squares on ranges: log(simulated / published), all thirty alike, with exact derivatives.

The range of a channel is V(t_max) - V(t_min); to first order neither time matters (the envelope theorem), so that its
derivative is that of V at the two times.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.optimize import least_squares
from scipy.stats import qmc

from mjfish.data import Trial
from mjfish.fish.frames import CHANNELS
from mjfish.model import Model, sensitivities
from mjfish.numerics.arrays import FloatArray, readonly
from mjfish.parameters import Parameter, bounds
from studies.table_iv.ranges import Ranges

#: Step of the model in fits [s]; ranges of the pike err by less than 0.5 %.
STEP = 0.01
#: Draws of noise over which a range is averaged.
_DRAWS = 16
#: log(simulated / published) of a rollout that diverged.
_DIVERGED = 5.0
#: Share of its bounds by which a parameter may be off one and is said to be at it.
_AT_BOUND = 2e-3
#: A fit ends where a step lowers the sum of squares by less than this share, or after so many evaluations.
_TOLERANCE = 3e-3
_EVALUATIONS = 30
#: So few parameters are derived by differences in less time than along exact directions.
_FEW = 3
#: Fits start this share of the bounds inside.
_INSIDE = 1e-3
_NOISE = "noise."


@dataclass(frozen=True, eq=False)
class Fitted:
    """Numbers fitted to ranges.

    Attributes:
        free: names of what was fitted.
        values: of all parameters, by full name.
        at_bounds: names of those of `free` that ended at a bound.
        residuals: (modes, 3) log(simulated / published).
        evaluations: of the residuals.
    """

    free: tuple[str, ...]
    values: Mapping[str, float]
    at_bounds: tuple[str, ...]
    residuals: FloatArray
    evaluations: int = 0

    @property
    def optimum(self) -> dict[str, float]:
        """The fitted values by name."""
        return {name: self.values[name] for name in self.free}

    @property
    def misfit(self) -> float:
        """Root mean square of the logarithms of the ratios."""
        return rms(self.residuals)


def rms(residuals: FloatArray) -> float:
    """Return the root mean square."""
    return float(np.sqrt(np.mean(np.square(residuals))))


@dataclass(frozen=True, eq=False)
class RangeProblem:
    """What is fitted to which ranges.

    Attributes:
        model: a fish and its effects.
        trials: the modes.
        published: (modes, 3) ranges.
        free: parameters of the model, or sigma of the noise (``noise.surge`` ...), that are fitted.
        fixed: values of others by name; the rest have their defaults.
    """

    model: Model
    trials: tuple[Trial, ...]
    published: FloatArray
    free: tuple[Parameter, ...] = ()
    fixed: Mapping[str, float] = field(default_factory=dict)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the free parameters."""
        return tuple(p.name for p in self.free)

    def values(self, x: Sequence[float] | FloatArray = ()) -> dict[str, float]:
        """Return all parameters by name, the free ones from `x` (k,); none given: by default."""
        given = dict(zip(self.names, map(float, x), strict=True)) if len(x) else {}
        return {p.name: p.default for p in (*self.model.parameters, *self.free)} | dict(self.fixed) | given

    def residuals(self, x: FloatArray) -> FloatArray:
        """Return log(simulated / published) (modes, 3)."""
        return self._residuals(x, self._velocities(x))

    def jacobian(self, x: FloatArray) -> FloatArray:
        """Return its derivatives by the free parameters (modes, 3, k)."""
        return self._jacobian(x, self._velocities(x))

    def ranges(self, values: Mapping[str, float]) -> tuple[Ranges, ...]:
        """Return the ranges of the simulated modes, without noise."""
        known = {p.name: values[p.name] for p in self.model.parameters}
        return tuple(Ranges.of(trial, self.model.predict(trial, known).velocity) for trial in self.trials)

    def fitted(self, x: FloatArray, evaluations: int = 0) -> Fitted:
        """Return the outcome at `x`."""
        low, high = self.bounds
        share = (x - low) / (high - low)
        at = tuple(name for name, s in zip(self.names, share, strict=True) if min(s, 1.0 - s) < _AT_BOUND)
        return Fitted(self.names, self.values(x), at, self.residuals(x), evaluations)

    @property
    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Lower and upper bounds (k,)."""
        return bounds(self.free)

    def starts(self, count: int, seed: int) -> list[FloatArray]:
        """Return the declared start, off a null value, and points of a Latin hypercube over the bounds."""
        low, high = self.bounds
        declared = np.array([p.start + p.scale if p.start == p.default == p.low else p.start for p in self.free])
        drawn = qmc.LatinHypercube(len(self.free), rng=np.random.default_rng(seed)).random(max(count - 1, 0))
        return [declared, *(low + (high - low) * drawn)]

    def fit(self, starts: Sequence[FloatArray]) -> Fitted:
        """Return the best of the fits from `starts`, each (k,); a start outside the bounds is moved inside."""
        low, high = self.bounds
        width = high - low
        latest: dict[bytes, list[FloatArray]] = {}  # a derivative is asked for where the ranges were, just before

        def ratios(u: FloatArray) -> FloatArray:
            x = low + width * u
            latest.clear()
            latest[x.tobytes()] = velocities = self._velocities(x)
            return self._residuals(x, velocities).ravel()

        def slopes(u: FloatArray) -> FloatArray:
            x = low + width * u
            velocities = latest.get(x.tobytes()) or self._velocities(x)
            return self._jacobian(x, velocities).reshape(-1, len(width)) * width

        derivative: Any = slopes if len(width) > _FEW else "2-point"
        found = [
            least_squares(
                ratios, np.clip((start - low) / width, _INSIDE, 1.0 - _INSIDE), derivative, bounds=(0.0, 1.0),
                ftol=_TOLERANCE, xtol=1e-4, gtol=1e-6, max_nfev=_EVALUATIONS,
            )
            for start in starts
        ]  # fmt: skip
        best = min(found, key=lambda one: float(one.cost))
        return self.fitted(low + width * best.x, sum(one.nfev for one in found))

    def _own(self, x: FloatArray) -> dict[str, float]:
        values = self.values(x)
        return {p.name: values[p.name] for p in self.model.parameters}

    def _velocities(self, x: FloatArray) -> list[FloatArray]:
        own = self._own(x)
        return [self.model.predict(trial, own).velocity for trial in self.trials]

    def _read(self, x: FloatArray, velocity: FloatArray) -> FloatArray:
        """Return what is measured of velocities (n, 3), (draws, n, 3); a single draw where there is no noise."""
        if not any(name.startswith(_NOISE) for name in self.names):
            return velocity[None]
        values = self.values(x)
        return velocity + np.array([values[_NOISE + channel] for channel in CHANNELS]) * _draws(len(velocity))

    def _residuals(self, x: FloatArray, velocities: Sequence[FloatArray]) -> FloatArray:
        found = np.full((len(self.trials), len(CHANNELS)), _DIVERGED)
        for i, velocity in enumerate(velocities):
            if np.all(np.isfinite(velocity)):
                read = self._read(x, velocity)
                found[i] = np.log(_extent(read, read) / self.published[i])
        return found

    def _jacobian(self, x: FloatArray, velocities: Sequence[FloatArray]) -> FloatArray:
        own = self._own(x)
        found = np.zeros((len(self.trials), len(CHANNELS), len(self.names)))
        of_model = [name for name in self.names if name in own]
        for i, (trial, velocity) in enumerate(zip(self.trials, velocities, strict=True)):
            if not np.all(np.isfinite(velocity)):
                continue
            read = self._read(x, velocity)
            extent = _extent(read, read)
            along = sensitivities(self.model, trial, own, of_model) if of_model else np.zeros((*velocity.shape, 0))
            for k, name in enumerate(self.names):
                if name in own:
                    rate = np.broadcast_to(along[:, :, of_model.index(name)], read.shape)
                else:
                    rate = _draws(len(velocity)) * (np.array(CHANNELS) == name.removeprefix(_NOISE))
                found[i, :, k] = _extent(read, rate) / extent
        return found


def _extent(read: FloatArray, series: FloatArray) -> FloatArray:
    """Return the mean over draws of `series` (draws, n, 3) where `read` is largest, less where it is smallest."""
    high = np.take_along_axis(series, np.argmax(read, axis=1, keepdims=True), axis=1)
    low = np.take_along_axis(series, np.argmin(read, axis=1, keepdims=True), axis=1)
    return np.asarray(np.mean(high - low, axis=(0, 1)))


@functools.lru_cache(maxsize=4)
def _draws(samples: int) -> FloatArray:
    """Return standard normal noise (draws, n, 3), always the same."""
    return readonly(np.random.default_rng(0).standard_normal((_DRAWS, samples, len(CHANNELS))))
