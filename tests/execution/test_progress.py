"""The share of the work that is done: it never falls, moves with every simulation, and stops short of what is ahead."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import pytest

from mjfish.execution import check_time, executing, mapped
from mjfish.execution.progress import Meter


@pytest.fixture
def told() -> list[tuple[str, float]]:
    """What was told."""
    return []


@pytest.fixture
def meter(told: list[tuple[str, float]]) -> Meter:
    """A meter that tells it."""
    return Meter(lambda what, done: told.append((what, done)))


def _rises(told: list[tuple[str, float]]) -> Iterator[float]:
    return (after - before for (_, before), (_, after) in pairwise(told))


def test_a_stage_begins_where_the_last_one_ends_and_the_last_ends_with_all(
    meter: Meter, told: list[tuple[str, float]]
) -> None:
    meter.stage("a", 0.2)
    meter.stage("b", 0.5)
    meter.stage("done", 1.0)
    assert told == [("a", 0.0), ("b", 0.2), ("done", 1.0)]


def test_every_simulation_moves_it_and_none_takes_it_beyond_its_stage(
    meter: Meter, told: list[tuple[str, float]]
) -> None:
    """It stood at 80 % for minutes."""
    meter.stage("a", 0.5)
    with executing(meter=meter):
        for _ in range(200):
            check_time()
        for left in range(40, -1, -1):
            meter.refitted(left)
            check_time()
    assert all(rise > 0.0 for rise in _rises(told))
    assert 0.3 < told[-1][1] < 0.5


def test_a_long_refit_goes_on_moving(meter: Meter, told: list[tuple[str, float]]) -> None:
    meter.stage("a", 1.0 - 1e-9)
    meter.refitted(0)
    before = told[-1][1]
    for _ in range(2000):
        meter.simulated()
    assert 0.1 < told[-1][1] - before < 1.0 - before


def test_a_stage_that_comes_again_takes_nothing_back(meter: Meter, told: list[tuple[str, float]]) -> None:
    for end in (0.8, 0.95, 0.8):
        meter.stage("pairs", end)
        for left in (2, 1, 0):
            meter.refitted(left)
            meter.simulated()
    assert all(rise >= 0.0 for rise in _rises(told))
    assert told[-1][1] < 0.95


def test_simulations_in_other_threads_count(meter: Meter, told: list[tuple[str, float]]) -> None:
    meter.stage("a", 1.0 - 1e-9)
    with executing(jobs=4, meter=meter):
        list(mapped(lambda _: check_time(), range(100)))
    assert len(told) == 101
    assert all(rise > 0.0 for rise in _rises(told))
