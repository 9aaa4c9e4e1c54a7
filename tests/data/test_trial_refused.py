"""Each thing that can be wrong with a dataset is refused, by its place and with what to do."""

from __future__ import annotations

from pathlib import Path

import pytest
from recordings import (
    TOML,
    Edit,
    cell,
    cpg_csv,
    lines,
    measured_csv,
    refusal,
    swap,
    with_column,
    without_column,
    write_folder,
)

from mjfish import data as trial
from mjfish.errors import MjfishError, ParameterError, UnknownNameError


def degrees(text: str) -> str:
    head, *rows = text.splitlines()
    cells = [row.split(",") for row in rows]
    turned = [[*row[:4], *(repr(57.29577951308232 * float(x)) for x in row[4:])] for row in cells]
    return "\n".join([head, *(",".join(row) for row in turned)]) + "\n"


#: what is broken, the edit of cpg.csv, what the message must say: place, finding, remedy.
CPG_FILE: dict[str, tuple[Edit, tuple[str, ...]]] = {
    "missing column": (without_column(0), ("column 'time [s]' is missing", "found surge [m/s], sway", "add it")),
    "degrees per second": (
        swap("yaw_rate [rad/s]", "yaw_rate [deg/s]"),
        ("column 4 'yaw_rate [deg/s]'", "expected [rad/s]", "multiply by pi/180"),
    ),
    "odd unit": (swap("surge [m/s]", "surge [knots]"), ("column 2", "[knots], expected [m/s]", "convert the values")),
    "no unit": (swap("surge [m/s]", "surge"), ("column 2 'surge'", "no unit", "expected 'surge [m/s]'")),
    "empty unit": (swap("surge [m/s]", "surge []"), ("column 2", "no unit", "expected 'surge [m/s]'")),
    "unknown column": (with_column("depth [m]"), ("column 5 'depth [m]'", "unknown column", "rename or remove")),
    "spelling": (swap("surge", "Surge"), ("column 2", "did you mean 'surge [m/s]'?")),
    "row numbers": (with_column(""), ("column 5 ''", "row numbers", "without them")),
    "duplicate column": (with_column("surge [m/s]"), ("columns 2 and 5 are both 'surge [m/s]'", "remove")),
    "joint counted from 0": (with_column("joint_0 [rad]"), ("column 5", "unknown column", "joint_1 [rad]")),
    "time repeats": (cell(11, 0, "0.18"), ("row 11 (line 12)", "0.18 s repeats that of row 10", "remove one")),
    "time goes back": (cell(11, 0, "0.1"), ("row 11 (line 12)", "before the 0.18 s of row 10", "sort the rows")),
    "NaN": (cell(7, 1, "nan"), ("row 7 (line 8), column 'surge [m/s]'", "nan", "finite", "remove the row")),
    "infinity": (cell(7, 3, "-inf"), ("row 7 (line 8), column 'yaw_rate [rad/s]'", "-inf", "finite")),
    "too large": (cell(7, 3, "1e999"), ("row 7 (line 8)", "inf", "finite")),
    "text": (cell(7, 1, "abc"), ("row 7 (line 8), column 'surge [m/s]'", "'abc' is not a number", "correct it")),
    "underscore": (cell(7, 1, "1_0"), ("row 7 (line 8)", "'1_0' is not a number")),
    "long text": (cell(7, 1, "x" * 90), ("row 7 (line 8)", f"'{'x' * 40}...' is not a number")),
    "empty cell": (cell(7, 1, " "), ("row 7 (line 8), column 'surge [m/s]'", "cell is empty", "fill it in")),
    "decimal comma": (cell(7, 1, "0,02"), ("row 7 (line 8)", "5 cells, expected 4", "complete or remove")),
    "cut off": (
        lambda text: text[:-40],
        ("row 51 (line 52)", "2 cells, expected 4", "found '1.0,0.2'", "complete or remove"),
    ),
    "empty line": (lines(lambda all_: [*all_[:7], "", *all_[7:]]), ("row 7 (line 8)", "is empty", "remove the row")),
    "headers not in line 1": (lambda text: "\n" + text, ("line 1 is empty", "remove the lines above")),
    "endless line": (lambda _: "x" * 200_000, ("has a cell of more than 131072 characters", "save it again")),
    "gap": (
        lines(lambda all_: all_[:11] + all_[14:]),
        ("row 11 (line 12)", "gap of 0.08 s", "from row 10 (0.18 s) to row 11 (0.26 s)", "0.02 s", "cut the recording"),
    ),
    "empty file": (lambda _: "", ("the file is empty", "expected a header")),
    "blank file": (lambda _: "\n \n", ("the file is empty",)),
    "header only": (lines(lambda all_: all_[:1]), ("header and no rows", "expected a row")),
    "one row": (lines(lambda all_: all_[:2]), ("has 1 row", "at least one beat")),
    "shorter than a beat": (
        lines(lambda all_: all_[:16]),
        ("lasts 0.28 s", "expected one beat of 0.3491 s", "omega = 18", "record longer"),
    ),
    "before the start": (
        lines(lambda all_: [all_[0], "-0.02,0,0,0", *all_[1:]]),
        ("row 1 (line 2), column 'time [s]'", "-0.02 s, expected 0 s or later", "remove the rows before"),
    ),
    "ends before a segment": (
        lines(lambda all_: all_[:22]),
        ("trials.1.drive.2.start", "0.5 s is not before the end", "0.4 s", "remove the segment"),
    ),
    "joints and drive": (
        lambda _: measured_csv(),
        ("trials.1.drive", "has measured joint angles too", "remove [[trials.drive]]", "joint_4 [rad]"),
    ),
    "x without yaw": (with_column("x [m]"), ("column 'y [m]' is missing beside x [m]", "add it or remove")),
}
#: The same for measured.csv.
MEASURED_FILE: dict[str, tuple[Edit, tuple[str, ...]]] = {
    "no joints": (lambda _: cpg_csv(), ("trials.2: no drive", "no joint angles", "add [[trials.drive]]", "joint_4")),
    "joint missing": (without_column(5), ("column 'joint_2 [rad]' is missing", "4 joints of fish 'pike'", "add it")),
    "joint too many": (with_column("joint_5 [rad]"), ("'joint_5 [rad]'", "'pike' has 4 joints", "remove it")),
    "degrees": (degrees, ("row 1 (line 2), column 'joint_1 [rad]'", "more than half a turn", "multiply by pi/180")),
    "joints in degrees by header": (swap("joint_2 [rad]", "joint_2 [deg]"), ("column 6", "multiply by pi/180")),
    "shorter than a beat": (lambda _: measured_csv(omega=4.4), ("lasts 1 s", "0.7 of a beat", "record longer")),
    "too few rows": (lines(lambda all_: all_[:6]), ("has 5 rows, expected 7", "record longer")),
}
#: The same for dataset.toml.
TOML_FILE: dict[str, tuple[Edit, tuple[str, ...]]] = {
    "no TOML": (swap("[noise]", "[noise"), ("not valid TOML", "line 6")),
    "endless integer": (swap("= 1", f"= {'9' * 5000}"), ("not valid TOML", "4300 digits")),
    "endless nesting": (swap("= 1", f"= {'[' * 3000}"), ("not valid TOML", "recursion")),
    "bias no list": (swap("[0, 1, 1.5, 2]", "2"), ("trials.1.drive.2.bias: expected a list", "found 2")),
    "unknown key": (swap("clock", "clocks"), (": clocks: unknown key", "correct its spelling")),
    "unknown key of noise": (swap("yaw_rate = 0.05", "yaw_rate = 0.05\nroll = 1"), ("noise.roll: unknown key",)),
    "unknown key of a trial": (swap("file =", "notes = 1\nfile ="), ("trials.1.notes: unknown key",)),
    "unknown key of a segment": (swap("omega = 22", "freq = 22"), ("trials.1.drive.2.freq: unknown key",)),
    "key missing": (swap('name = "pool"\n', ""), (": name: this key is missing; add it",)),
    "schema of the future": (swap("schema = 1", "schema = 2"), (": schema: ", "1", "found 2")),
    "no trials": (lambda text: text.partition("[[trials]]")[0], (": trials: this key is missing",)),
    "clock": (swap("synchronised", "sundial"), (": clock: ", "'synchronised' or 'free'", "found 'sundial'")),
    "role": (swap('"held_out"', '"test"'), ("trials.2.role", "'fit' or 'held_out'", "found 'test'")),
    "nothing to fit": (swap('"fit"', '"held_out"'), (": trials: ", "every role is 'held_out'", "change one")),
    "sigma of zero": (swap("surge = 0.01", "surge = 0"), ("noise.surge: must be above 0", "leave out [noise]")),
    "sigma missing": (swap("sway = 0.01\n", ""), ("noise.sway: this key is missing",)),
    "sigma as text": (swap("sway = 0.01", 'sway = "0.01"'), ("noise.sway: expected a number", "found '0.01'")),
    "sigma infinite": (swap("sway = 0.01", "sway = inf"), ("noise.sway: expected a finite number", "found inf")),
    "omega": (swap("omega = 18.0", "omega = -18.0"), ("trials.1.drive.1.omega: must be above 0", "found -18.0")),
    "bias too short": (swap("[0, 1, 1.5, 2]", "[0, 1]"), ("trials.1.drive.2.bias: 2 numbers", "expected 4", "pike")),
    "drive starts late": (swap("start = 0.0", "start = 0.1"), ("trials.1.drive.1.start: 0.1 s", "expected 0")),
    "drive out of order": (swap("start = 0.5", "start = 0.0"), ("drive.2.start: 0 s is not after", "sort")),
    "drive beyond the data": (swap("start = 0.5", "start = 1.0"), ("drive.2.start: 1 s", "cpg.csv at 1 s", "remove")),
    "trial name twice": (swap('"measured"', '"CPG"'), ("trials.2.name: 'CPG' is also the name of trial 1", "give")),
    "trial file twice": (
        swap('"measured.csv"', '"runs/../cpg.csv"'),
        ("trials.2.file: ", "also the file of trial 1", "remove"),
    ),
    "trial name with a slash": (swap('"cpg"', '"../cpg"'), ("trials.1.name: ", "also a file name", "rename the trial")),
    "trial name hidden": (swap('"cpg"', '".cpg"'), ("trials.1.name: ", "also a file name")),
    "trial name empty": (swap('"cpg"', '""'), ("trials.1.name: ", "also a file name")),
    "trial file absent": (swap('"cpg.csv"', '"gone.csv"'), ("trials.1: ", "gone.csv: no such file", "put it there")),
    "trial file of no name": (swap('"cpg.csv"', '""'), ("trials.1.file: ", "name of a file", "correct it")),
    "trial file with a null": (swap("cpg.csv", "c\\u0000.csv"), ("trials.1.file: ", "name of a file", "correct it")),
    "trial file above": (
        swap('"cpg.csv"', '"runs/../../cpg.csv"'),
        ("trials.1.file: leaves the folder", "copy it there"),
    ),
    "trial file of the system": (swap('"cpg.csv"', '"/etc/passwd"'), ("trials.1.file: leaves the folder", "or link")),
    "errors above": (
        swap('"cpg.csv"', '"cpg.csv"\nerrors = "../cpg.errors.parquet"'),
        ("trials.1.errors: leaves the folder",),
    ),
    "sensor file above": (
        swap('"held_out"', '"held_out"\n[[trials.sensors]]\nkind = "gyro"\nfile = "../gyro.csv"'),
        ("trials.2.sensors.1.file: leaves the folder",),
    ),
    "fish above": (swap('"pike"', '"../pike.toml"'), (": fish: leaves the folder", "copy it there")),
    "the folder itself": (swap('"pike"', '"."'), (": no such fish file", "shipped fish")),
    "trial file of another kind": (swap('"cpg.csv"', '"cpg.xlsx"'), ("trials.1: ", "'.xlsx'", ".csv or .parquet")),
    "start below its bounds": (swap("c_d.head = 1.5", "c_d.head = 0.0"), (": start: c_d.head: start 0", "bounds")),
    "start with empty bounds": (
        swap("c_d.head = 1.5", '"c_d.head" = { low = 5.0 }'),
        (": start: c_d.head: bounds [5, 4] are empty",),
    ),
    "start negative": (swap("c_d.head = 1.5", "c_d.head = -1"), ("start.c_d.head.start: must be at least 0",)),
    "start misspelled": (swap("c_d.head = 1.5", "c_d.head = { begin = 1.5 }"), ("start.c_d.head.begin: unknown key",)),
}


