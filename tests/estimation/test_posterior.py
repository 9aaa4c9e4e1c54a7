"""What a fit says for draws: as wide as its intervals, and draws that fit the data as they should."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from changed_fit import having
from synthetic_swimming import TRUTH, problem, swimming

from mjfish import sample
from mjfish.effects import find
from mjfish.estimation import Identification, fit, identify
from mjfish.estimation.intervals import posterior as posterior_of
from mjfish.estimation.settings import Settings
from mjfish.estimation.stability import scatter
from mjfish.fish import Fish
from mjfish.model import Model
from mjfish.model.posterior import Posterior
from mjfish.numerics.block_angular import BlockAngular


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


@pytest.mark.parametrize("correlated", [False, True])
def test_what_the_data_do_not_say_is_as_wide_as_its_bounds(pike: Fish, found: Identification, correlated: bool) -> None:
    assert found.problem is not None
    silent = found.fit.jacobian.dense()
    silent[:, 6] = 0.0
    unsaid = posterior_of(
        found.problem, having(found.fit, jacobian=BlockAngular.of(silent)), pike, {}, correlated=correlated
    )
    p = found.fit.parameters[6]
    assert np.sqrt(unsaid.covariance[6, 6]) == pytest.approx(p.high - p.low, rel=1e-9)
    assert unsaid.names[6] == p.name == "c_f.head"


def test_draws_fit_the_data_as_a_posterior_does(found: Identification, posterior: Posterior) -> None:
    """The sum of squares rises by one a parameter on average, by less for what bounds cut.

    Draws of independent parameters, where estimates are correlated, raise it many times as much.
    """
    posed = found.problem
    assert posed is not None
    unscattered = replace(posterior, scatter=np.zeros(9))
    independent = replace(unscattered, covariance=np.diag(np.diag(posterior.covariance)))
    rise = [
        np.mean([np.sum(posed.residual(x) ** 2) for x in one.draw(60, np.random.default_rng(1))]) - found.fit.sse
        for one in (unscattered, independent)
    ]
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


def test_a_coefficient_that_a_learned_curve_scales_is_held(pike: Fish) -> None:
    """Catches draws that leave the hyperbola c_d exp(curve): drag was off by half in some. The curve has no scatter."""
    law = find("drag_law").for_fish(pike) or find("drag_law")
    posed = problem(swimming(pike, ("v1", "v5"), duration=3.0), model=Model(pike, (law,)))
    found = fit(posed, posed.start(TRUTH), evaluations=2)
    learned = posterior_of(posed, found, pike, {}, correlated=False)
    sigma = dict(zip(learned.names, np.sqrt(np.diag(learned.covariance)), strict=True))
    held = [name for name, error in sigma.items() if error == 0.0]
    assert {"c_d.head", "c_f.head"} <= set(held)
    assert not [name for name in held if name.startswith(("c_m", "drag_law"))]
    assert sigma["drag_law.across_3"] < 0.1
    scattered = scatter(posed, found)
    assert "c_m.tail" in scattered
    assert not [name for name in scattered if name.startswith(("drag_law.across", "drag_law.along"))]
