"""Held-out trials: nothing that is scored was fitted to, and nothing held out moves the fit."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
from pike_coefficients import COEFFICIENTS
from synthetic_swimming import SIGMA, TRUTH, as_measured, problem, shifted, swimming

from mjfish.data import Dataset, Trial
from mjfish.estimation import Problem, Score, fit, held_out_covariance_root, identify, predict_held_out
from mjfish.estimation.problem import nuisances
from mjfish.estimation.residual import PREFIX, channel_errors
from mjfish.estimation.settings import Settings
from mjfish.fish import Fish
from mjfish.model import MARGIN, Prediction
from mjfish.numerics.arrays import FloatArray, readonly


@pytest.fixture(scope="module")
def synthetic(pike: Fish) -> Dataset:
    return swimming(pike, ("v1", "v3", "v5"), duration=3.0, held_out=["v3"])


@pytest.fixture(scope="module")
def measured(synthetic: Dataset, pike: Fish) -> Trial:
    """A held-out recording with nuisance parameters."""
    return replace(as_measured(synthetic.trials[1], pike), role="held_out")


def _score(synthetic: Dataset, trial: Trial, *, free_clock: bool = False) -> Score:
    return predict_held_out(problem(synthetic, free_clock=free_clock), TRUTH, (trial,))


def _sse(score: Score) -> float:
    """Return the sum of squares of the whitened residual of the first trial."""
    return float(score.whitened[0] @ score.whitened[0])


def _split(start: float, end: float, margin: float = 0.0) -> float:
    """Return where the fitted part ends, of the samples that count."""
    return start + margin + PREFIX * (end - start - 2.0 * margin)


def _corrupted(trial: Trial, where: FloatArray) -> Trial:
    velocity = trial.velocity.copy()
    velocity[where] += 7.0
    return replace(trial, velocity=readonly(velocity))


def test_a_trial_without_nuisance_parameters_is_scored_whole(synthetic: Dataset) -> None:
    trial = synthetic.trials[1]
    score = _score(synthetic, trial)
    predicted = problem(synthetic).model.predict(trial, TRUTH).velocity
    np.testing.assert_array_equal(score.predictions[0], predicted)
    np.testing.assert_allclose(score.residuals[0], trial.velocity - predicted, rtol=0.0, atol=1e-14)
    assert _sse(score) == pytest.approx(float(np.sum((score.residuals[0] / SIGMA) ** 2)), rel=1e-12)


def test_what_is_scored_does_not_move_the_prediction(synthetic: Dataset, measured: Trial) -> None:
    """The start is fitted on the first quarter; garbage in the rest leaves the prediction as it was, bitwise."""
    honest = _score(synthetic, measured)
    late = _score(synthetic, _corrupted(measured, measured.time > _split(1.0, 3.0, MARGIN) + 1e-9))
    assert late.predictions[0].tobytes() == honest.predictions[0].tobytes()
    assert _sse(late) > 100.0 * _sse(honest)


def test_what_is_fitted_is_not_scored_not_even_the_sample_at_the_split(synthetic: Dataset, measured: Trial) -> None:
    whole = synthetic.trials[1]
    trial = replace(whole, time=whole.time[:121], velocity=whole.velocity[:121])
    assert trial.time[30] == _split(0.0, 2.4)
    assert len(_score(synthetic, trial, free_clock=True).residuals[0]) == 90
    behind = (measured.time > _split(1.0, 3.0, MARGIN)) & (measured.time <= 3.0 - MARGIN + 1e-9)
    assert len(_score(synthetic, measured).residuals[0]) == np.count_nonzero(behind)


def test_a_trial_of_one_beat_is_long_enough(synthetic: Dataset, measured: Trial) -> None:
    """Its ends do not count; what is left has a first part all the same."""
    short = replace(
        measured,
        time=measured.time[:20],
        velocity=measured.velocity[:20],
        joint_angle=None if measured.joint_angle is None else measured.joint_angle[:20],
    )
    score = _score(synthetic, short)
    assert 3 <= len(score.residuals[0]) < 9
    assert np.all(np.isfinite(score.residuals[0]))


def test_the_start_velocity_of_a_held_out_trial_is_found_from_its_first_part(
    synthetic: Dataset, measured: Trial, pike: Fish
) -> None:
    """A first sample that is way off is no lasting harm: the fit looks at the whole first part."""
    wrong = _corrupted(measured, measured.time < 1.0 + 1e-9)
    wrong = replace(wrong, velocity=readonly(np.where(wrong.velocity > 6.0, measured.velocity + 0.05, wrong.velocity)))
    honest, found = _score(synthetic, measured), _score(synthetic, wrong)
    assert _sse(found) == pytest.approx(_sse(honest), rel=0.05)
    unit = honest.residuals[0] / SIGMA
    assert np.mean(unit**2) < 1.5


def test_a_free_clock_of_a_held_out_trial_is_found_from_its_first_part(synthetic: Dataset) -> None:
    late = shifted(synthetic.trials[1], 4)
    free = _score(synthetic, late, free_clock=True)
    assert np.mean((free.residuals[0] / SIGMA) ** 2) < 1.3
    assert len(free.residuals[0]) == np.count_nonzero(late.time > PREFIX * late.time[-1])
    assert np.mean((_score(synthetic, late).residuals[0] / SIGMA) ** 2) > 3.0


def test_fixed_parameters_hold_for_held_out_trials_too(synthetic: Dataset) -> None:
    fixed = {"c_m.head": TRUTH["c_m.head"]}
    free = {name: value for name, value in TRUTH.items() if name not in fixed}
    score = predict_held_out(problem(synthetic, fixed=fixed), free, (synthetic.trials[1],))
    assert score.predictions[0].tobytes() == _score(synthetic, synthetic.trials[1]).predictions[0].tobytes()


def test_a_held_out_trial_has_no_say_in_the_fit(synthetic: Dataset) -> None:
    """Garbage in it, or its absence, leaves every estimate as it was, bitwise."""
    garbage = _corrupted(synthetic.trials[1], np.arange(151) > 2)
    fits = [
        identify(replace(synthetic, trials=trials), Settings(starts=1), jobs=1).fit
        for trials in (
            synthetic.trials,
            (synthetic.trials[0], garbage, synthetic.trials[2]),
            (synthetic.trials[0], synthetic.trials[2]),
        )
    ]
    assert fits[1].x.tobytes() == fits[2].x.tobytes() == fits[0].x.tobytes()
    assert fits[1].covariance.tobytes() == fits[0].covariance.tobytes()
    assert [p.name for p in fits[0].parameters] == list(COEFFICIENTS)


@pytest.mark.parametrize(("clock", "step", "close"), [(False, 1e-4, 1e-3), (True, 1e-3, 5e-3)])
def test_the_doubt_about_a_prediction_is_that_of_the_fit(
    synthetic: Dataset, measured: Trial, clock: bool, step: float, close: float
) -> None:
    """D D' = J C J' + J_o C_o J_o', J by differences, a clock of the held-out trial fitted anew at each of them.

    J_o is the derivative by the clock. Fits of a clock end within 1e-6 of their cost: differences are wider then.
    """
    trial = measured if clock else synthetic.trials[1]
    fitted = problem(synthetic, free_clock=clock)
    found = fit(problem(synthetic), tolerance=1e-6)
    own = predict_held_out(fitted, found.values, (trial,)).trial_parameters
    doubt = held_out_covariance_root(fitted, found, (trial,), own)
    slopes = []
    for i, p in enumerate(found.parameters):
        sides = []
        for by in (-step, step):
            x = found.x.copy()
            x[i] += by * p.scale
            sides.append(predict_held_out(fitted, dict(zip(found.values, x, strict=True)), (trial,)).whitened[0])
        slopes.append((sides[0] - sides[1]) / (2.0 * step * p.scale))
    j = np.stack(slopes, axis=1)
    shared = doubt[:, : len(COEFFICIENTS)]
    np.testing.assert_allclose(shared @ shared.T, j @ found.covariance @ j.T, atol=close * float(np.max(doubt**2)))
    assert len(doubt) == len(sides[0])
    assert doubt.shape[1] - len(COEFFICIENTS) == len(nuisances(trial, clock))


def test_errors_of_all_runs_take_one_prediction_of_each(synthetic: Dataset, monkeypatch: pytest.MonkeyPatch) -> None:
    """Catches time that grows with the square of the number of runs."""
    posed, predicted = problem(synthetic), list[str]()
    honest = Problem.prediction

    def counted(self: Problem, trial: Trial, values: Mapping[str, float]) -> Prediction:
        predicted.append(trial.name)
        return honest(self, trial, values)

    monkeypatch.setattr(Problem, "prediction", counted)
    found = channel_errors(posed, posed.start(TRUTH))
    assert len(found) == len(posed.trials) > 1
    assert sorted(predicted) == sorted(trial.name for trial in posed.trials)
