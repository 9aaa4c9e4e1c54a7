"""Cost of a fit: rollouts in proportion to trials, derivatives by all parameters at once, memory below 1 GB."""

from __future__ import annotations

import pytest

import fit_cost
from fit_cost import Cost


@pytest.mark.parametrize(("trials", "free"), [(1, 1), (2, 1), (2, 3)])
def test_an_evaluation_is_a_rollout_a_trial_and_all_derivatives_are_one_more(trials: int, free: int) -> None:
    """Catches a rollout done twice, a rollout for every parameter, and trials that repeat each other's work."""
    cost = fit_cost.fitted(trials, free, duration=1.0)
    assert cost.status == "converged"
    assert cost.rollouts == trials * cost.evaluations
    jacobians, rest = divmod(cost.slopes, trials)
    assert rest == 0
    assert 2 <= jacobians <= cost.evaluations


def test_memory_is_that_of_the_process_in_megabytes() -> None:
    """NumPy and the compiler need more than 50 MB; a unit mistaken is 1000 times off."""
    assert 50.0 < fit_cost.peak_megabytes() < 20_000.0


def test_the_table_is_markdown_with_a_row_a_fit() -> None:
    cost = Cost(
        trials=2, free=3, status="converged", evaluations=5, rollouts=14, slopes=36, seconds=0.1, megabytes=250.4
    )
    head, rule, row = fit_cost.markdown([cost]).splitlines()
    assert head.count("|") == rule.count("|") == row.count("|")
    assert row == "| 2 | 3 | 5 | 14 | 36 | 0.10 | 10.0 | 250 |"


@pytest.mark.slow
def test_cost_grows_linearly_in_trials_and_memory_stays_below_1_gb() -> None:
    """Up to twenty trials of 10.4 s, each fit in a process of its own; work is counted, for time is the machine's.

    Catches an optimiser that needs more iterations the more there is to fit, and Jacobians kept of every iteration.
    """
    by_trials = [fit_cost.alone(trials, 9) for trials in (1, 5, 20)]
    by_free = [fit_cost.alone(2, free) for free in (2, 5, 9)]
    assert [cost.status for cost in by_trials + by_free] == ["converged"] * 6
    for costs in (by_trials, by_free):
        each = [cost.slopes / cost.trials for cost in costs]
        assert max(each) < 2.0 * min(each), costs
    for cost in by_trials + by_free:  # an optimum on a bound is evaluated once more
        assert cost.rollouts - cost.trials * cost.evaluations in (0, cost.trials)
    assert max(cost.megabytes for cost in by_trials) < 1000.0
    assert by_trials[-1].megabytes - by_trials[0].megabytes < 250.0
