"""Residuals of one trial with what is needed to judge them: which samples count, which are scored, where gaps are."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mjfish.arrays import BoolArray, FloatArray
from mjfish.data import Role, Trial
from mjfish.estimation.held_out import predict_held_out
from mjfish.estimation.problem import Problem


@dataclass(frozen=True, eq=False)
class Residual:
    """Measured minus predicted velocities of one trial.

    Attributes:
        trial: that was predicted.
        role: ``fit`` or ``held_out``.
        predicted: (n, 3) at all its samples; NaN after a divergence.
        counted: (n,) samples that the fit looks at; a predictor may feed them back.
        scored: (n,) those of them that are scored; of a held-out trial, without the part that its own nuisance
            parameters were fitted on.
    """

    trial: Trial
    role: Role
    predicted: FloatArray
    counted: BoolArray
    scored: BoolArray

    @property
    def diverged(self) -> bool:
        """Whether the rollout did not reach every sample that counts."""
        return not bool(np.all(np.isfinite(self.predicted[self.counted])))

    @property
    def values(self) -> FloatArray:
        """Residuals (n, 3) in physical units; NaN where a sample is missing or does not count."""
        return np.where(self.counted[:, None], self.trial.velocity - self.predicted, np.nan)

    @property
    def rows(self) -> NDArray[np.intp]:
        """Row (n,) of every sample on a grid of equal intervals: rows of lost samples are skipped."""
        return self.trial.rows

    def on_grid(self, block: FloatArray) -> FloatArray:
        """Spread a block (n, ...) over the grid: (m, ...), NaN between."""
        spread = np.full((int(self.rows[-1]) + 1, *block.shape[1:]), np.nan)
        spread[self.rows] = block
        return spread


def fitted(problem: Problem, x: FloatArray) -> tuple[Residual, ...]:
    """Return the residuals of the trials of a problem at `x`; all counted samples are scored."""
    return tuple(
        Residual(trial, "fit", predicted, problem.mask(i), problem.mask(i))
        for i, (trial, predicted) in enumerate(zip(problem.trials, problem.predictions(x), strict=True))
    )


def held_out(problem: Problem, values: Mapping[str, float], trials: tuple[Trial, ...]) -> tuple[Residual, ...]:
    """Return the residuals of held-out trials, predicted as `mjfish.estimation.predict_held_out` does.

    The part that a trial's own nuisance parameters were fitted on counts, for it was measured before what is
    scored, but is not scored.
    """
    score = predict_held_out(problem, values, trials)
    result = []
    for trial, left, predicted in zip(trials, score.residuals, score.predictions, strict=True):
        counted = replace(problem, trials=(trial,), windows=None).mask(0)
        scored = np.zeros_like(counted)
        scored[np.flatnonzero(counted)[-len(left) :]] = True
        result.append(Residual(trial, "held_out", predicted, counted, scored))
    return tuple(result)
