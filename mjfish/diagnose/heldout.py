"""Held-out trials: scored with everything frozen that was fitted elsewhere.

What belongs to a held-out trial alone (start velocity, free clock) is fitted on its first part only, and that part is
left out of the score: nothing that is scored was ever fitted to.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from mjfish.arrays import FloatArray
from mjfish.identify import Problem, fit
from mjfish.identify.problem import nuisances
from mjfish.trial import Trial

#: Share of a held-out trial on which its nuisance parameters are fitted, where it has any.
PREFIX = 0.25
#: Draws of the block bootstrap of the gain, and the length of a block [s].
_DRAWS = 2000
_BLOCK = 0.7


@dataclass(frozen=True, eq=False)
class Score:
    """Residuals of one model on the held-out trials.

    Attributes:
        residuals: (n_r, 3) per trial, scored samples only, physical units.
        predictions: (n_r, 3) per trial, all samples.
        whitened_sse: sum of squares in the metric of the noise, per trial.
    """

    residuals: tuple[FloatArray, ...]
    predictions: tuple[FloatArray, ...]
    whitened_sse: tuple[float, ...]


@dataclass(frozen=True)
class Gain:
    """Held-out errors of the nominal and of the extended model.

    Attributes:
        nominal: nRMSE per channel and ``pooled`` (their mean): RMSE over the range of the measured channel.
        extended: the same.
        relative_reduction: of the pooled nRMSE.
        low, high: its 95 % interval, by resampling blocks of two to three beats.
        mean_speed_error: nominal and extended |mean surge simulated - measured|, mean over trials [m/s].
    """

    nominal: Mapping[str, float]
    extended: Mapping[str, float]
    relative_reduction: float
    low: float
    high: float
    mean_speed_error: tuple[float, float]


def score(fitted: Problem, values: Mapping[str, float], trials: tuple[Trial, ...]) -> Score:
    """Predict `trials` with the fitted model's values; their nuisance parameters come from their own first part."""
    shared = {p.name: values[p.name] for p in fitted.model.parameters}
    residuals, predictions, sums = [], [], []
    for trial in trials:
        own = nuisances(trial, fitted.free_clock)
        alone = replace(fitted, trials=(trial,), fixed=shared, windows=None)
        x = alone.start()
        if own:
            split = float(trial.time[0] + PREFIX * (trial.time[-1] - trial.time[0]))
            x = fit(replace(alone, windows=((-np.inf, split),)), x).x
            alone = replace(alone, windows=((split, np.inf),))
        residuals.append(alone.raw(x)[0])
        predictions.append(alone.predictions(x)[0])
        whitened = alone.residual(x)
        sums.append(float(whitened @ whitened))
    return Score(tuple(residuals), tuple(predictions), tuple(sums))


def gain(nominal: Score, extended: Score, trials: tuple[Trial, ...], rng: np.random.Generator) -> Gain:
    """Compare two models on the held-out trials."""
    ranges = np.ptp(np.concatenate([trial.velocity for trial in trials]), axis=0)
    blocks = [_blocks(a, b, trial) for a, b, trial in zip(nominal.residuals, extended.residuals, trials, strict=True)]
    sums = np.concatenate(blocks)  # (blocks, 7): squared errors of both models per channel, and the count
    draws = sums[rng.integers(len(sums), size=(_DRAWS, len(sums)))].sum(axis=1)
    reductions = _reduction(draws, ranges)
    before, after = _nrmse(sums.sum(axis=0), ranges)
    low, high = np.quantile(reductions, [0.025, 0.975])
    return Gain(
        nominal=_table(before),
        extended=_table(after),
        relative_reduction=float(_reduction(sums.sum(axis=0)[None], ranges)[0]),
        low=float(low),
        high=float(high),
        mean_speed_error=(_speed_error(nominal), _speed_error(extended)),
    )


def _speed_error(one: Score) -> float:
    return float(np.mean([abs(residual[:, 0].mean()) for residual in one.residuals]))


def _blocks(nominal: FloatArray, extended: FloatArray, trial: Trial) -> FloatArray:
    step = float(np.median(np.diff(trial.time)))
    size = max(round(_BLOCK / step), 1)
    count = max(len(nominal) // size, 1)
    rows = [
        np.concatenate([(a**2).sum(axis=0), (b**2).sum(axis=0), [len(a)]])
        for a, b in zip(np.array_split(nominal, count), np.array_split(extended, count), strict=True)
    ]
    return np.array(rows)


def _nrmse(sums: FloatArray, ranges: FloatArray) -> tuple[FloatArray, FloatArray]:
    count = sums[..., 6:]
    return np.sqrt(sums[..., :3] / count) / ranges, np.sqrt(sums[..., 3:6] / count) / ranges


def _reduction(sums: FloatArray, ranges: FloatArray) -> FloatArray:
    before, after = _nrmse(sums, ranges)
    return np.asarray(1.0 - after.mean(axis=-1) / before.mean(axis=-1))


def _table(nrmse: FloatArray) -> dict[str, float]:
    surge, sway, yaw_rate = (float(v) for v in nrmse)
    return {"surge": surge, "sway": sway, "yaw_rate": yaw_rate, "pooled": float(nrmse.mean())}
