"""Information criteria: closed forms, what counts as a parameter, and the right order of nested models."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import signal, stats
from synthetic_swimming import SIGMA, TRUTH, problem, swimming

from mjfish.data import Dataset, Trial
from mjfish.effects import find
from mjfish.estimation import Noise, fit
from mjfish.estimation.residual import Criteria, criteria, final_prediction_error, of_whitened
from mjfish.fish import Fish
from mjfish.noise import Autoregressive
from mjfish.numerics.arrays import FloatArray, readonly


def _of(error: FloatArray, noise: Noise, free: int, *, stated: bool) -> Criteria:
    """Return the criteria of residuals (n, 3) of one trial without gaps."""
    every = np.ones(len(error), dtype=np.bool_)
    trial = Trial("v1", None, readonly(np.arange(len(error)) / 50.0), readonly(error))
    white, determinant = noise.whiten(trial, every, error), noise.log_determinant(trial, every)
    return of_whitened(white, noise, determinant, free, stated=stated)


def test_with_a_stated_noise_they_are_those_of_the_gaussian_density() -> None:
    """White noise, by hand. Catches a missing 2 pi, samples counted by rows, K where K + 1 belongs."""
    error = np.random.default_rng(1).standard_normal((40, 3)) * SIGMA
    found = _of(error, Noise.white(readonly(SIGMA)), 7, stated=True)
    log_p = stats.norm.logpdf(error, scale=SIGMA).sum()
    assert (found.samples, found.parameters) == (120, 7)
    assert found.log_likelihood == pytest.approx(log_p)
    assert found.aic == pytest.approx(-2.0 * log_p + 14.0)
    assert found.aicc == pytest.approx(found.aic + 2.0 * 7 * 8 / (120 - 8))
    assert found.bic == pytest.approx(-2.0 * log_p + 7.0 * np.log(120))


def test_an_estimated_noise_is_the_most_likely_one_and_counts() -> None:
    """-2 L = sum_c N (log(2 pi s_c^2) + 1); whatever sigma the weights had."""
    error = np.random.default_rng(2).standard_normal((40, 3)) * SIGMA
    variance = np.mean(error**2, axis=0)
    for sigma in (SIGMA, 3.0 * SIGMA):
        found = _of(error, Noise.white(readonly(sigma)), 7, stated=False)
        assert found.parameters == 10
        assert -2.0 * found.log_likelihood == pytest.approx(np.sum(40 * (np.log(2 * np.pi * variance) + 1)))


def test_autoregressive_noise_has_the_exact_likelihood() -> None:
    """Against the dense Gaussian density. Catches a first sample that is dropped or given the innovations' variance."""
    phi = np.array([0.5, 0.8, -0.3])
    white = np.random.default_rng(3).standard_normal((230, 3)) * SIGMA
    error = np.stack([signal.lfilter([1.0], [1.0, -phi[c]], white[:, c])[200:] for c in range(3)], axis=1)
    log_p = sum(
        stats.multivariate_normal.logpdf(
            error[:, c],
            cov=SIGMA[c] ** 2 / (1 - phi[c] ** 2) * phi[c] ** np.abs(np.subtract.outer(np.arange(30), np.arange(30))),
        )
        for c in range(3)
    )
    noise = Autoregressive(readonly(SIGMA), readonly(phi[:, None]))
    assert _of(error, noise, 2, stated=True).log_likelihood == pytest.approx(log_p)
    assert _of(error, noise, 2, stated=False).parameters == 2 + 3 * 2


def test_the_final_prediction_error_is_the_determinant_with_its_penalty() -> None:
    """[[2, 1], [1, 3]] has determinant 5; d / N = 1/4 gives 5 (5/4) / (3/4)."""
    root = np.linalg.cholesky(np.array([[2.0, 1.0], [1.0, 3.0]]))
    basis = np.linalg.qr(np.random.default_rng(4).standard_normal((40, 2)))[0] * np.sqrt(40.0)
    assert final_prediction_error(basis @ root.T, 10) == pytest.approx(5.0 * 1.25 / 0.75)
    assert final_prediction_error(basis @ root.T, 40) == np.inf


def test_too_few_samples_for_the_correction_make_it_infinite() -> None:
    error = np.random.default_rng(5).standard_normal((3, 3)) * SIGMA
    found = _of(error, Noise.white(readonly(SIGMA)), 8, stated=True)
    assert found.aicc == np.inf


@pytest.fixture(scope="module")
def still(pike: Fish) -> Dataset:
    return swimming(pike, ("v1", "v5"), duration=3.0)


@pytest.fixture(scope="module")
def drifting(pike: Fish) -> Dataset:
    effect = find("ambient_current")
    values = TRUTH | {"ambient_current.x": 0.02, "ambient_current.y": -0.01}
    return swimming(pike, ("v1", "v5"), duration=3.0, values=values, effects=[effect])


def test_the_model_that_made_the_data_ranks_first(still: Dataset, drifting: Dataset) -> None:
    """Nested: plain, and with a current. All criteria want it where there is one, none where there is none."""
    for dataset, wanted in ((still, False), (drifting, True)):
        plain = problem(dataset)
        extended = replace(plain, model=plain.model.extended(find("ambient_current")))
        found = fit(extended)
        small = criteria(plain, fit(plain), noise="stated")
        large = criteria(extended, found, noise="stated")
        assert large.parameters == small.parameters + 3 - int(np.count_nonzero(found.at_bound))
        assert large.log_likelihood >= small.log_likelihood - 1e-3
        for name in ("aic", "aicc", "bic", "fpe"):
            assert (getattr(large, name) < getattr(small, name)) == wanted, name


def test_a_coefficient_fixed_at_a_wrong_value_ranks_last_and_at_the_truth_first(still: Dataset) -> None:
    free = problem(still)
    right, wrong = (replace(free, fixed={"c_d.body": TRUTH["c_d.body"] * scale}) for scale in (1.0, 1.5))
    bics = [criteria(one, fit(one)).bic for one in (right, free, wrong)]
    assert bics == sorted(bics)


def test_parameters_on_a_bound_are_not_counted_and_nuisance_parameters_are(still: Dataset) -> None:
    raised = replace(problem(still).parameters[0], default=1.2, low=1.0, start=1.5)
    bound = problem(still, declared={"c_m.head": raised}, free_clock=True)
    one = fit(bound)
    assert bool(one.at_bound[0])
    assert criteria(bound, one, noise="stated").parameters == 9 + 2 - int(np.count_nonzero(one.at_bound))


def test_a_fit_that_diverged_has_none(still: Dataset) -> None:
    posed = problem(still)
    assert np.isnan(criteria(posed, replace(fit(posed, evaluations=1), status="diverged")).aic)
