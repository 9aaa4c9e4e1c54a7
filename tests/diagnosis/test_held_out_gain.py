"""The gain on held-out trials, from residuals that are made up; and what they say of rivals, of straight lines."""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hidden_cases import draw

from mjfish.data import Trial
from mjfish.diagnosis import select
from mjfish.diagnosis.conclusion import _misleading
from mjfish.diagnosis.failures import Parts, noting
from mjfish.diagnosis.held_out import HeldOut, gain, pooled_error
from mjfish.diagnosis.thresholds import THRESHOLDS
from mjfish.diagnosis.verdict import errs
from mjfish.estimation.residual import ChannelError, Score
from mjfish.fish.frames import CHANNELS, UNITS
from mjfish.numerics.arrays import FloatArray, readonly
from mjfish.numerics.sized_cache import always


@pytest.fixture(scope="module")
def trial() -> Trial:
    return draw("time_offset", "middling", trials=2).dataset.trials[0]


def _score(residual: np.ndarray, trial: Trial) -> Score:
    """Return what is left of the velocities of a trial."""
    return Score((residual,), (residual,), (residual.ravel(),), channels=(_left(residual, trial),))


def _left(residual: np.ndarray, trial: Trial) -> tuple[ChannelError, ...]:
    columns = zip(CHANNELS, trial.velocity.T, residual.T, strict=True)
    return tuple(
        ChannelError(name, UNITS[name], trial.time, own, left, (float(own.min()), float(own.max())))
        for name, own, left in columns
    )


def test_errors_that_are_half_are_a_gain_of_half(trial: Trial) -> None:
    before = np.random.default_rng(1).standard_normal(trial.velocity.shape)
    found = gain(_score(before, trial), _score(0.5 * before, trial), (trial,), np.random.default_rng(2))
    assert found.relative_reduction == pytest.approx(0.5)
    assert (found.low, found.high) == pytest.approx((0.5, 0.5))
    for channel, error in found.nominal.items():
        assert found.extended[channel] == pytest.approx(0.5 * error)


def test_a_channel_that_stands_still_does_not_count(trial: Trial) -> None:
    """It has no range to relate its error to."""
    velocity = trial.velocity.copy()
    velocity[:, 2] = 0.0
    still = replace(trial, velocity=readonly(velocity))
    before = np.random.default_rng(1).standard_normal(velocity.shape)
    found = gain(_score(before, still), _score(0.5 * before, still), (still,), np.random.default_rng(2))
    assert found.nominal["yaw_rate"] == 0.0
    assert found.relative_reduction == pytest.approx(0.5)
    assert pooled_error([_left(before, still)]) == pytest.approx(found.nominal["pooled"])
    assert np.isfinite([found.low, found.high]).all()


@dataclass(frozen=True, eq=False)
class _Linear:
    """A rival that is a straight line through data (40,) of which one column is its own."""

    columns: FloatArray
    data: FloatArray
    names: tuple[str, ...] = ("linear",)
    effects: tuple[Any, ...] = ()
    mechanisms: tuple[str, ...] = ()
    learned: bool = False
    gain: float = 0.0
    degrees_of_freedom: int = 1
    promise: float = 0.0

    @property
    def problem(self) -> Any:
        return SimpleNamespace(trial_rows=[np.arange(20), np.arange(20, 40)])

    @property
    def size(self) -> FloatArray:
        return np.asarray(np.linalg.lstsq(self.columns, self.data, rcond=None)[0])

    @property
    def fit(self) -> Any:
        return SimpleNamespace(residual=self.data - self.columns @ self.size, count=len(self.data), status="converged")

    @property
    def adjusted(self) -> float:
        return -float(self.fit.residual @ self.fit.residual)


@dataclass(frozen=True, eq=False)
class _Named:
    """Stands for a refit."""

    names: tuple[str, ...]


def test_a_model_that_swims_at_another_speed_fails_whatever_its_error(trial: Trial) -> None:
    """Three quarters of the error, at another speed on average: so many times further off than the nominal model."""
    noise = np.random.default_rng(1).standard_normal(trial.velocity.shape)
    noise -= noise.mean(axis=0)
    refit: Any = _Named(("slow",))
    for error, fails in ((0.8, True), (0.1, False)):
        held_out, bias = HeldOut(None, (trial,)), np.array([1.0, 0.0, 0.0])  # type: ignore[arg-type]
        for model, left in ((None, 2.0 * noise + 0.02 * bias), (refit, 1.5 * noise + error * bias)):
            held_out.scores[model] = always(_score(left, trial))  # type: ignore[index]
            held_out.covariance_roots[model] = np.zeros((left.size, 0))  # type: ignore[index]
        confirmed = held_out.confirmed(refit, None)  # type: ignore[arg-type]
        assert confirmed is not None
        assert confirmed.error_ratio < 1.0
        assert confirmed.speed_ratio == pytest.approx(50.0 * error)
        assert confirmed.failed() is fails
        told = _misleading(refit, held_out)  # type: ignore[arg-type]
        assert told == (f" The nominal model is kept, for with slow {errs(confirmed)}." if fails else "")
        assert ("its mean speed there is 40.0 times further off" in told) is fails


