"""What a diagnosis leaves open, and files that are none."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from mjfish.design.question import Question, of_diagnosis, of_file
from mjfish.errors import InputError


def _raw(verdict: str, rivals: list[list[str]] | None = None, causes: tuple[str, ...] = ()) -> dict[str, Any]:
    sizes = {"a": 3.0, "b": 9.0, "c": 5.0}
    return {
        "dataset": "d",
        "verdict": verdict,
        "rivals": rivals or [],
        "causes": [{"name": name} for name in causes],
        "candidates": [
            {"name": n, "applicable": True, "statistic": s, "parameters": {"size": {"estimate": s / 10.0}}}
            for n, s in sizes.items()
        ]
        + [{"name": "x", "applicable": False, "statistic": 0.0, "parameters": None}],
    }


def test_rivals_of_a_diagnosis_are_told_apart_from_the_sizes_it_found() -> None:
    asked = of_diagnosis(_raw("cannot_tell", [["c", "a"]]))
    assert (asked.purpose, asked.names) == ("separate", ("c", "a"))
    assert asked.starts["c.size"] == 0.5


def test_a_named_cause_is_tried_against_the_runner_up() -> None:
    assert of_diagnosis(_raw("named", causes=("c",))).names == ("c", "b")
    assert of_diagnosis(_raw("unexplained")).names == ("b", "c")


def test_where_nothing_is_wrong_the_causes_are_to_be_seen() -> None:
    asked = of_diagnosis(_raw("nothing_wrong"), ("a",))
    assert (asked.purpose, asked.names) == ("see", ("a",))


def test_a_file_that_is_no_diagnosis_of_the_dataset_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "diagnosis.json"
    with pytest.raises(InputError, match="no such file"):
        of_file(path, "d")
    path.write_text("{")
    with pytest.raises(InputError, match="cannot be read as JSON"):
        of_file(path, "d")
    path.write_text("[]")
    with pytest.raises(InputError, match="is no diagnosis"):
        of_file(path, "d")
    path.write_text(json.dumps({"dataset": "d"}))
    with pytest.raises(InputError, match="'candidates' is missing"):
        of_file(path, "d")
    path.write_text(json.dumps(_raw("unexplained")))
    with pytest.raises(InputError, match="of 'd', expected that of 'other'"):
        of_file(path, "other")
    assert of_file(path, "d").names == ("b", "c")


def test_rivals_are_two_at_least_and_each_once() -> None:
    with pytest.raises(InputError, match="two or more"):
        Question("separate", ("a",))
    with pytest.raises(InputError, match="there twice"):
        Question("separate", ("a", "a"))