@pytest.mark.parametrize("case", CPG_FILE)
def test_refuses_in_the_table_of_a_cpg_trial(case: str, tmp_path: Path) -> None:
    edit, expected = CPG_FILE[case]
    message = refusal(write_folder(tmp_path, cpg=edit(cpg_csv())))
    assert [part for part in ("cpg.csv", *expected) if part not in message] == [], message


@pytest.mark.parametrize("case", MEASURED_FILE)
def test_refuses_in_the_table_of_a_measured_trial(case: str, tmp_path: Path) -> None:
    edit, expected = MEASURED_FILE[case]
    message = refusal(write_folder(tmp_path, measured=edit(measured_csv())))
    assert [part for part in ("measured.csv", *expected) if part not in message] == [], message


@pytest.mark.parametrize("case", TOML_FILE)
def test_refuses_in_dataset_toml(case: str, tmp_path: Path) -> None:
    edit, expected = TOML_FILE[case]
    with pytest.raises(MjfishError) as caught:
        trial.load_dataset(write_folder(tmp_path, toml=edit(TOML)))
    message = str(caught.value)
    assert [part for part in ("dataset.toml", *expected) if part not in message] == [], message


def test_refuses_names_that_nothing_bears_with_the_known_ones(tmp_path: Path) -> None:
    with pytest.raises(UnknownNameError, match=r"dataset\.toml: fish: unknown fish 'trout'; known: .*pike"):
        trial.load_dataset(write_folder(tmp_path, toml=swap('"pike"', '"trout"')(TOML)))
    with pytest.raises(
        UnknownNameError, match=r"dataset\.toml: start: unknown coefficient 'c_x\.head'; known: c_d\.bo"
    ):
        trial.load_dataset(write_folder(tmp_path, toml=swap("c_d.head", '"c_x.head"')(TOML)))


