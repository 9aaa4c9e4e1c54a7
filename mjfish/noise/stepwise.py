"""Noise of trials that were sampled at different steps: every step has a model of its own.

Models that count in samples (autoregressive ones, filters of positions) mean another spectrum at another step, and what
thinned or smoothed a record to its step left other noise in it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from mjfish.arrays import BoolArray, FloatArray, readonly
from mjfish.data import Trial
from mjfish.estimation import Noise, Problem
from mjfish.noise.coloured import Coloured
from mjfish.noise.differentiated import Differentiated
from mjfish.noise.drifting import Drifting
from mjfish.noise.forces import Pushed

#: A model of the noise at one step.
Model = Coloured | Drifting | Differentiated | Pushed


@dataclass(frozen=True, eq=False)
class Stepwise(Noise):
    """Noise by step.

    Attributes:
        sigma: (3,) root mean square of those of the models; `phi` is empty.
        models: by step [s], two digits.
    """

    models: Mapping[float, Model] = field(default_factory=dict)

    @staticmethod
    def of(models: Mapping[float, Model]) -> Stepwise:
        """Return the noise of these models by step."""
        sigma = np.sqrt(np.mean([model.sigma**2 for model in models.values()], axis=0))
        return Stepwise(readonly(sigma), readonly(np.zeros((3, 0))), dict(models))

    def model(self, trial: Trial) -> Model:
        """Return the model of a trial: that of its step, or of the nearest there is."""
        return self.models[min(self.models, key=lambda known: abs(np.log(known / step(trial))))]

    def of_trial(self, trial: Trial, mask: BoolArray, block: FloatArray, starts: Sequence[int]) -> FloatArray:
        """Return the white innovations (n, 3, ...) of columns (n, 3, ...), one row a counted sample."""
        return self.model(trial).of_trial(trial, mask, block, starts)

    def log_determinant(self, trial: Trial, seen: BoolArray) -> float:
        """Return the log determinant of the noise's covariance."""
        return self.model(trial).log_determinant(trial, seen)


def step(trial: Trial) -> float:
    """Return the step of a trial [s], two digits."""
    return float(f"{trial.step:.2g}")


def parts(problem: Problem) -> dict[float, tuple[list[int], Problem]]:
    """Return, by step, which trials of a problem have it, and the problem of these alone."""
    found: dict[float, list[int]] = {}
    for index, trial in enumerate(problem.trials):
        found.setdefault(step(trial), []).append(index)
    windows = problem.windows
    return {
        known: (
            here,
            replace(
                problem,
                trials=tuple(problem.trials[i] for i in here),
                windows=None if windows is None else tuple(windows[i] for i in here),
            ),
        )
        for known, here in found.items()
    }
