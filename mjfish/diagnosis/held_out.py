"""Held-out trials: the gain on them, with an interval, and what they say of rivals."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, TypeVar

import numpy as np
from scipy import stats

from mjfish.arrays import FloatArray, checked
from mjfish.data import Trial
from mjfish.diagnosis.evidence import Evidence
from mjfish.diagnosis.failures import blamed, finite
from mjfish.diagnosis.refit_result import Refit
from mjfish.estimation.residual import Score, held_out_covariance_root, predict_held_out
from mjfish.sized_cache import Remade

Key = TypeVar("Key", bound=Hashable)

#: Draws of the block bootstrap of the gain, and the length of a block [s].
_DRAWS = 2000
_BLOCK = 0.7
#: A cause fails on held-out trials where it loses likelihood there, with a probability below this if it were true.
#: They bear it out where the probability of so small a gain is not below it.
_FAILED = 0.001
#: Or where its error there is this much larger than without it, whatever the likelihood allows for.
_WORSE = 1.1
#: A trial on which every model leaves a mean square above this does not discriminate between them.
_PREDICTED = 1.25


@dataclass(frozen=True)
class Confirmation:
    """What a cause does on trials to which nothing was fitted.

    Attributes:
        gained: log-likelihood gained there.
        probability: to gain so little, or less, were the extended model true.
        error_ratio: of the pooled nRMSE there to that without it.
    """

    gained: float
    probability: float
    error_ratio: float = 1.0

    @property
    def failed(self) -> bool:
        """Whether the cause predicts these trials worse than they are without it, by more than noise does."""
        return (self.gained <= 0.0 and self.probability < _FAILED) or self.error_ratio > _WORSE

    @property
    def borne_out(self) -> bool:
        """Whether the cause gains there what it would if it were true, up to noise."""
        return not self.failed and self.probability >= _FAILED


def confirmation(
    nominal: Score, extended: Score, covariance_roots: tuple[FloatArray, FloatArray] | None = None
) -> Confirmation:
    """Compare two models on held-out trials.

    With whitened predictions apart by d and the extended model true, the sum of squares falls by |d|^2 + 2 d' (eps - e)
    with the noise eps and the error e = D u, u ~ N(0, 1), that the extended prediction has from what was fitted; its
    variance is 4 (|d|^2 + |D' d|^2). As d has e in it, and of the nominal prediction e_0, the mean is
    |d|^2 - 2 (|D|^2 - |D_0|^2): exact of linear models, one within the other.

    Args:
        nominal, extended: of the models.
        covariance_roots: D_0 and D, `mjfish.estimation.held_out_covariance_root` of both models; None: both are known.
    """
    before, after = np.concatenate(nominal.whitened), np.concatenate(extended.whitened)
    apart = before - after
    mean = variance = float(apart @ apart)
    if covariance_roots is not None:
        mean -= 2.0 * max(float(np.sum(covariance_roots[1] ** 2) - np.sum(covariance_roots[0] ** 2)), 0.0)
        variance += float(np.sum((covariance_roots[1].T @ apart) ** 2))
    here = float(before @ before - after @ after)
    return Confirmation(0.5 * here, float(stats.norm.cdf((here - mean) / (2.0 * np.sqrt(max(variance, 1e-300))))))


class HeldOut:
    """What the nominal model and its refits predict of the held-out trials, each computed once.

    Args:
        evidence: of the nominal model.
        trials: held out.
    """

    def __init__(self, evidence: Evidence, trials: tuple[Trial, ...]) -> None:
        self.evidence, self.trials = evidence, trials
        self.scores: dict[Refit | None, Callable[[], Score]] = {}
        self.covariance_roots: dict[Refit | None, FloatArray] = {}

    def score(self, refit: Refit | None) -> Score:
        """Return the score of a refit, None: of the nominal model."""
        if refit not in self.scores:
            of = self.evidence if refit is None else refit
            self.scores[refit] = Remade(partial(predict_held_out, of.problem, of.fit.values, self.trials))
        with _of(refit):
            return self.scores[refit]()

    def covariance_root(self, refit: Refit | None) -> FloatArray:
        """Return a root (n, k) of the covariance of a refit's prediction; None: of the nominal model's."""
        if refit not in self.covariance_roots:
            of = self.evidence if refit is None else refit
            with _of(refit):
                self.covariance_roots[refit] = held_out_covariance_root(of.problem, of.fit, self.trials)
        return self.covariance_roots[refit]

    def confirmed(self, refit: Refit, against: Refit | None) -> Confirmation | None:
        """Return what a refit gains on the held-out trials; None where there are none."""
        if not self.trials:
            return None
        scores = self.score(against), self.score(refit)
        before, after = (pooled_error(score.residuals, self.trials) for score in scores)
        found = confirmation(*scores, (self.covariance_root(against), self.covariance_root(refit)))
        finite("the held-out trials", found.gained, found.probability, before, after)
        return replace(found, error_ratio=after / before)

    def of_rivals(self, refits: Mapping[Key, Refit]) -> dict[Key, FloatArray]:
        """Return the residuals (n,) of rivals on the held-out trials that one of them predicts, to compare them.

        In the metric of the noise and of what the fit left open, (I + D D')^(-1/2), where they are white, were a rival
        true; D of the one that explains most stands for all. So whitened, they go on where those of the fit end: the
        likelihood of all trials is that of the fitted ones times that of the others, given these.
        """
        if not self.trials or len(refits) < 2:
            return {name: np.zeros(0) for name in refits}
        covariance_root = self.covariance_root(max(refits.values(), key=lambda refit: refit.adjusted))
        basis, size, _ = np.linalg.svd(covariance_root, full_matrices=False)
        shrink = basis * (1.0 - 1.0 / np.sqrt(1.0 + checked(size) ** 2))
        residuals = {name: np.concatenate(self.score(residual).whitened) for name, residual in refits.items()}
        white = np.stack([residual - shrink @ (basis.T @ residual) for residual in residuals.values()])
        ends = np.cumsum([len(residual) for residual in self.score(next(iter(refits.values()))).whitened])[:-1]
        informative = [block for block in np.split(white, ends, axis=1) if np.mean(block**2, axis=1).min() < _PREDICTED]
        return dict(zip(refits, np.concatenate([white[:, :0], *informative], axis=1), strict=True))


def _of(refit: Refit | None) -> AbstractContextManager[None]:
    """Return a context in which what is raised is a failure of the refit's last cause."""
    return nullcontext() if refit is None else blamed(refit.names[-1])


@dataclass(frozen=True)
class RunGain:
    """What one held-out run gains.

    Attributes:
        trial: its name.
        nominal: nRMSE per channel and ``pooled`` (their mean): RMSE over the range of the channel in this run.
        extended: the same.
        mean_speed_error: nominal and extended |mean surge simulated - measured| [m/s].
    """

    trial: str
    nominal: Mapping[str, float]
    extended: Mapping[str, float]
    mean_speed_error: tuple[float, float]


@dataclass(frozen=True)
class Gain:
    """Held-out errors of the nominal and of the extended model.

    Attributes:
        nominal: nRMSE per channel and ``pooled`` (their mean): RMSE over the range of the measured channel.
        extended: the same.
        relative_reduction: of the pooled nRMSE.
        low, high: its 95 % interval, by resampling blocks of 0.7 s.
        mean_speed_error: nominal and extended |mean surge simulated - measured|, mean over trials [m/s].
        by_run: errors run by run, each over its own ranges: those of all runs together flatter one that swims slowly.
    """

    nominal: Mapping[str, float]
    extended: Mapping[str, float]
    relative_reduction: float
    low: float
    high: float
    mean_speed_error: tuple[float, float]
    by_run: tuple[RunGain, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """Return the gain as ``diagnosis.json`` has it."""
        return {
            "held_out": {"nominal": dict(self.nominal), "extended": dict(self.extended)},
            "relative_reduction": {"estimate": self.relative_reduction, "low": self.low, "high": self.high},
            "mean_speed_error": _speeds(self.mean_speed_error),
            "by_run": [
                {
                    "trial": run.trial,
                    "nominal": dict(run.nominal),
                    "extended": dict(run.extended),
                    "mean_speed_error": _speeds(run.mean_speed_error),
                }
                for run in self.by_run
            ],
        }


def _speeds(errors: tuple[float, float]) -> dict[str, Any]:
    return {"nominal": errors[0], "extended": errors[1], "unit": "m/s"}


def gain(nominal: Score, extended: Score, trials: tuple[Trial, ...], rng: np.random.Generator) -> Gain:
    """Compare two models on the held-out trials."""
    ranges = _ranges(trials)
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
        mean_speed_error=(_speed_error(nominal.residuals), _speed_error(extended.residuals)),
        by_run=tuple(
            RunGain(
                trial=trial.name,
                nominal=_table(_errors([before], [trial])),
                extended=_table(_errors([after], [trial])),
                mean_speed_error=(_speed_error([before]), _speed_error([after])),
            )
            for trial, before, after in zip(trials, nominal.residuals, extended.residuals, strict=True)
        ),
    )


def pooled_error(residuals: Sequence[FloatArray], trials: Sequence[Trial]) -> float:
    """Return the nRMSE of residuals (n_r, 3), mean over channels: RMSE over the range of the measured channel."""
    return float(np.mean(_errors(residuals, trials)))


def _errors(residuals: Sequence[FloatArray], trials: Sequence[Trial]) -> FloatArray:
    """Return the nRMSE (3,) of residuals (n_r, 3): RMSE over the range of the measured channel in these trials."""
    return np.asarray(np.sqrt(np.mean(np.concatenate(residuals) ** 2, axis=0)) / _ranges(trials))


def _ranges(trials: Sequence[Trial]) -> FloatArray:
    """Return the range (3,) of the measured channels; infinite where one stands still: its errors do not count."""
    ranges = np.ptp(np.concatenate([trial.velocity for trial in trials]), axis=0)
    return np.where(ranges > 0.0, ranges, np.inf)


def _speed_error(residuals: Sequence[FloatArray]) -> float:
    return float(np.mean([abs(residual[:, 0].mean()) for residual in residuals]))


def _blocks(nominal: FloatArray, extended: FloatArray, trial: Trial) -> FloatArray:
    step = trial.step
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
