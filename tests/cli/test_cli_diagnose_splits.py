"""``mjfish diagnose --splits``: the table in the terminal, the section in the report, and the folder of ``--out``."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from command_line import Run
from diagnosed import diagnosis

import mjfish
from mjfish.data import Dataset
from mjfish.diagnosis import Diagnosis, splits
from mjfish.diagnosis.forms import NamedMechanism
from mjfish.effects import find
from mjfish.errors import InputError

_FILES = {"diagnosis.json", "report.html", "fish.rrd", "extended.toml"}
_LAG = NamedMechanism("servo_dynamics", "drive", "form", "servo_lag", ("servo_lag",), ())


def _made(dataset: Dataset, **rest: Any) -> Diagnosis:
    """Name a servo lag where v3 is held out, leave rivals where v1 is, refuse where v5 is."""
    (held,) = (trial.name for trial in dataset.split()[1])
    if held == "v5":
        raise InputError("a: 9 numbers for 12 free parameters")
    found = diagnosis(mechanisms=(_LAG,)) if held == "v3" else diagnosis("cannot_tell")
    return replace(found, dataset=dataset)


@pytest.fixture
def stubbed(run: Run, monkeypatch: pytest.MonkeyPatch) -> Run:
    """Diagnoses of three runs are made by hand."""
    monkeypatch.setattr(splits, "diagnose", _made)
    monkeypatch.setattr(mjfish, "diagnose", _made)
    run("generate --modes v1,v3,v5 --duration 1 --held-out v3 --out a")
    return run


def _rows(printed: str) -> list[list[str]]:
    """Return the cells of the tables, a list a row."""
    below = re.findall(r"^─+\n((?:.*\n)+?)(?=\S*─|\Z)", printed.replace("\N{NO-BREAK SPACE}", " "), re.MULTILINE)
    rows = [re.split(r"  +(?!\()", line.strip()) for table in below for line in table.splitlines()]
    return [row for row in rows if len(row) == 5 and row[0] != "held out"]


def test_the_diagnosis_is_told_first_and_the_splits_behind_it(stubbed: Run) -> None:
    shown = stubbed("diagnose a --splits 9").stdout
    plain = stubbed("diagnose a").stdout
    assert shown.startswith(plain)
    rows = _rows(shown[len(plain) :])
    assert rows == [
        ["servo_dynamics", "1 of 2", "1", "0", "1"],
        ["v1", "v3, v5", "cannot tell", "not named: servo_dynamics", "61.8 % less (57.0 % to 66.0 %)"],
        ["v3 (as divided)", "v1, v5", "named", "servo_dynamics (form)", "61.8 % less (57.0 % to 66.0 %)"],
        ["v5", "v1, v3", "–", "not diagnosed: a: 9 numbers for 12 free parameters", "–"],
    ]
    assert "The verdict named (servo_dynamics) came in 1 of 3 splits" in shown


def test_the_folder_has_all_files_and_the_splits_where_there_are_some(stubbed: Run, tmp_path: Path) -> None:
    stubbed("diagnose a --splits 9 --out out/new/splits")
    stubbed("diagnose a --out plain")
    folder = tmp_path / "out" / "new" / "splits"
    assert {path.name for path in folder.iterdir()} == {*_FILES, "splits.json"}
    assert {path.name for path in (tmp_path / "plain").iterdir()} == _FILES
    written = json.loads((folder / "splits.json").read_text())
    assert [split["verdict"] for split in written["splits"]] == ["cannot_tell", "named", None]
    assert json.loads((folder / "diagnosis.json").read_text())["verdict"] == "named"
    title = "How firmly the verdict is held"
    assert title in (folder / "report.html").read_text(encoding="utf-8")
    assert title not in (tmp_path / "plain" / "report.html").read_text(encoding="utf-8")


def test_a_file_that_is_named_is_written_there_and_not_to_the_folder(stubbed: Run, tmp_path: Path) -> None:
    stubbed("diagnose a --splits 1 --out out --report own.html")
    assert "How firmly the verdict is held" in (tmp_path / "own.html").read_text(encoding="utf-8")
    assert {path.name for path in (tmp_path / "out").iterdir()} == {*_FILES, "splits.json"} - {"report.html"}


@pytest.mark.parametrize(("held_out", "code"), [("v1", 0), ("v3", 1)])
def test_the_exit_code_is_that_of_the_dataset_as_it_is_divided(
    stubbed: Run, monkeypatch: pytest.MonkeyPatch, held_out: str, code: int
) -> None:
    def unexplained(dataset: Dataset, **rest: Any) -> Diagnosis:
        (held,) = dataset.split()[1]
        return replace(diagnosis("unexplained" if held.name == held_out else "named"), dataset=dataset)

    monkeypatch.setattr(splits, "diagnose", unexplained)
    stubbed("diagnose a --splits 3", exit_code=code)


def test_what_cannot_be_done_is_refused_before_the_work(refuse: Callable[[str], str], run: Run) -> None:
    run("generate --modes v1,v3 --duration 1 --out two")
    assert "two: 2 runs, expected 3 or more to divide anew; record 1 more" in refuse("diagnose two --splits 4 --out x")
    assert "--splits" in refuse("diagnose two --splits 0")
    assert "is a file, expected a folder" in refuse("diagnose two --out two/dataset.toml")


@pytest.mark.slow
def test_a_planted_lag_is_named_in_all_splits(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """No stub. The effects and the seed of the command line reach every split."""
    few = {name: find(name) for name in ("servo_lag", "time_offset")}
    monkeypatch.setattr("mjfish.effects.catalogue", lambda files=(): few)
    run("generate --modes v1,v3,v5 --duration 4 --effect servo_lag:time_constant=0.03 --held-out v3 --seed 3 --out a")
    shown = run("diagnose a --splits 2 --seed 1 --jobs 1 --out out").stdout
    written = json.loads((tmp_path / "out" / "splits.json").read_text())
    assert [one["name"] for one in written["mechanisms"]] == ["servo_dynamics"]
    assert written["mechanisms"][0]["count"] == written["diagnosed"] == 2
    assert written["provenance"]["seed"] == 1
    assert "came in 2 of 2 splits" in shown