def _rivals(rng: np.random.Generator, strays: float = 0.0) -> tuple[dict[str, Any], HeldOut]:
    """Return two rivals, similar on the fitted rows and apart on one of two held-out trials; the first is true."""
    shared, own, other = RIVALS[:, :3], RIVALS[:, 3:4], RIVALS[:, 4:5]
    truth = (shared @ np.array([1.0, -2.0, 0.5]))[:, None] + 6.0 * own
    data = truth[:, 0] + rng.standard_normal(120)
    data[80:] += strays * rng.standard_normal(40)
    refits = {name: _Linear(np.hstack([shared, one])[:40], data[:40]) for name, one in (("a", own), ("b", other))}
    held_out = HeldOut(None, (None, None))  # type: ignore[arg-type]
    for refit, last in zip(refits.values(), (own, other), strict=True):
        columns = np.hstack([shared, last])
        residual = (data - columns @ refit.size)[40:]
        held_out.scores[refit] = always(Score((), (), (residual[:40], residual[40:])))  # type: ignore[index]
        inverse = np.linalg.inv(columns[:40].T @ columns[:40])
        held_out.covariance_roots[refit] = columns[40:] @ np.linalg.cholesky(inverse)  # type: ignore[index]
    return refits, held_out


def _drawn_columns() -> FloatArray:
    columns = np.random.default_rng(3).standard_normal((120, 5))
    columns[:80, 4] = columns[:80, 3] + 0.15 * columns[:80, 4]
    columns[80:, 4] = 0.7 * columns[80:, 3] + 0.7 * columns[80:, 4]
    columns[:, 3:] /= np.sqrt(40.0)
    return columns


RIVALS = _drawn_columns()


def test_held_out_trials_separate_rivals_and_seldom_reject_the_true_one() -> None:
    """The true one stays in 95 of 100, the other leaves far more often than by the fitted rows alone.

    Catches held-out residuals taken for white, or for free of what the fit left open.
    """
    rng = np.random.default_rng(11)
    kept = {True: np.zeros(2), False: np.zeros(2)}
    for _ in range(300):
        refits, held_out = _rivals(rng)
        for heard in (True, False):
            rows = select._rivalry(refits, held_out if heard else HeldOut(None, ()))  # type: ignore[arg-type]
            kept[heard] += [rows[name].rival_p >= THRESHOLDS.keep for name in refits]
    assert np.all([one[0] > 0.9 * 300 for one in kept.values()]), kept
    assert kept[True][1] < 0.3 * 300 < 0.65 * 300 < kept[False][1], kept


def test_rivals_are_compared_alike_however_many_rows_at_a_time(monkeypatch: pytest.MonkeyPatch) -> None:
    def compared() -> list[float]:
        rng = np.random.default_rng(58)
        return [row.rival_p for row in select._rivalry(*_rivals(rng)).values()]

    at_once = compared()
    monkeypatch.setattr(select, "_ROWS", 7)
    assert compared() == pytest.approx(at_once, abs=0.002)
    assert 0.01 < min(at_once) < 0.9


def test_nothing_beats_the_best_wherever_it_stands() -> None:
    """Catches rounded margins that are 0: they were 1e-5 here, and the best lost to itself in half the draws."""
    for seed in range(4):
        columns = np.random.default_rng(seed).standard_normal((40, 6))
        data = 1e3 * columns[:, 2]
        refits = {str(k): _Linear(columns[:, k : k + 1], data) for k in range(6)}
        rows = select._rivalry(refits, HeldOut(None, ()))  # type: ignore[arg-type]
        assert rows["2"].behind == 0.0
        assert rows["2"].rival_p == 1.0


def test_how_often_a_rival_is_the_best_without_one_run_is_told() -> None:
    """Each run of the two alone favours the other rival: whichever is left out, that of the one that stays is best."""
    apart = np.concatenate([np.full(20, 0.1), np.full(20, -0.1)])
    shared = np.ones((40, 1))
    data = np.concatenate([np.full(20, 2.0), np.full(20, 1.0)])
    first, second = (np.where(np.arange(40) < 20, *pair)[:, None] for pair in ((1.0, 0.0), (0.0, 1.0)))
    refits = {"a": _Linear(first, data), "b": _Linear(second, data), "c": _Linear(shared + apart[:, None], data)}
    rows = select._rivalry(refits, HeldOut(None, ()))  # type: ignore[arg-type]
    assert [rows[name].chosen for name in refits] == [0.5, 0.5, 0.0]
    assert sum(row.chosen for row in rows.values()) == 1.0


def test_a_held_out_trial_that_no_rival_predicts_does_not_count() -> None:
    """Swapped labels, say: whom such a trial favours is chance."""
    for strays, counted in ((0.0, 80), (10.0, 40)):
        refits, held_out = _rivals(np.random.default_rng(12), strays)
        assert {len(of_rival) for of_rival in held_out.of_rivals(refits).values()} == {counted}


class _Wild:
    names = ("wild",)


def test_a_refit_that_predicts_no_number_fails_alone(trial: Trial) -> None:
    """Catches a diagnosis that ends where one of its candidates runs away on the held-out trials."""
    refit, held_out = _Wild(), HeldOut(None, (trial,))  # type: ignore[arg-type]
    residual = np.zeros(trial.velocity.shape)
    held_out.scores[None] = always(_score(residual, trial))
    residual[-1, 0] = np.nan
    held_out.scores[refit] = always(_score(residual, trial))  # type: ignore[index]
    with noting(Parts()) as parts:
        assert held_out.confirmed(refit, None) is None  # type: ignore[arg-type]
        assert held_out.predicted({"wild": refit}) == {}  # type: ignore[dict-item]
    assert list(parts.failures) == ["wild"]
    assert "what it predicts of the held-out trials is no number" in parts.failures["wild"]
