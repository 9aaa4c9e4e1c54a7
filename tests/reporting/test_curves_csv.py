"""Curves as CSV files: what was measured is in them, and they are there all together or not at all."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
from diagnosed import diagnosis, learned_diagnosis

from mjfish import reporting
from mjfish.errors import InputError
from mjfish.inspection import Inspection


def _columns(path: Path) -> dict[str, np.ndarray]:
    with path.open(encoding="utf-8", newline="") as file:
        header, *rows = csv.reader(file)
    return dict(zip(header, np.array(rows, dtype=float).T, strict=True))


def test_every_curve_has_a_file_with_its_numbers(tmp_path: Path) -> None:
    found = learned_diagnosis()
    written = found.write_curves(tmp_path / "deep" / "curves")
    (mechanism,) = found.mechanisms
    assert len(written) == len(mechanism.curves) == 5
    for curve in mechanism.curves:
        path = tmp_path / "deep" / "curves" / f"drag_law-{curve.quantity}-{curve.group}.csv"
        assert path in written
        table, y = _columns(path), curve.quantity
        assert list(table) == [
            "speed [m/s]", f"{y} [-]", f"{y}_low [-]", f"{y}_high [-]", "nominal [-]", "visited [-]"
        ]  # fmt: skip
        exact = (curve.x.values, curve.y.values, curve.y.low, curve.y.high, curve.nominal)
        for written_, values in zip(table.values(), exact, strict=False):
            np.testing.assert_array_equal(written_, values)
    assert sorted(p.name for p in (tmp_path / "deep" / "curves").iterdir()) == sorted(path.name for path in written)


def test_a_file_says_where_the_runs_have_been(tmp_path: Path) -> None:
    learned_diagnosis().write_curves(tmp_path)
    table = _columns(tmp_path / "drag_law-c_d-body.csv")
    speed = table["speed [m/s]"]
    np.testing.assert_array_equal(table["visited [-]"], (speed > 0.045) & (speed < 0.48))
    assert 0 < np.sum(table["visited [-]"]) < len(speed)
    assert not np.any(_columns(tmp_path / "drag_law-c_f-head.csv")["visited [-]"])


def test_without_a_curve_nothing_is_written(tmp_path: Path) -> None:
    assert diagnosis().write_curves(tmp_path / "curves") == ()
    assert list(tmp_path.iterdir()) == []


def test_curves_are_written_all_or_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The files from before stay as they were where one of the new ones fails."""
    (tmp_path / "drag_law-c_d-head.csv").write_text("from before")
    done: list[Path] = []

    def fail(path: Path, table: object) -> None:
        done.append(path)
        path.write_text("new")
        if len(done) == 3:
            raise OSError(28, "No space left on device")

    monkeypatch.setattr("mjfish.reporting.curves.write_table", fail)
    with pytest.raises(InputError, match="cannot be written: No space left on device"):
        learned_diagnosis().write_curves(tmp_path)
    assert [p.name for p in tmp_path.iterdir()] == ["drag_law-c_d-head.csv"]
    assert (tmp_path / "drag_law-c_d-head.csv").read_text() == "from before"


def test_a_folder_in_the_place_of_a_file_is_refused_before_any_is_written(tmp_path: Path) -> None:
    (tmp_path / "drag_law-c_f-body.csv").mkdir()
    with pytest.raises(InputError, match="is a folder, expected the name of a file"):
        learned_diagnosis().write_curves(tmp_path)
    assert [p.name for p in tmp_path.iterdir()] == ["drag_law-c_f-body.csv"]


def test_a_result_without_curves_of_its_kind_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="Inspection has no curves to write"):
        reporting.write_curves(Inspection(), tmp_path)
