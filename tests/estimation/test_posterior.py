"""What a fit says for draws: as wide as its intervals, and draws that fit the data as they should."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from synthetic_swimming import TRUTH, swimming

from mjfish import sample
from mjfish.estimation import Identification, identify
from mjfish.estimation.settings import Settings
from mjfish.fish import Fish
from mjfish.model.posterior import Posterior


@pytest.fixture(scope="module")
def found(pike: Fish) -> Identification:
    """Two fitted runs; the drag of the head rests on a bound half a standard error below where it would be."""
    dataset = swimming(pike, duration=4.0)
    inside = identify(dataset, Settings(starts=1), jobs=1).fit
    assert not inside.at_bound.any()
    bounds = {"c_d.head": (None, inside.values["c_d.head"] - 0.5 * inside.sigma["c_d.head"])}
    return identify(dataset, Settings(starts=1, bounds=bounds), jobs=1)


@pytest.fixture(scope="module")
def posterior(found: Identification) -> Posterior:
    assert found.posterior is not None
    return found.posterior


def test_errors_are_those_of_the_intervals(found: Identification, posterior: Posterior) -> None:
    """Of what lies inside: given that the head stays on its bound. Of the head: how far it might lie from it."""
    assert found.assessment is not None
    known = found.assessment.intervals
    assert posterior.names == known.names
    np.testing.assert_array_equal(posterior.mean, known.x)
    at = posterior.names.index("c_d.head")
    assert known.at_bound.tolist() == [k == at for k in range(9)]
    assert np.sqrt(posterior.covariance[at, at]) == pytest.approx(known.sigma[at], rel=0.01)
    narrow = [k for k, p in enumerate(found.fit.parameters) if known.sigma[k] < 0.05 * (p.high - p.low) and k != at]
    assert len(narrow) >= 4
    covariance = posterior.covariance
    given = covariance - np.outer(covariance[:, at], covariance[at]) / covariance[at, at]
    np.testing.assert_allclose(np.sqrt(np.diag(given))[narrow], known.sigma[narrow], rtol=0.1)


def test_what_the_data_do_not_say_is_as_wide_as_its_bounds_at_most(found: Identification, posterior: Posterior) -> None:
    width = np.array([p.high - p.low for p in found.fit.parameters])
    assert np.all(np.sqrt(np.diag(posterior.covariance)) <= width * (1.0 + 1e-9))


def test_draws_fit_the_data_as_a_posterior_does(found: Identification, posterior: Posterior) -> None:
    """The sum of squares rises by one a parameter on average, by less for what bounds cut.

    Draws of independent parameters, where estimates are correlated, raise it many times as much.
    """
    problem = found.problem
    assert problem is not None
    unscattered = replace(posterior, scatter=np.zeros(9))
    independent = replace(unscattered, covariance=np.diag(np.diag(posterior.covariance)))
    rise = [
        np.mean([np.sum(problem.residual(x) ** 2) for x in one.draw(60, np.random.default_rng(1))]) - found.fit.sse
        for one in (unscattered, independent)
    ]
    print(rise)
    assert 6.0 < rise[0] < 12.0
    assert rise[1] > 5.0 * rise[0]


def test_the_fish_has_the_bounds_of_the_fit_and_keeps_what_was_fixed(pike: Fish) -> None:
    settings = Settings(starts=1, fixed={"c_f.*": 0.012}, bounds={"c_d.body": (0.2, 3.3)})
    found = identify(swimming(pike, duration=3.0), settings, jobs=1)
    assert found.posterior is not None
    (draw,) = sample(found, 1)
    assert [name for name in draw.values if name not in found.posterior.names] == ["c_f.head", "c_f.body", "c_f.tail"]
    assert draw.values["c_f.body"] == 0.012
    body = next(p for p in draw.model.fish.parameters if p.name == "c_d.body")
    assert (body.low, body.high) == (0.2, 3.3)
    assert found.to_dict()["posterior"]["runs"] == 2
    assert set(TRUTH) == set(draw.values)
