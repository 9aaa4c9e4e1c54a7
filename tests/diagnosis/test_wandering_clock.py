"""A drive whose clock wanders is named, alone and beside another cause; nothing else is taken for it."""

from __future__ import annotations

import numpy as np
import pytest

import mjfish
from mjfish.diagnosis import diagnose
from mjfish.diagnosis.table import Row, Table
from mjfish.diagnosis.verdict import decide
from mjfish.effects import catalogue, find

NOISE = (0.006, 0.006, 0.04)
WANDER = Row(
    ("clock_wander",), {"clock_wander": "the clock wanders"}, ("clock_wander",), False, 50.0, 1, 50.0, np.nan, np.nan
)


def _pool(values: dict[str, float], seed: int = 11) -> mjfish.Dataset:
    modes = ["v1", "v3", "v5", "v7"]
    return mjfish.generate("pike", modes, values=values, noise=NOISE, duration=5.0, seed=seed, held_out=["v3"])


def test_a_wandering_clock_is_named() -> None:
    few = {name: find(name) for name in ("clock_wander", "servo_lag", "time_offset", "linear_drag", "marker_offset")}
    found = diagnose(_pool({"clock_wander.size": 0.006}), effects=few, jobs=1)
    assert found.verdict == "named", found.message
    (cause,) = found.causes
    assert cause.name == "clock_wander"
    assert cause.parameters["size"].low < 0.006 < cause.parameters["size"].high
    (row,) = found.table.random
    assert row.gain > 100.0
    assert found.p_wrong < 1e-9 < 0.01 < found.table.p_wrong
    assert "clock_wander.size" in found.fish.values
    assert {finding.code for finding in found.checks.findings} == {"design-no-turn"}
    assert mjfish.simulate(found.fish, duration=1.0).status == "ok"
    assert found.to_dict()["table"]["rows"][0]["names"] == ["clock_wander"]


@pytest.mark.slow
def test_without_it_in_the_catalogue_it_is_not_asked_for() -> None:
    few = {name: find(name) for name in ("servo_lag", "linear_drag")}
    found = diagnose(_pool({"clock_wander.size": 0.006}), effects=few, jobs=1)
    assert found.verdict != "named", found.message
    assert not found.table.random


@pytest.mark.slow
def test_it_is_named_beside_another_cause() -> None:
    found = diagnose(_pool({"clock_wander.size": 0.006, "linear_drag.across": 40.0}), jobs=2)
    assert {cause.name for cause in found.causes} == {"clock_wander", "linear_drag"}, found.message


@pytest.mark.slow
@pytest.mark.parametrize(
    "values", [{"servo_lag.time_constant": 0.03}, {f"servo_backlash.joint_{i}": 0.05 for i in range(1, 5)}]
)
def test_a_servo_is_no_wandering_clock(values: dict[str, float]) -> None:
    found = diagnose(_pool(values), effects=catalogue(), jobs=2)
    assert not found.table.random
    assert "clock_wander" not in {cause.name for cause in found.causes}


def test_random_causes_are_added_to_what_the_table_says() -> None:
    alone = decide(Table(p_wrong=0.4, random=(WANDER,)))
    assert alone.verdict == "named"
    assert alone.sets == (("clock_wander",),)
    neither = decide(Table(p_wrong=1e-9, random=(WANDER,)))
    assert neither.verdict == "unexplained"
    assert "clock_wander" in neither.message
    blocked = decide(Table(p_wrong=0.4, blocks=("swapped",), random=(WANDER,)))
    assert blocked.verdict == "cannot_tell"
    assert "clock_wander" not in blocked.message
