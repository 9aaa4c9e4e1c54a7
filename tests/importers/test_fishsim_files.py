"""What is not a marker file is refused, by file, row and column."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from filmed_swimming import Swim

from mjfish.data import importers
from mjfish.errors import InputError, MjfishError, UnknownNameError
from mjfish.numerics.arrays import FloatArray

Lines = list[str]


def _lines(path: Path) -> Lines:
    return Swim(seconds=2.6).write(path).read_text().splitlines()


def _cell(lines: Lines, row: int, column: int, text: str) -> Lines:
    cells = lines[row - 1].split(",")
    cells[column - 1] = text
    return [*lines[: row - 1], ",".join(cells), *lines[row:]]


SPOILED: dict[str, tuple[Callable[[Lines], Lines], tuple[str, ...]]] = {
    "header": (lambda lines: [",".join(["X", "Y"] * 9), *lines], ("row 1, column 1 (X0)", "'X'", "without header")),
    "text": (lambda lines: _cell(lines, 7, 6, "lost"), ("row 7, column 6 (Y2)", "'lost'", "correct")),
    "empty cell": (lambda lines: _cell(lines, 8, 1, ""), ("row 8, column 1 (X0)", "the cell is empty")),
    "nan": (lambda lines: _cell(lines, 9, 18, "nan"), ("row 9, column 18 (Y8)", "nan", "finite")),
    "infinite": (lambda lines: _cell(lines, 9, 17, "-inf"), ("row 9, column 17 (X8)", "-inf")),
    "a column less": (lambda lines: [line.rpartition(",")[0] for line in lines], ("row 1", "17 cells", "18")),
    "a ragged row": (lambda lines: [*lines[:20], lines[20] + ",1", *lines[21:]], ("row 21", "19 cells", "18")),
    "too few rows": (lambda lines: lines[:59], ("59 frames", "60 or more")),
    "empty": (lambda lines: [], ("the file is empty",)),
}


@pytest.mark.parametrize("case", SPOILED)
def test_spoiled_files_are_refused_by_row_and_column(tmp_path: Path, case: str) -> None:
    spoil, parts = SPOILED[case]
    path = tmp_path / "markers_run.csv"
    path.write_text("\n".join(spoil(_lines(path))))
    with pytest.raises(InputError) as caught:
        importers.import_files("fishsim", [path])
    for part in (str(path), *parts):
        assert part in str(caught.value), (part, str(caught.value))


def test_absent_and_binary_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"nowhere\.csv: no such file"):
        importers.import_files("fishsim", [tmp_path / "nowhere.csv"])
    (tmp_path / "image.csv").write_bytes(b"\xff\xd8\xff\xe0" * 100)
    with pytest.raises(InputError, match=r"image\.csv: row 1: 1 cells, expected 18"):
        importers.import_files("fishsim", [tmp_path / "image.csv"])


def test_a_run_shorter_than_two_beats_is_refused(tmp_path: Path) -> None:
    path = Swim(seconds=1.5).write(tmp_path / "markers_run.csv")
    with pytest.raises(InputError, match=r"the longest usable stretch has [0-9]+ frames, expected 1[0-9]{2} or more"):
        importers.import_files("fishsim", [path])


def test_markers_that_never_move_apart_leave_no_scale(tmp_path: Path) -> None:
    def spoil(pixel: FloatArray) -> None:
        pixel[:, 1] = pixel[:, 0]

    with pytest.raises(InputError, match="markers 0 and 1 lie on each other"):
        importers.import_files("fishsim", [Swim(seconds=2.6).write(tmp_path / "markers_run.csv", spoil)])


def test_names_that_do_not_exist_list_those_that_do(tmp_path: Path) -> None:
    path = Swim(seconds=2.6).write(tmp_path / "markers_run.csv")
    with pytest.raises(
        UnknownNameError,
        match=r"unknown importer 'vicon'; known: deeplabcut, fishsim, markers, .*velocities; or give a Python file",
    ):
        importers.import_files("vicon", [path])
    with pytest.raises(UnknownNameError, match="unknown trial to hold out 'walk'; known: run"):
        importers.import_files("fishsim", [path], held_out=["walk"])


def test_files_that_make_no_dataset_are_refused(tmp_path: Path) -> None:
    path = Swim(seconds=2.6).write(tmp_path / "markers_run.csv")
    other = Swim(seconds=2.6).write(tmp_path / "run.csv")
    cases: list[tuple[list[Path], list[str], str]] = [
        ([], [], "no files to import"),
        ([path, path], [], "given twice"),
        ([path, other], [], "has the name of another"),
        ([path], ["run"], "all trials are held out"),
    ]
    for files, held_out, message in cases:
        with pytest.raises(MjfishError, match=message):
            importers.import_files("fishsim", files, held_out=held_out)


def test_no_trial_has_a_role_unless_something_sets_them_apart(tmp_path: Path) -> None:
    """The report has a row a file, under its headers."""
    files = [Swim(seconds=2.6, seed=seed).write(tmp_path / f"markers_{seed}.csv") for seed in range(2)]
    dataset, report = importers.import_files("fishsim", files)
    assert [run.role for run in dataset.trials] == [None, None]
    assert [run.role for run in importers.import_files("fishsim", files, ["0"])[0].trials] == ["held_out", "fit"]
    rows = report.rows()
    assert [row[0] for row in rows] == [file.name for file in files]
    assert {len(row) for row in rows} == {len(importers.HEADERS)}
    assert rows[0][importers.HEADERS.index("frames")] == "156"
