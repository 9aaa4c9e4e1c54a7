"""Noise by sampling rate: trials that were sampled at different steps have a noise model for each step.

Models that count in samples (autoregressive ones, filters of positions) mean another spectrum at another step, and what
thinned or smoothed a record to its step left other noise in it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from mjfish.arrays import BoolArray, readonly
from mjfish.data import Trial
from mjfish.noise.autoregressive import Noise
from mjfish.noise.kalman import Gains


@dataclass(frozen=True, eq=False)
class NoiseByRate(Noise):
    """Noise by sampling step.

    Attributes:
        sigma: (3,) root mean square of those of the models.
        models: by step [s], two digits.
    """

    models: Mapping[float, Noise] = field(default_factory=dict)

    @staticmethod
    def of(models: Mapping[float, Noise]) -> NoiseByRate:
        """Return the noise of these models by step."""
        sigma = np.sqrt(np.mean([model.sigma**2 for model in models.values()], axis=0))
        return NoiseByRate(readonly(sigma), models=dict(models))

    def filters(self, trial: Trial, seen: BoolArray) -> list[Gains]:
        """Return the Kalman filters of the model of the trial's step, or of the nearest step there is."""
        nearest = min(self.models, key=lambda known: abs(np.log(known / rounded_step(trial))))
        return self.models[nearest].filters(trial, seen)


def rounded_step(trial: Trial) -> float:
    """Return the step of a trial [s], two digits."""
    return float(f"{trial.step:.2g}")


def by_step(trials: Sequence[Trial]) -> dict[float, list[int]]:
    """Return, by step [s], which trials were sampled at it."""
    found: dict[float, list[int]] = {}
    for index, trial in enumerate(trials):
        found.setdefault(rounded_step(trial), []).append(index)
    return found
