"""Intervals of a fit: what they become under white noise, coloured noise, and at a bound."""

from __future__ import annotations

import json

import numpy as np
import pytest
from changed_fit import having
from noise_draws import Draws, draws
from synthetic_swimming import problem, swimming

from mjfish.estimation import fit
from mjfish.estimation.intervals import intervals
from mjfish.fish import Fish
from mjfish.numerics.block_angular import BlockAngular


@pytest.fixture(scope="module")
def shared(pike: Fish) -> Draws:
    return draws(pike, ("v1", "v5"), duration=4.0)


def test_under_white_noise_both_intervals_are_the_same(shared: Draws) -> None:
    one = shared.fit(shared.noise(0.0, np.random.default_rng(2)))
    found = intervals(shared.problem, one)
    assert np.all(np.abs(found.inflation - 1.0) < 0.1)
    np.testing.assert_allclose(found.plain_sigma, [one.sigma[name] for name in found.names], rtol=1e-12)
    assert found.interval("c_m.tail") == pytest.approx(one.interval("c_m.tail"), abs=0.2 * one.sigma["c_m.tail"])


def test_under_coloured_noise_the_sandwich_is_as_wide_as_estimates_scatter(shared: Draws) -> None:
    """Pooled over nine coefficients and 40 draws the squared errors are 1 in units of it, 2.4 of the plain."""
    off, plain = [], []
    for one in shared.fits(0.8, 40, 3):
        found = intervals(shared.problem, one)
        off.append((one.x - shared.truth) / found.sigma)
        plain.append((one.x - shared.truth) / found.plain_sigma)
    assert np.mean(np.square(off)) == pytest.approx(1.1, abs=0.35)
    assert np.mean(np.square(plain)) > 2.0


def test_noise_of_another_size_than_stated_is_seen_by_the_sandwich_only(shared: Draws) -> None:
    """Plain intervals believe the stated sigma; the residual shows that it is three times that."""
    found = intervals(shared.problem, shared.fit(3.0 * shared.noise(0.0, np.random.default_rng(4))))
    assert np.all(np.abs(found.inflation - 3.0) < 0.4)


def test_few_samples_widen_the_interval(shared: Draws) -> None:
    """Degrees of freedom are those of correlated samples: fewer than the samples, and Student's t knows."""
    one = shared.fit(shared.noise(0.8, np.random.default_rng(6)))
    found = intervals(shared.problem, one)
    assert np.all((found.degrees_of_freedom > 10.0) & (found.degrees_of_freedom < 0.5 * len(one.residual)))
    inside = found.names.index("c_m.head")
    half = 0.5 * (found.high - found.low)[inside] / found.sigma[inside]
    assert 1.97 < half < 2.3
    narrow = intervals(shared.problem, one, level=0.68)
    assert narrow.high[inside] - narrow.low[inside] < 0.55 * (found.high - found.low)[inside]


def test_at_a_bound_the_interval_is_one_sided_and_no_covariance_is_claimed(pike: Fish) -> None:
    """As the plain one: from the bound as far as it might lie were it free, the others as if it were known."""
    held = next(p for p in pike.parameters if p.name == "c_d.head").rebound(high=1.2)
    posed = problem(swimming(pike, ("v1", "v5")), declared={"c_d.head": held})
    one = fit(posed)
    found = intervals(posed, one)
    index = found.names.index("c_d.head")
    assert bool(found.at_bound[index])
    assert not np.any(found.covariance[index])
    low, high = found.interval("c_d.head")
    assert high == 1.2
    assert 1.2 - 4.0 * one.reach[index] < low < 1.2
    others = ~one.at_bound
    np.testing.assert_allclose(np.diag(found.covariance)[others], found.sigma[others] ** 2, rtol=1e-12)


def test_a_parameter_that_nothing_moves_has_no_narrow_interval(shared: Draws) -> None:
    """Its sandwich would be 0 / 0: the interval is all of its bounds, not a point."""
    one = shared.fit(shared.noise(0.8, np.random.default_rng(1)))
    still = one.jacobian.dense()
    still[:, 3] = 0.0
    found = intervals(shared.problem, having(one, jacobian=BlockAngular.of(still)))
    assert found.interval("c_d.head") == (0.1, 4.0)
    assert found.inflation[0] < 3.0


def test_intervals_are_plain_data(shared: Draws) -> None:
    found = intervals(shared.problem, shared.fit(shared.noise(0.0, np.random.default_rng(2))))
    read = json.loads(json.dumps(found.to_dict()))
    assert read["parameters"]["c_m.head"]["low"] == found.low[0]
    assert set(read["parameters"]) == set(found.names)
