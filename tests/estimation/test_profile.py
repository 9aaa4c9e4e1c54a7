"""Profiles: a parabola where the problem is one, a bound where that comes first, a better optimum if there is one."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from synthetic_swimming import as_measured, problem, swimming

from mjfish.errors import InputError, UnknownNameError
from mjfish.estimation import Fit, Problem, fit
from mjfish.estimation.intervals import Intervals, Profile, intervals, profile
from mjfish.files.plain_data import plain
from mjfish.fish import Fish

CHI = float(stats.chi2.ppf(0.95, 1))


@pytest.fixture(scope="module")
def posed(pike: Fish) -> Problem:
    return problem(swimming(pike, ("v1", "v5"), duration=2.0))


@pytest.fixture(scope="module")
def fitted(posed: Problem) -> Fit:
    return fit(posed)


@pytest.fixture(scope="module")
def known(posed: Problem, fitted: Fit) -> Intervals:
    return intervals(posed, fitted)


@pytest.fixture(scope="module")
def drag(posed: Problem, fitted: Fit, known: Intervals) -> Profile:
    return profile(posed, fitted, "c_d.head", known=known)


def test_a_profile_of_a_well_known_parameter_gives_the_interval_of_its_standard_error(
    drag: Profile, known: Intervals
) -> None:
    """Others held instead of refitted would make it narrower; a step too long between points would show as well."""
    low, high = known.interval("c_d.head")
    assert drag.status == "ok"
    assert (drag.low, drag.high) == pytest.approx((low, high), abs=0.03 * (high - low))
    parabola = ((drag.values - drag.estimate) / drag.sigma) ** 2
    np.testing.assert_allclose(drag.rise, parabola, rtol=0.05)
    assert np.sum(drag.rise <= drag.threshold) >= 5


def test_the_interval_ends_where_refits_cross_the_threshold(posed: Problem, fitted: Fit, drag: Profile) -> None:
    for end in (drag.low, drag.high):
        held = fit(replace(posed, fixed={"c_d.head": end}))
        assert (held.sse - fitted.sse) / drag.scale == pytest.approx(CHI, abs=0.02)


def test_others_are_the_refits(posed: Problem, drag: Profile) -> None:
    """Every point is an optimum of its own, however it was started."""
    far = int(np.argmax(drag.values))
    alone = fit(replace(posed, fixed={"c_d.head": float(drag.values[far])}))
    np.testing.assert_allclose(drag.others[far], alone.x, rtol=2e-3, atol=1e-5)


def test_noise_as_large_as_the_residual_widens_the_profile(posed: Problem, fitted: Fit, known: Intervals) -> None:
    """Rises are measured in the noise that is there, not in the stated one: twice the errors, twice the interval."""
    wide = replace(known, sigma=2.0 * known.sigma)
    once, twice = (profile(posed, fitted, "c_m.tail", known=one) for one in (known, wide))
    assert (twice.high - twice.low) / (once.high - once.low) == pytest.approx(2.0, abs=0.05)


def test_a_bound_ends_a_profile_and_is_said(posed: Problem, fitted: Fit, known: Intervals) -> None:
    """Body skin friction in two seconds: its lower bound is not excluded, and that is not the end of an interval."""
    found = profile(posed, fitted, "c_f.body", known=known)
    assert (found.status, found.low_side, found.high_side) == ("open", "bound", "crossed")
    assert found.low == found.values[0] == 0.001
    assert found.rise[0] < CHI
    assert json.loads(json.dumps(plain(found)))["low_side"] == "bound"


def test_a_profile_follows_the_others_to_their_bounds(posed: Problem, fitted: Fit, known: Intervals) -> None:
    """Head skin friction is pulled up as the body's goes to its bound, and stops there: no parabola knows that."""
    found = profile(posed, fitted, "c_f.head", known=known)
    assert found.status == "ok"
    assert found.high < known.interval("c_f.head")[1] - 0.2 * known.sigma[known.names.index("c_f.head")]


def test_a_better_optimum_is_reported_with_its_parameters(posed: Problem, fitted: Fit, known: Intervals) -> None:
    """A fit that stopped elsewhere: the profile finds less, says so, and where."""
    away = replace(fitted, x=fitted.x + 0.8 * known.sigma, sse=fitted.sse + 5.0, cost=fitted.cost + 5.0)
    found = profile(posed, away, "c_d.head", known=known)
    assert found.status == "better_optimum"
    assert found.better["c_d.head"] == pytest.approx(fitted.values["c_d.head"], abs=known.sigma[3])
    assert set(found.better) == set(fitted.values)


def test_a_name_that_is_not_free_is_refused(posed: Problem, fitted: Fit) -> None:
    with pytest.raises(UnknownNameError, match=r"unknown free parameter 'c_d.nose'; known: c_d.body"):
        profile(posed, fitted, "c_d.nose")


def test_the_only_parameter_needs_no_refit(posed: Problem, fitted: Fit) -> None:
    """Its profile is the sum of squares itself."""
    alone = replace(posed, fixed={name: v for name, v in fitted.values.items() if name != "c_m.tail"})
    one = fit(alone)
    found = profile(alone, one, "c_m.tail")
    assert found.status == "ok"
    assert found.others.shape == (len(found.values), 0)
    residual = alone.residual(found.values[:1])
    assert found.rise[0] == pytest.approx((residual @ residual - one.sse) / found.scale, rel=1e-9)


def test_a_parameter_that_cannot_be_held_is_refused(pike: Fish) -> None:
    """Start velocities of a trial whose joints were measured belong to the trial; or else they are profiled."""
    trial = as_measured(swimming(pike, ("v1",), duration=3.0).trials[0], pike)
    posed = replace(problem(swimming(pike, ("v1",), duration=3.0)), trials=(trial,))
    one = fit(posed)
    name = next(p.name for p in one.parameters if "start" in p.name)
    held = replace(posed, fixed={name: one.values[name]})
    if name in {p.name for p in held.parameters}:
        with pytest.raises(InputError, match="cannot be held fixed"):
            profile(posed, one, name)
    else:
        assert profile(posed, one, name).low < one.values[name]
