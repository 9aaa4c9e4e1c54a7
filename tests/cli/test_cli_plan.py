"""`mjfish plan`: from rivals by hand, from a diagnosis, and what it refuses."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from command_line import Run
from diagnosed import diagnosis

GENERATE = "generate --modes v1 --duration 2 --effect servo_lag:time_constant=0.02 --noise 0.02,0.02,0.1 --out pool"


@pytest.fixture
def pool(run: Run) -> str:
    run(GENERATE)
    return "pool"


def test_causes_named_by_hand_are_made_visible(run: Run, pool: str, tmp_path: Path) -> None:
    told = run(f"plan {pool} --causes munk_moment,servo_lag --omega 12,24 --duration 1.5 --json plan.json").stdout
    assert "Minimum detectable effects" in told
    plan = json.loads((tmp_path / "plan.json").read_text())
    assert plan["question"] == {"purpose": "see", "names": ["munk_moment", "servo_lag"], "why": "Causes named by hand."}
    new = [option for option in plan["options"] if not option["name"].endswith("-again")]
    assert {option["seconds"] for option in new} == {31.5}
    assert max(segment["omega"] for option in new for segment in option["drive"]) == 24.0


def test_a_diagnosis_gives_the_rivals_and_their_fits(run: Run, pool: str, tmp_path: Path) -> None:
    found = diagnosis("cannot_tell")
    replace(found, setup=replace(found.setup, dataset="pool")).save(tmp_path / "found.json")
    told = run(f"plan {pool} --diagnosis found.json --generate next").stdout
    assert "The data cannot tell servo_lag or time_offset apart." in told
    assert "sync-flash" in told
    assert (tmp_path / "next" / "RECORD.md").is_file()


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        ("--rivals servo_lag", "two or more"),
        ("--rivals servo_lag,no_such", "unknown effect 'no_such'"),
        ("--rivals a,b --causes c", "expected alone"),
        ("--diagnosis none.json", "none.json: no such file"),
        ("--causes servo_lag --omega 9", "--omega"),
        ("--causes servo_lag --generate pool", "is not empty"),
        ("--causes servo_lag --json no/where.json", "there is no folder"),
    ],
)
def test_what_cannot_be_planned_is_refused(
    run: Run, refuse: Callable[[str], str], pool: str, options: str, complaint: str
) -> None:
    assert complaint in refuse(f"plan {pool} {options}")
