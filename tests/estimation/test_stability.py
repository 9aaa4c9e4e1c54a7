"""One set of coefficients or one a trial: as many false alarms as said, and a coefficient that differs is found."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from noise_draws import INSIDE, Draws, draws
from scipy import stats
from synthetic_swimming import as_measured, problem, swimming

from mjfish.data import Trial
from mjfish.estimation import Problem, fit
from mjfish.estimation.stability import stability
from mjfish.files.plain_data import plain
from mjfish.fish import Fish

MODES = ("v1", "v3", "v5")


@pytest.fixture(scope="module")
def shared(pike: Fish) -> Draws:
    return draws(pike, MODES, duration=4.0)


@pytest.fixture(scope="module")
def unlike(pike: Fish) -> Problem:
    """Three trials; in the last the fish has 4 % less drag at its tail."""
    return problem(replace(swimming(pike, MODES, duration=4.0), trials=_with_tail(pike, 0.96)))


def _with_tail(pike: Fish, factor: float) -> tuple[Trial, ...]:
    alike = swimming(pike, MODES, values=INSIDE, duration=4.0)
    other = swimming(pike, MODES, values={**INSIDE, "c_d.tail": factor * INSIDE["c_d.tail"]}, duration=4.0)
    return (*alike.trials[:2], other.trials[2])


@pytest.mark.slow
@pytest.mark.parametrize("phi", [0.0, 0.8])
def test_p_values_of_a_stable_model_are_spread_evenly(pike: Fish, phi: float) -> None:
    """80 draws, white and coloured: about five in a hundred below 0.05, half of them below a half.

    The limits are three standard deviations of a count of 80. The classical F test calls nearly every coloured draw
    unstable.
    """
    longer = draws(pike, (*MODES, "v1-t1"), duration=6.0)
    found = [stability(longer.problem, one) for one in longer.fits(phi, 80, 21)]
    joint = np.array([one.p_value for one in found])
    single = np.array([c.p_value for one in found for c in one.coefficients])
    for p in (joint, single):
        assert 0.0 < np.mean(p < 0.05) < 0.125
        assert 0.33 < np.mean(p < 0.5) < 0.67
    assert np.mean([one.stable for one in found]) > 0.875
    assert stats.kstest(joint, "uniform").statistic < 0.2


def test_a_coefficient_that_differs_between_trials_is_named(unlike: Problem) -> None:
    """Its estimates are the true values: the same in two trials, 4 % less in the third."""
    found = stability(unlike, fit(unlike))
    first = found.coefficients[0]
    assert found.stable is False
    assert found.p_value < 1e-4
    assert found.p_value_of_first < 1e-6
    assert first.name == "c_d.tail"
    for name, factor in (("v1", 1.0), ("v3", 1.0), ("v5", 0.96)):
        assert abs(first.estimates[name] - factor * INSIDE["c_d.tail"]) < 4.0 * first.errors[name]
    assert found.text.startswith("coefficients differ between trials (p = ")
    assert "most surely c_d.tail: 1.5" in found.text
    assert "in v5" in found.text
    assert json.loads(json.dumps(plain(found)))["coefficients"][0]["name"] == "c_d.tail"


def test_the_linear_statistic_is_that_of_refits(unlike: Problem) -> None:
    """The fall of the sum of squares from one set for all to one a trial, by full fits of each trial alone."""
    together = fit(unlike)
    alone = [fit(replace(unlike, trials=(trial,)), together.x) for trial in unlike.trials]
    n, p = len(together.residual), len(together.x)
    within = sum(one.sse for one in alone)
    chow = ((together.sse - within) / (2 * p)) / (within / (n - 3 * p))
    found = stability(unlike, together)
    assert not any(np.any(one.at_bound) for one in alone)
    assert found.statistic == pytest.approx(chow, rel=0.1)
    classical = stats.f.sf(chow, 2 * p, n - 3 * p)
    assert np.log10(found.p_value) == pytest.approx(np.log10(classical), rel=0.2)


def test_trials_that_agree_are_said_to(shared: Draws) -> None:
    found = stability(shared.problem, shared.fit(shared.noise(0.0, np.random.default_rng(8))))
    assert found.stable is True
    assert found.text.startswith("one set of coefficients serves all 3 trials (p = ")
    assert found.degrees_of_freedom[0] == pytest.approx(18.0, abs=1.0)
    assert {coefficient.name for coefficient in found.coefficients} == set(INSIDE)


def test_errors_of_the_estimates_by_trial_are_their_scatter(shared: Draws) -> None:
    """In units of its own error, each trial's estimate is off by one, white noise or coloured."""
    for phi in (0.0, 0.8):
        off = [
            (c.estimates[name] - INSIDE[c.name]) / c.errors[name]
            for one in shared.fits(phi, 15, 9)
            for c in stability(shared.problem, one).coefficients
            for name in MODES
        ]
        assert np.sqrt(np.mean(np.square(off))) == pytest.approx(1.0, abs=0.2)


def test_one_trial_cannot_be_compared(unlike: Problem) -> None:
    alone = replace(unlike, trials=unlike.trials[:1])
    found = stability(alone, fit(alone))
    assert found.stable is None
    assert found.text == "one trial: there is nothing to compare"


def test_a_bound_and_what_belongs_to_a_trial_are_not_compared(pike: Fish) -> None:
    """Start velocities differ between trials anyway; a coefficient at its bound stays there in all."""
    dataset = swimming(pike, MODES[:2], duration=3.0)
    held = next(p for p in pike.parameters if p.name == "c_d.head").rebound(high=1.2)
    measured = tuple(as_measured(trial, pike) for trial in dataset.trials)
    posed = replace(problem(dataset), trials=measured, declared={"c_d.head": held})
    one = fit(posed)
    assert one.at_bound[[p.name for p in one.parameters].index("c_d.head")]
    found = stability(posed, one)
    names = {c.name for c in found.coefficients}
    assert "c_d.head" not in names
    assert not any(":" in name for name in names)
    assert 0.0 < found.degrees_of_freedom[0] <= len(names)
