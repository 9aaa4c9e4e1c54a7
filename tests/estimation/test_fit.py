"""Bounded least squares: true coefficients come back, with errors that are what they say."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from pike_coefficients import COEFFICIENTS
from scipy import stats
from synthetic_swimming import SIGMA, TRUTH, off_truth, problem, swimming

from mjfish.data import Dataset
from mjfish.estimation import Fit, Noise, Problem, fit
from mjfish.estimation.settings import Loss
from mjfish.execution import executing
from mjfish.fish import Fish
from mjfish.numerics.arrays import readonly
from mjfish.numerics.sized_cache import Recomputable
from mjfish.parameters import Parameter


@pytest.fixture(scope="module")
def synthetic(pike: Fish) -> Dataset:
    return swimming(pike)


@pytest.fixture(scope="module")
def posed(synthetic: Dataset) -> Problem:
    return problem(synthetic)


@pytest.fixture(scope="module")
def fitted(posed: Problem) -> Fit:
    return fit(posed)


def _declared(fish: Fish, name: str, **changes: float) -> dict[str, Parameter]:
    return {name: next(p for p in fish.parameters if p.name == name).rebound(**changes)}


def test_true_coefficients_come_back_from_the_papers_start_values(posed: Problem, fitted: Fit) -> None:
    """Each within four standard errors, all nine together as chance would have it, and no start value just kept."""
    assert fitted.status == "converged"
    off = off_truth(fitted.values, fitted.sigma)
    assert np.max(np.abs(off)) < 4.0
    start = dict(zip(COEFFICIENTS, posed.start(), strict=True))
    assert start["c_d.head"] == 2.0
    moved = [abs(fitted.values[name] - start[name]) / fitted.sigma[name] for name in ("c_m.tail", "c_d.body")]
    assert min(moved) > 20.0
    truth = np.array([TRUTH[name] for name in COEFFICIENTS]) - fitted.x
    assert truth @ np.linalg.inv(fitted.covariance) @ truth < stats.chi2.ppf(0.9999, 9)


@pytest.mark.parametrize("loss", ["linear", "huber"])
def test_what_is_made_again_of_a_fit_is_the_same_to_the_last_bit(pike: Fish, posed: Problem, loss: Loss) -> None:
    """With an estimate at its bound."""
    tight = replace(posed, declared=_declared(pike, "c_d.head", high=1.2))
    found = fit(tight, loss=loss)
    assert found.at_bound.any()
    before = found.residual.tobytes(), found.jacobian.dense().tobytes(), found.covariance.tobytes()
    for large in (found.residuals, found.linearised):
        assert isinstance(large, Recomputable)
        large.value = None
    assert (found.residual.tobytes(), found.jacobian.dense().tobytes(), found.covariance.tobytes()) == before


def test_what_is_left_is_the_noise(fitted: Fit) -> None:
    n = len(fitted.residual)
    assert fitted.sse == pytest.approx(float(fitted.residual @ fitted.residual), rel=1e-12)
    assert abs(fitted.sse - (n - 9)) < 5.0 * np.sqrt(2.0 * n)


def test_the_optimum_is_one(posed: Problem, fitted: Fit) -> None:
    """The residual has no part in the direction of any parameter, to a hundredth of a standard error."""
    step = fitted.covariance @ fitted.jacobian.transposed_times(fitted.residual)
    assert np.all(np.abs(step) < 0.01 * np.sqrt(np.diag(fitted.covariance)))


def test_the_covariance_is_the_inverse_of_the_information(fitted: Fit) -> None:
    information = fitted.jacobian.gram()
    np.testing.assert_allclose(fitted.covariance @ information, np.eye(9), atol=1e-6)
    sigma = np.array([fitted.sigma[name] for name in COEFFICIENTS])
    np.testing.assert_allclose(sigma**2, np.diag(fitted.covariance), rtol=1e-12)
    np.testing.assert_allclose(np.diag(fitted.correlation), 1.0)
    assert np.all(np.abs(fitted.correlation) <= 1.0 + 1e-12)


def test_standard_errors_are_the_scatter_of_refits(pike: Fish) -> None:
    """Sums of squared standardised errors over eight noises lie in the 99.99 % range of chi squared, both ends.

    Catches errors in units of the wrong noise, by a factor of 1.4 either way.
    """
    clean = swimming(pike, ("v1", "v5"), noise=None, duration=2.0)
    base = problem(clean)
    start = base.start(TRUTH)
    squares = []
    for seed in range(8):
        rng = np.random.default_rng(seed)
        noisy = tuple(
            replace(trial, velocity=readonly(trial.velocity + rng.standard_normal(trial.velocity.shape) * SIGMA))
            for trial in clean.trials
        )
        one = fit(replace(base, trials=noisy), start, tolerance=1e-5)
        if not np.any(one.at_bound):
            off = np.array([TRUTH[name] for name in COEFFICIENTS]) - one.x
            squares.append(float(off @ np.linalg.inv(one.covariance) @ off))
    assert len(squares) >= 4
    low, high = stats.chi2.ppf([5e-5, 1.0 - 5e-5], 9 * len(squares))
    assert low < sum(squares) < high


def test_twice_the_stated_noise_gives_the_same_estimates_with_twice_the_errors(posed: Problem, fitted: Fit) -> None:
    doubled = fit(replace(posed, noise=Noise.white(readonly(2.0 * SIGMA))), fitted.x)
    for name in COEFFICIENTS:
        assert doubled.values[name] == pytest.approx(fitted.values[name], abs=0.02 * fitted.sigma[name])
        assert doubled.sigma[name] == pytest.approx(2.0 * fitted.sigma[name], rel=1e-2)


@pytest.mark.parametrize(("side", "bound"), [("high", 1.2), ("low", 1.8)])
def test_an_estimate_that_the_data_push_against_a_bound_rests_on_it(
    pike: Fish, posed: Problem, fitted: Fit, side: str, bound: float
) -> None:
    """c_d.head is truly 1.5 and kept away from it: no error is claimed for it, and its interval is one-sided."""
    bounded = fit(replace(posed, declared=_declared(pike, "c_d.head", **{side: bound})))
    names = [p.name for p in bounded.parameters]
    index = names.index("c_d.head")
    assert bounded.status == "converged"
    assert bounded.values["c_d.head"] == bound
    assert [names[i] for i in np.flatnonzero(bounded.at_bound) if names[i].startswith("c_d")] == ["c_d.head"]
    assert bounded.sigma["c_d.head"] == 0.0
    assert not np.any(bounded.correlation[index])
    low, high = bounded.interval("c_d.head")
    assert bound in (low, high)
    assert 0.0 < high - low < 0.3
    assert bounded.sse > fitted.sse + 50.0
    assert not np.any(fitted.at_bound)


def test_an_interval_is_symmetric_inside_the_bounds_and_cut_at_them(fitted: Fit) -> None:
    low, high = fitted.interval("c_d.tail")
    sigma, at = fitted.sigma["c_d.tail"], fitted.values["c_d.tail"]
    assert (low, high) == pytest.approx((at - 1.959964 * sigma, at + 1.959964 * sigma), rel=1e-6)
    assert fitted.interval("c_f.body", z=100.0) == (0.001, 0.02)


def test_a_fixed_parameter_stays_and_leaves_the_others_better_known(posed: Problem, fitted: Fit) -> None:
    known = fit(replace(posed, fixed={"c_f.head": TRUTH["c_f.head"]}))
    assert "c_f.head" not in known.values
    assert len(known.x) == 8
    assert known.sigma["c_f.body"] < 0.9 * fitted.sigma["c_f.body"]


def test_too_few_evaluations_are_said(posed: Problem) -> None:
    assert fit(posed, evaluations=2).status == "stopped"


def test_a_start_that_diverges_is_a_status_with_trial_time_and_parameters(pike: Fish, posed: Problem) -> None:
    lost = fit(replace(posed, declared=_declared(pike, "c_d.tail", low=1e7, high=1e9, start=1e8)))
    assert lost.status == "diverged"
    assert lost.message.startswith("v1 diverged at 0.")
    assert "c_d.tail = 1e+08" in lost.message
    assert "; v5 diverged at" in lost.message


def test_a_large_misfit_is_no_divergence(synthetic: Dataset, posed: Problem) -> None:
    """Where the noise is stated a hundred thousand times too small, residuals are large and the model still runs."""
    tiny = fit(replace(posed, noise=Noise.white(readonly(1e-5 * SIGMA))), evaluations=3)
    assert np.max(np.abs(tiny.residual)) > 1e4
    assert tiny.status != "diverged"


def test_the_number_of_threads_does_not_change_a_bit_of_the_answer(posed: Problem, fitted: Fit) -> None:
    for jobs in (1, 3):
        with executing(jobs):
            threaded = fit(posed)
        assert threaded.x.tobytes() == fitted.x.tobytes()
        assert threaded.covariance.tobytes() == fitted.covariance.tobytes()
        assert threaded.evaluations == fitted.evaluations
