"""``mjfish diagnose diagnosis.json``: a saved diagnosis is shown again, without a run."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from command_line import Run
from diagnosed import diagnosis, learned_diagnosis

import mjfish


@pytest.fixture(autouse=True)
def _no_run(monkeypatch: pytest.MonkeyPatch) -> None:
    def diagnose(*_: Any, **__: Any) -> Any:
        raise AssertionError("a run")

    monkeypatch.setattr(mjfish, "diagnose", diagnose)


def test_a_saved_diagnosis_is_shown_and_its_page_and_curves_are_written_again(run: Run, tmp_path: Path) -> None:
    learned_diagnosis().save(tmp_path / "diagnosis.json")
    shown = run("diagnose diagnosis.json --verbose --report page.html --curves curves").stdout
    assert shown.startswith("named")
    assert "What the verdict is read from" in shown
    learned_diagnosis().report(tmp_path / "first.html")
    assert (tmp_path / "page.html").read_text() == (tmp_path / "first.html").read_text()
    assert (tmp_path / "curves" / "drag_law-c_d-body.csv").is_file()


def test_the_exit_code_is_that_of_the_diagnosis_and_the_dataset_has_no_name(run: Run, tmp_path: Path) -> None:
    diagnosis("cannot_tell").save(tmp_path / "rivals.json")
    assert "plan DATASET ranks runs" in run("diagnose rivals.json").stdout
    diagnosis("unexplained").save(tmp_path / "unexplained.json")
    run("diagnose unexplained.json", exit_code=1)


@pytest.mark.parametrize("option", ["--rrd fish.rrd", "--extended fish.toml", "--out out", "--splits 3", "--limit 3"])
def test_what_needs_a_run_is_refused(option: str, refuse: Callable[[str], str], tmp_path: Path) -> None:
    diagnosis().save(tmp_path / "diagnosis.json")
    said = refuse(f"diagnose diagnosis.json {option}")
    assert f"diagnosis.json: is a saved diagnosis, found with {option.split()[0]}; leave out what needs a run" in said
    assert len(list(tmp_path.iterdir())) == 1


def test_a_file_that_is_none_is_refused(refuse: Callable[[str], str], tmp_path: Path) -> None:
    (tmp_path / "other.json").write_text("{}")
    assert "other.json: is no diagnosis" in refuse("diagnose other.json")
    assert "none.json: no such file; write it by" in refuse("diagnose none.json")