def test_refuses_a_start_outside_its_bounds_as_a_parameter_error(tmp_path: Path) -> None:
    with pytest.raises(ParameterError, match=r"dataset\.toml: start: c_d\.head: start 9 - is outside its bounds"):
        trial.load_dataset(write_folder(tmp_path, toml=swap("c_d.head = 1.5", "c_d.head = 9")(TOML)))


def test_refuses_a_folder_without_dataset_and_a_path_that_is_not_there(tmp_path: Path) -> None:
    assert "has no dataset.toml" in refusal(tmp_path)
    assert "absent: no such file" in refusal(tmp_path / "absent")


@pytest.mark.parametrize("name", ["gone.toml", "x" * 300 + ".toml"])
def test_refuses_a_fish_file_that_is_not_there(name: str, tmp_path: Path) -> None:
    message = refusal(write_folder(tmp_path, toml=swap('"pike"', f'"{name}"')(TOML)))
    assert "dataset.toml: fish: " in message
    assert name in message


def test_refuses_a_cpg_drive_for_a_fish_without_cpg(tmp_path: Path, pike_toml: str) -> None:
    folder = write_folder(tmp_path, toml=swap('"pike"', '"still.toml"')(TOML))
    (folder / "still.toml").write_text(pike_toml.partition("[cpg]")[0], encoding="utf-8")
    message = refusal(folder)
    assert "trials.1.drive: fish 'pike' has no CPG" in message
    assert "remove the drive" in message
