"""The sd of a prior by marginal likelihood, on linear problems that were drawn from it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from linear_problem import Linear, linear, names

from mjfish.estimation import fit
from mjfish.estimation.marginal_likelihood import effective_degrees_of_freedom, learned_sds, smoothed
from mjfish.numerics.arrays import FloatArray
from mjfish.parameters.prior import Prior, about, smooth_curve

COUNT, DRAWS = 12, 20


def _size(sd: float, count: int = COUNT) -> Prior:
    """Return a prior of numbers that are independent of each other."""
    return Prior("size", names(count), np.eye(count), sd, learned=True)


def _drawn(rng: np.random.Generator, coefficients: FloatArray, priors: tuple[Prior, ...]) -> Linear:
    design = rng.normal(size=(60, len(coefficients)))
    return linear(design, design @ coefficients + rng.normal(size=60), priors)


@pytest.mark.parametrize("sd", [0.3, 2.0])
def test_the_sd_that_made_the_numbers_comes_back(sd: float) -> None:
    """Twelve numbers tell their sd to a fifth, twenty times twelve to a twentieth; four times that, and from afar."""
    rng, found = np.random.default_rng(1), []
    for _ in range(DRAWS):
        posed = _drawn(rng, sd * rng.normal(size=COUNT), (_size(4.0 * sd),))
        found.append(learned_sds(posed, fit(posed))["size"])
    assert abs(np.mean(np.log(np.array(found) / sd))) < 0.2
    assert np.std(np.log(found)) < 0.5


def test_of_several_priors_only_the_learned_one_moves_and_it_comes_back() -> None:
    """A curve from its own prior: curvature of a known sd, beside slope and level; ten second differences a draw."""
    rng, sd, found = np.random.default_rng(2), 0.8, []
    truth = smooth_curve("curve", names(COUNT), sd, 0.7)
    root = np.concatenate([prior.rows / prior.sd for prior in truth])
    spread = np.linalg.cholesky(np.linalg.inv(root.T @ root))
    for _ in range(DRAWS):
        priors = smooth_curve("curve", names(COUNT), 0.3, 0.7)
        posed = _drawn(rng, spread @ rng.normal(size=COUNT), priors)
        sds = learned_sds(posed, fit(posed))
        assert list(sds) == ["curve.curvature"]
        found.append(sds["curve.curvature"])
    assert abs(np.mean(np.log(np.array(found) / sd))) < 0.3


def test_it_stands_where_the_marginal_likelihood_is_largest() -> None:
    """By log p(y) of y ~ N(0, I + sd^2 A A') on a grid of sds a hundredth apart."""
    rng = np.random.default_rng(3)
    posed = _drawn(rng, 0.5 * rng.normal(size=COUNT), (_size(0.5),))
    values, vectors = np.linalg.eigh(posed.design @ posed.design.T)
    y = vectors.T @ posed.data
    grid = np.exp(np.arange(np.log(0.1), np.log(2.0), 0.01))
    likelihood = [-0.5 * np.sum(np.log1p(s**2 * values) + y**2 / (1.0 + s**2 * values)) for s in grid]
    posed = replace(posed, prior_sds={"size": 1.5})
    assert learned_sds(posed, fit(posed))["size"] == pytest.approx(grid[np.argmax(likelihood)], rel=0.02)


def test_numbers_that_are_none_get_a_small_sd() -> None:
    rng = np.random.default_rng(4)
    posed = _drawn(rng, np.zeros(COUNT), (_size(1.0),))
    assert learned_sds(posed, fit(posed))["size"] < 0.2


def test_the_problem_is_fitted_anew_with_what_was_learned() -> None:
    rng = np.random.default_rng(6)
    posed = _drawn(rng, 0.2 * rng.normal(size=COUNT), (_size(2.0),))
    before = fit(posed)
    after, found = smoothed(posed, before)
    assert after.priors[0].sd == pytest.approx(learned_sds(posed, before)["size"], rel=0.05)
    np.testing.assert_allclose(found.x, fit(after).x, rtol=0.0, atol=1e-6)
    assert np.linalg.norm(found.x) < np.linalg.norm(before.x)


def test_what_has_no_learned_prior_stays_as_it_is() -> None:
    rng = np.random.default_rng(7)
    posed = _drawn(rng, rng.normal(size=3), (replace(_size(1.0, 3), learned=False),))
    found = fit(posed)
    assert learned_sds(posed, found) == {}
    assert smoothed(posed, found) == (posed, found)


def test_effective_degrees_of_freedom_are_the_shares_that_the_data_determine() -> None:
    """Of orthogonal columns of length 3: 9 / (9 + 1 / sd^2) each; none of a tight prior, all of a wide one."""
    design, found = 3.0 * np.eye(8)[:, :5], []
    for sd in (1e-4, 0.1, 1.0 / 3.0, 1.0, 1e4):
        posed = linear(design, np.ones(8), (_size(sd, 5),))
        found.append(effective_degrees_of_freedom(posed, fit(posed), names(5)))
        assert found[-1] == pytest.approx(5.0 * 9.0 / (9.0 + 1.0 / sd**2), rel=1e-6)
    assert 0.0 < found[0] < 1e-5
    assert found[2] == pytest.approx(2.5)
    assert found[-1] == pytest.approx(5.0, abs=1e-6)


def test_numbers_that_a_coefficient_can_stand_for_count_no_more_for_it() -> None:
    """Columns that a free one nearly spans: the diagonal of (J'J + S)^-1 J'J is large and negative there."""
    rng = np.random.default_rng(8)
    design = rng.normal(size=(40, 6))
    design[:, 0] = 1e3 * (design[:, 1:].sum(axis=1) + 1e-3 * design[:, 0])
    posed = linear(design, rng.normal(size=40), (Prior("tight", names(6)[1:], np.diff(np.eye(5), axis=0), 1e-3),))
    freedom = effective_degrees_of_freedom(posed, fit(posed), names(6)[1:])
    assert freedom == pytest.approx(1.0, abs=0.01)  # their mean alone


def test_a_prior_with_a_mean_learns_the_same_sd() -> None:
    """A number that is known beforehand draws the curve; its pull is no curvature."""
    rng = np.random.default_rng(9)
    truth = 0.5 * rng.normal(size=COUNT)
    shifted = (_size(0.5), about("known", ("toy.p0",), 3.0, 1e-3))
    design = rng.normal(size=(60, COUNT))
    noise = rng.normal(size=60)
    truth[0] = 3.0
    sds = learned_sds(posed := linear(design, design @ truth + noise, shifted), fit(posed))
    values, count = np.delete(fit(posed).x, 0), COUNT - 1
    assert sds["size"] == pytest.approx(np.sqrt((np.sum(values**2) + 9.0) / (count + 1)), rel=0.2)


def test_effective_degrees_of_freedom_are_of_the_named_parameters_alone() -> None:
    posed = linear(np.eye(5), np.ones(5), (_size(1.0, 5),))
    found = fit(posed)
    assert effective_degrees_of_freedom(posed, found, names(2)) == pytest.approx(1.0, rel=1e-6)
    assert effective_degrees_of_freedom(posed, found, ()) == 0.0
