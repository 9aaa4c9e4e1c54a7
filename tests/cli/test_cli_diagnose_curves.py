"""Mechanisms and their curves in the terminal, and ``--curves``."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from command_line import Run
from diagnosed import VISITED, diagnosis, drag_law, learned_diagnosis

import mjfish
from mjfish.cli import console
from mjfish.cli.diagnosis_text import show
from mjfish.diagnosis import Diagnosis
from mjfish.effects import find


@pytest.fixture(autouse=True)
def wide(monkeypatch: pytest.MonkeyPatch) -> None:
    """Tables are not folded."""
    monkeypatch.setattr(console.out, "_width", 200)


def _printed(capsys: pytest.CaptureFixture[str], result: Diagnosis) -> str:
    show(result, "pool", verbose=True)
    return capsys.readouterr().out


def _of_body(speed: float) -> str:
    """Return the reading of the body's curve, from what `diagnosed.drag_curve` makes it of."""
    y, half = 1.2 * speed**-0.25, 0.05 + 0.3 * abs(np.log10(speed / 0.2)) ** 3
    return f"{y:.3g} ({y - half:.3g} to {y + half:.3g}) at {speed:.2g} m/s"


def test_a_mechanism_is_told_with_its_forms_and_its_curves_at_the_ends_of_what_was_visited(
    capsys: pytest.CaptureFixture[str],
) -> None:
    shown = _printed(capsys, learned_diagnosis())
    told = "drag_law: these data do not settle its form: reynolds_drag or linear_drag\n"
    assert told in shown
    assert f"c_d of body: {_of_body(VISITED[0])}, {_of_body(VISITED[1])}\n" in shown
    assert "c_f of head: the runs say nothing of it\n" in shown
    assert shown.index(told) < shown.index("drag_law.whole")


def test_the_level_and_the_form_are_told(capsys: pytest.CaptureFixture[str]) -> None:
    law = drag_law()
    settled = replace(law, level="form", form="linear_drag", forms=("linear_drag",))
    shown = _printed(capsys, diagnosis(mechanisms=(settled, replace(law, forms=()))))
    assert "drag_law: its form is linear_drag\n" in shown
    assert "drag_law: no formula fits, its form is learned\n" in shown


def test_values_of_a_curve_are_no_reading(capsys: pytest.CaptureFixture[str]) -> None:
    """Shape numbers are; how many numbers are left out is said."""
    shown = _printed(capsys, learned_diagnosis())
    assert "drag_law.whole" in shown
    assert "across_1" not in shown
    count = sum(not p.shape for p in find("drag_law").parameters)
    assert f"and {count} values of smooth curves, which --json writes" in " ".join(shown.split())
    plain = _printed(capsys, diagnosis())
    assert "smooth curves" not in plain
    assert "mechanism" not in plain


def test_a_summary_has_a_line_a_curve_and_ten_lines_at_most() -> None:
    summary = learned_diagnosis().summary()
    assert f"\n  c_d of body: {_of_body(VISITED[0])}, {_of_body(VISITED[1])}\n" in summary
    assert "across_1" not in summary
    assert "held out: nRMSE" in summary
    found = learned_diagnosis()
    twice = replace(found, mechanisms=(*found.mechanisms, *found.mechanisms)).summary()
    assert len(twice.splitlines()) == 10
    assert "held out: nRMSE" in twice


def test_the_curves_are_written_where_they_are_asked_for(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mjfish, "diagnose", lambda dataset, **rest: learned_diagnosis())
    run("generate --modes v1,v3 --duration 2 --out a")
    shown = run("diagnose a --curves out/curves").stdout
    assert "No curve was written" not in shown
    names = {path.name for path in (tmp_path / "out" / "curves").iterdir()}
    assert names == {f"drag_law-{name}.csv" for name in ("c_d-head", "c_d-body", "c_d-tail", "c_f-head", "c_f-body")}


def test_where_there_is_no_curve_nothing_is_written_and_that_is_said(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mjfish, "diagnose", lambda dataset, **rest: diagnosis())
    run("generate --modes v1,v3 --duration 2 --out a")
    shown = run("diagnose a --curves curves").stdout
    assert "No curve was written to curves: no mechanism is named whose form is a curve." in shown
    assert not (tmp_path / "curves").exists()


def test_a_folder_that_could_not_be_written_is_refused_before_the_work(refuse: Callable[[str], str], run: Run) -> None:
    run("generate --modes v1,v3 --duration 2 --out a")
    assert "is a file, expected a folder" in refuse("diagnose a --curves a/dataset.toml")
