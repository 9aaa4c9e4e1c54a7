"""Held-out trials: the gain on them, with an interval, and what they say of rivals."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, TypeVar

import numpy as np
from scipy import stats

from mjfish.data import Trial
from mjfish.diagnosis.evidence import Evidence
from mjfish.diagnosis.failures import finite, tried
from mjfish.diagnosis.refit_result import Refit
from mjfish.diagnosis.thresholds import THRESHOLDS, Thresholds
from mjfish.estimation.residual import ChannelError, Score, held_out_covariance_root, predict_held_out
from mjfish.numerics.arrays import FloatArray, checked
from mjfish.numerics.formats import fall, less, number, percent
from mjfish.numerics.sized_cache import Recomputable

Key = TypeVar("Key", bound=Hashable)

#: Draws of the block bootstrap of the gain, and the length of a block [s].
_DRAWS = 2000
_BLOCK = 0.7
#: A mean speed that is right to this share of it is right.
_EXACT_SPEED = 0.01
#: A trial is predicted to within noise where a model leaves a mean square below this. One that none predicts does not
#: discriminate between them.
_PREDICTED = 1.25


@dataclass(frozen=True)
class Confirmation:
    """What a cause does on trials to which nothing was fitted.

    Attributes:
        gained: log-likelihood gained there.
        probability: to gain so little, or less, were the extended model true.
        error_ratio: of the pooled nRMSE there to that without it.
        mean_square: of the whitened residual that it leaves there.
        speed_ratio: of the error of the mean speed there to that without it, or to a hundredth of the speed where that
            is larger: one of a few runs may be right by chance. NaN where no speed was measured.
    """

    gained: float
    probability: float
    error_ratio: float = 1.0
    mean_square: float = np.inf
    speed_ratio: float = 1.0

    def misses_speed(self, limits: Thresholds = THRESHOLDS) -> bool:
        """Return whether the mean speed is further off than without the cause, tenfold, and not by noise."""
        return self.speed_ratio > limits.tenfold and self.mean_square > _PREDICTED

    def failed(self, limits: Thresholds = THRESHOLDS) -> bool:
        """Return whether the cause predicts these trials worse than they are without it, by more than noise does."""
        worse = self.error_ratio > 1.0 + limits.remaining and self.mean_square > _PREDICTED
        return worse or self.misses_speed(limits) or (self.gained <= 0.0 and self.probability < limits.goodness)

    def as_well(self) -> bool:
        """Return whether the trials are predicted as well without the cause, by one of both measures."""
        return 2.0 * self.gained < THRESHOLDS.close or self.error_ratio >= 1.0

    def borne_out(self) -> bool:
        """Return whether the cause gains there what it would if it were true, up to noise."""
        return not self.failed() and self.probability >= THRESHOLDS.goodness


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
        """Return the score of a refit, None: of the nominal model.

        Raises:
            FloatingPointError: what the refit predicts is no number.
        """
        if refit not in self.scores:
            of = self.evidence if refit is None else refit
            self.scores[refit] = Recomputable(partial(predict_held_out, of.problem, of.fit.values, self.trials))
        found = self.scores[refit]()
        if refit is not None and not all(np.isfinite(own.residual).all() for trial in found.channels for own in trial):
            raise FloatingPointError("what it predicts of the held-out trials is no number")
        return found

    def predicted(self, refits: Mapping[Key, Refit]) -> dict[Key, Refit]:
        """Return the refits that predict the held-out trials; others fail."""
        return {key: own for key, own in refits.items() if tried(own.names, partial(self.score, own), None) is not None}

    def covariance_root(self, refit: Refit | None) -> FloatArray:
        """Return a root (n, k) of the covariance of a refit's prediction; None: of the nominal model's."""
        if refit not in self.covariance_roots:
            of = self.evidence if refit is None else refit
            self.covariance_roots[refit] = held_out_covariance_root(
                of.problem, of.fit, self.trials, self.score(refit).trial_parameters
            )
        return self.covariance_roots[refit]

    def confirmed(self, refit: Refit, against: Refit | None) -> Confirmation | None:
        """Return what a refit gains on the held-out trials; None where there are none, or this fails."""
        return tried(refit.names, partial(self._confirmed, refit, against), None) if self.trials else None

    def _confirmed(self, refit: Refit, against: Refit | None) -> Confirmation:
        scores = self.score(against), self.score(refit)
        before, after = (pooled_error(score.channels) for score in scores)
        (without, speed), (error, _) = (_mean_speed(score.channels) for score in scores)
        found = confirmation(*scores, (self.covariance_root(against), self.covariance_root(refit)))
        finite("the held-out trials", gained=found.gained, probability=found.probability, before=before, after=after)
        left = float(np.mean(np.concatenate(scores[1].whitened) ** 2))
        ratio = error / max(without, _EXACT_SPEED * speed, 1e-300)
        return replace(found, error_ratio=after / before, mean_square=left, speed_ratio=ratio)

    def of_rivals(self, refits: Mapping[Key, Refit]) -> dict[Key, FloatArray]:
        """Return the residuals (n,) of rivals on the held-out trials that one of them predicts, to compare them.

        In the metric of the noise and of what the fit left open, (I + D D')^(-1/2), where they are white, were a rival
        true; D of the one that explains most stands for all. So whitened, they go on where those of the fit end: the
        likelihood of all trials is that of the fitted ones times that of the others, given these.
        """
        if not self.trials or len(refits) < 2:
            return {name: np.zeros(0) for name in refits}
        best = max(refits.values(), key=lambda refit: refit.adjusted)
        residuals = [np.concatenate(self.score(refit).whitened) for refit in refits.values()]
        covariance_root = tried(best.names, partial(self.covariance_root, best), np.zeros((len(residuals[0]), 0)))
        basis, size, _ = np.linalg.svd(covariance_root, full_matrices=False)
        shrink = basis * (1.0 - 1.0 / np.sqrt(1.0 + checked(size) ** 2))
        white = np.stack([residual - shrink @ (basis.T @ residual) for residual in residuals])
        ends = np.cumsum([len(residual) for residual in self.score(next(iter(refits.values()))).whitened])[:-1]
        informative = [block for block in np.split(white, ends, axis=1) if np.mean(block**2, axis=1).min() < _PREDICTED]
        return dict(zip(refits, np.concatenate([white[:, :0], *informative], axis=1), strict=True))


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

    @property
    def change(self) -> str:
        """By how much the pooled nRMSE falls, or grows, with the interval."""
        shown = less if self.low < 0.0 else percent
        return f"{less(self.relative_reduction)} ({shown(self.low)} to {shown(self.high)})"

    @property
    def rows(self) -> list[tuple[str, tuple[float, float], tuple[str, str], str]]:
        """Errors of both models by channel, ``pooled``, and ``mean_speed``; these in words; and how they change."""
        both = {name: (before, self.extended[name]) for name, before in self.nominal.items()}
        changes = {name: fall(*errors) for name, errors in both.items()} | {"pooled": self.change}
        told = [(name, e, (percent(e[0]), percent(e[1])), changes[name]) for name, e in both.items()]
        before, after = self.mean_speed_error
        return [
            *told,
            ("mean_speed", (before, after), (f"{number(before)} m/s", f"{number(after)} m/s"), fall(before, after)),
        ]

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
    reach = _reach(nominal.channels)
    blocks = [_blocks(a, b, list(reach)) for a, b in zip(nominal.channels, extended.channels, strict=True)]
    sums = np.concatenate(blocks)  # (blocks, 3, channels): squared errors of both models, and the count
    draws = sums[rng.integers(len(sums), size=(_DRAWS, len(sums)))].sum(axis=1)
    ranges = np.array([*reach.values()])
    low, high = np.nanquantile(_reduction(draws, ranges), [0.025, 0.975])
    pairs = [*zip(trials, nominal.channels, extended.channels, strict=True)]
    return Gain(
        nominal=_table(nominal.channels),
        extended=_table(extended.channels),
        relative_reduction=float(_reduction(sums.sum(axis=0)[None], ranges)[0]),
        low=float(low),
        high=float(high),
        mean_speed_error=(_mean_speed(nominal.channels)[0], _mean_speed(extended.channels)[0]),
        by_run=tuple(
            RunGain(trial.name, _table([before]), _table([after]), (_mean_speed([before])[0], _mean_speed([after])[0]))
            for trial, before, after in pairs
        ),
    )


#: What is left of the channels of trials.
Left = Sequence[Sequence[ChannelError]]


def pooled_error(left: Left) -> float:
    """Return the nRMSE, mean over channels: RMSE over the range of the measured channel in these trials."""
    return float(np.mean([*_errors(left).values()]))


def _by_channel(left: Left) -> dict[str, list[ChannelError]]:
    found: dict[str, list[ChannelError]] = {}
    for own in (own for trial in left for own in trial):
        found.setdefault(own.name, []).append(own)
    return found


def _reach(left: Left) -> dict[str, float]:
    """Return the range of each channel; infinite where one stands still: its errors do not count."""
    found = {}
    for name, every in _by_channel(left).items():
        reach = max(own.ends[1] for own in every) - min(own.ends[0] for own in every)
        found[name] = reach if reach > 0.0 else np.inf
    return found


def _errors(left: Left) -> dict[str, float]:
    reach = _reach(left)
    return {
        name: float(np.sqrt(np.mean(np.concatenate([own.residual for own in every]) ** 2)) / reach[name])
        for name, every in _by_channel(left).items()
    }


def _mean_speed(left: Left) -> tuple[float, float]:
    """Return |mean speed simulated - measured| and the measured one [m/s], means over trials.

    Of the surge, or of the way from end to end; NaN where neither was measured.
    """
    found = []
    for trial in left:
        own = {error.name.rpartition(" ")[2]: error for error in trial}
        if "surge" in own:
            found.append((abs(float(own["surge"].residual.mean())), abs(float(own["surge"].measured.mean()))))
        elif {"x", "y"} <= own.keys():
            ways = [_way(own["x"], own["y"], share) / float(np.ptp(own["x"].time)) for share in (0.0, 1.0)]
            found.append((abs(ways[0] - ways[1]), ways[0]))
    error, speed = np.mean(found, axis=0) if found else (np.nan, np.nan)
    return float(error), float(speed)


def _way(x: ChannelError, y: ChannelError, share: float) -> float:
    """Return the distance [m] from the first to the last sample, less a share of what is left of them."""
    ends = [own.measured[[0, -1]] - share * own.residual[[0, -1]] for own in (x, y)]
    return float(np.hypot(ends[0][1] - ends[0][0], ends[1][1] - ends[1][0]))


def _blocks(nominal: Sequence[ChannelError], extended: Sequence[ChannelError], names: list[str]) -> FloatArray:
    """Return sums (blocks, 3, channels) over blocks of `_BLOCK` of one trial."""
    first, last = min(own.time[0] for own in nominal), max(own.time[-1] for own in nominal)
    count = max(int((last - first) / _BLOCK), 1)
    sums = np.zeros((count, 3, len(names)))
    for before, after in zip(nominal, extended, strict=True):
        at = np.minimum(((before.time - first) / (last - first) * count).astype(np.intp), count - 1)
        for row, values in enumerate((before.residual**2, after.residual**2, np.ones(len(at)))):
            np.add.at(sums[:, row, names.index(before.name)], at, values)
    return sums


def _reduction(sums: FloatArray, ranges: FloatArray) -> FloatArray:
    with np.errstate(invalid="ignore"):  # blocks drawn without any sample of a channel
        before, after = (np.sqrt(sums[:, row] / sums[:, 2]) / ranges for row in (0, 1))
    return np.asarray(1.0 - np.nanmean(after, axis=-1) / np.nanmean(before, axis=-1))


def _table(left: Left) -> dict[str, float]:
    return {**_errors(left), "pooled": pooled_error(left)}
