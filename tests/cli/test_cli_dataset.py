"""``mjfish dataset new``: columns, units and drives that are clear, given, asked for, or refused."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from command_line import Run
from typer.testing import CliRunner

from mjfish.cli import application, console
from mjfish.data import load_dataset

TIME = np.arange(0.0, 3.0, 0.01)
#: surge, sway [m/s], yaw rate [rad/s], two joints [rad].
TRUE = np.column_stack(
    [
        0.2 + 0.01 * np.sin(14 * TIME),
        0.05 * np.sin(7 * TIME),
        np.cos(7 * TIME),
        0.3 * np.sin(7 * TIME),
        np.sin(7 * TIME),
    ]
)
#: The same in ms, mm/s, deg/s, deg.
FOREIGN = np.column_stack([1e3 * TIME, 1e3 * TRUE[:, :2], np.degrees(TRUE[:, 2:])])


def _table(path: Path, header: str, values: np.ndarray) -> None:
    np.savetxt(path, values, delimiter=",", header=header, comments="", encoding="utf-8")


@pytest.fixture
def laboratory(run: Run, tmp_path: Path) -> Run:
    """A fish of two joints, and recordings with clear and with unclear headers."""
    run("fish new trout --length 0.4 --mass 0.6 --joints 2 --height 0.07")
    for name in ("slow", "fast"):
        _table(tmp_path / f"{name}.csv", "t [ms],u (mm/s),v (mm/s),Yaw rate (deg/s),servo1_deg,servo2_deg", FOREIGN)
    _table(tmp_path / "odd.csv", "a,b,c,d,e,f", FOREIGN)
    return run


def _same(folder: Path, columns: int = 5) -> None:
    """The first run has the true numbers, in SI."""
    trial = load_dataset(folder).trials[0]
    np.testing.assert_allclose(trial.time, TIME, atol=1e-12)
    np.testing.assert_allclose(trial.velocity, TRUE[:, :3], atol=1e-12)
    if columns > 3:
        assert trial.joint_angle is not None
        np.testing.assert_allclose(trial.joint_angle, TRUE[:, 3:], atol=1e-12)


def test_clear_headers_need_no_flags_and_what_was_guessed_is_said(laboratory: Run, tmp_path: Path) -> None:
    shown = laboratory("dataset new tank slow.csv fast.csv --fish trout.toml --held-out fast").stdout
    _same(tmp_path / "tank")
    assert [trial.role for trial in load_dataset(tmp_path / "tank").trials] == ["fit", "held_out"]
    written = (tmp_path / "tank" / "dataset.toml").read_text(encoding="utf-8")
    for text in (
        "surge     u (mm/s) in mm/s, guessed from its header",
        "time      t [ms] in ms, guessed from its header",
        "joints    servo1_deg, servo2_deg in deg, guessed from their headers",
        "sway to port, yaw rate to port",
        "held out  fast",
    ):
        assert text in shown
        assert text in written
    assert shown.rstrip().endswith(" inspect tank")


def test_every_column_and_unit_may_be_given(laboratory: Run, tmp_path: Path) -> None:
    shown = laboratory(
        "dataset new tank odd.csv --fish trout.toml --time a --surge b --sway c --yaw-rate d --joints e,f "
        "--time-unit ms --length-unit mm --angle-unit deg"
    ).stdout
    _same(tmp_path / "tank")
    assert "guessed" not in shown


def test_a_column_may_be_named_without_the_unit_in_its_header(laboratory: Run, tmp_path: Path) -> None:
    _table(tmp_path / "other.csv", "clock (ms),ahead (mm/s),aside (mm/s),turn (deg/s),bend1_deg,bend2_deg", FOREIGN)
    laboratory(
        "dataset new tank other.csv --fish trout.toml --time clock --surge ahead --sway aside --yaw-rate turn "
        "--joints bend1,bend2"
    )
    _same(tmp_path / "tank")


def test_units_are_not_asked_for_while_columns_are_lacking(laboratory: Run) -> None:
    """The headers of these columns may name them."""
    refused = laboratory("dataset new tank odd.csv --fish trout.toml", 2).stderr
    assert "--surge" in refused
    assert "--length-unit" not in refused


def test_a_drive_is_given_once_for_all_files_or_once_a_file(laboratory: Run, tmp_path: Path) -> None:
    for name in ("slow", "fast"):
        _table(tmp_path / f"{name}.csv", "t_ms,u_mm_s,v_mm_s,r_dps", FOREIGN[:, :4])
    line = "dataset new {} slow.csv fast.csv --fish trout.toml --frequency 1.2 --frequency 2 --amplitude 10,20"
    laboratory(f"{line} --phase=0,-60".format("tank"))
    _same(tmp_path / "tank", columns=3)
    waves = [trial.wave for trial in load_dataset(tmp_path / "tank").trials]
    assert [wave.frequency for wave in waves if wave] == [1.2, 2.0]
    assert waves[0] is not None
    assert waves[0].free
    np.testing.assert_allclose([waves[0].amplitude, waves[0].phase], np.radians([[10.0, 20.0], [0.0, -60.0]]))
    laboratory(f"{line} --phase=0,-60 --synchronised --set wave.ramp=0.5 --set sway_to=starboard".format("second"))
    second = load_dataset(tmp_path / "second").trials[0]
    assert second.wave is not None
    assert (second.wave.ramp, second.wave.free) == (0.5, False)
    np.testing.assert_allclose(second.velocity[:, 1], -TRUE[:, 1], atol=1e-12)


#: Seconds, cm, degrees, and two joints in degrees.
FILMED = np.column_stack(
    [TIME, 20.0 * TIME, 0.5 * np.sin(7 * TIME + 1.0), np.degrees(0.2 * np.sin(7 * TIME)), np.degrees(TRUE[:, 3:])]
)


def _film(tmp_path: Path, *names: str) -> None:
    for name in names:
        _table(tmp_path / f"{name}.csv", "time,x_cm,y_cm,heading_deg,j1_deg,j2_deg", FILMED)


def test_places_and_headings_become_sensors(laboratory: Run, tmp_path: Path) -> None:
    _film(tmp_path, "film")
    shown = laboratory("dataset new tank film.csv --fish trout.toml").stdout
    (trial,) = load_dataset(tmp_path / "tank").trials
    place, heading = trial.sensors
    np.testing.assert_allclose(place.values, 0.01 * FILMED[:, 1:3], atol=1e-12)
    np.testing.assert_allclose(heading.values[:, 0], np.radians(FILMED[:, 3]), atol=1e-12)
    assert not trial.measured.any()
    assert not trial.commanded
    assert "its unit is assumed" in shown
    assert "joint angles as measured, which is assumed: --joints-are commanded, if the servos were told them" in shown
    assert "start     free (--from-rest: at rest)" in shown


def test_commanded_joints_their_hold_and_a_start_from_rest_are_said_and_written(
    laboratory: Run, tmp_path: Path
) -> None:
    _film(tmp_path, "film")
    line = "dataset new {} film.csv --fish trout.toml --joints-are commanded --from-rest --set axes=y_down"
    shown = laboratory(line.format("tank")).stdout
    written = (tmp_path / "tank" / "dataset.toml").read_text(encoding="utf-8")
    for text in (
        "moving smoothly in between (hold linear); --set hold=zero holds each until the next, half a sample, 5 ms, "
        "later",
        "start     at rest in the water, as given",
        "positive  y_down, heading clockwise from 0 along x",
    ):
        assert text in shown
        assert text in written
    assert "assumed: --joints-are" not in shown
    (trial,) = load_dataset(tmp_path / "tank").trials
    assert (trial.commanded, trial.hold, trial.from_rest) == (True, "linear", True)
    np.testing.assert_allclose(trial.sensors[1].values[:, 0], -np.radians(FILMED[:, 3]), atol=1e-12)
    shown = laboratory(line.format("second") + " --hold zero --set turn_to=port").stdout
    assert "held until the next (hold zero), half a sample, 5 ms, later than in a smooth motion (linear)" in shown
    (trial,) = load_dataset(tmp_path / "second").trials
    assert trial.hold == "zero"
    np.testing.assert_allclose(trial.sensors[1].values[:, 0], np.radians(FILMED[:, 3]), atol=1e-12)
    np.testing.assert_allclose(trial.sensors[0].values[:, 1], -0.01 * FILMED[:, 2], atol=1e-12)


def test_what_was_left_out_of_poses_is_said(laboratory: Run, tmp_path: Path) -> None:
    _film(tmp_path, "film")
    lines = (tmp_path / "film.csv").read_text(encoding="utf-8").splitlines()
    lines[20] = ",".join([lines[20].split(",")[0], "", "", *lines[20].split(",")[3:]])
    lines.insert(50, lines[49])
    (tmp_path / "film.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    shown = " ".join(laboratory("dataset new tank film.csv --fish trout.toml").stdout.split())
    assert (
        "film.csv: 299 of 301 samples kept; 1 repeated rows left out; position: 1 of 300 samples left out: a" in shown
    )


def _answered(answers: list[str], line: str, monkeypatch: pytest.MonkeyPatch) -> str:
    monkeypatch.setattr(console, "is_asking", lambda: True)
    result = CliRunner().invoke(application(), line.split(), input="\n".join(answers) + "\n")
    assert result.exit_code == 0, result.output
    return result.output


@pytest.mark.usefixtures("laboratory")
def test_in_a_terminal_without_files_everything_is_asked_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "odd.csv").unlink()
    clear = ["", *[""] * 4]  # velocities, and four columns by their headers
    shown = _answered(
        ["", "trout.toml", *clear, "", *[""] * 4, "slow"], "dataset new tank", monkeypatch
    )  # files; fish; columns; joints; units; held out
    assert "CSV files, one a run [*.csv]" in shown
    _same(tmp_path / "tank")
    assert [trial.name for trial in load_dataset(tmp_path / "tank").split()[1]] == ["slow"]


@pytest.mark.usefixtures("laboratory")
def test_in_a_terminal_with_files_only_what_is_not_clear_is_asked_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    answers = ["velocities", "b", "c", "d", "e,f", "mm", "deg"]
    _answered(answers, "dataset new tank odd.csv --fish trout.toml --time a --time-unit ms", monkeypatch)
    _same(tmp_path / "tank")
    shown = _answered([], "dataset new second slow.csv --fish trout.toml", monkeypatch)
    assert "[mm]" not in shown


def _written(path: Path, separator: str, above: str = "", encoding: str = "utf-8") -> None:
    """Write the recording with other separators, decimal commas, lines above the header, and a degree sign in it."""
    rows = [separator.join(f"{value:.17g}".replace(".", ",") for value in row) for row in FOREIGN]
    header = separator.join(("t [ms]", "u (mm/s)", "v (mm/s)", "Yaw rate (°/s)", "servo1_deg", "servo2_deg"))
    path.write_bytes((above + "\n".join([header, *rows])).encode(encoding))


def test_how_files_are_written_is_recognised_and_said(laboratory: Run, tmp_path: Path) -> None:
    _written(tmp_path / "lab.csv", ";", "Recording 3;\n\n", "latin-1")
    shown = laboratory("dataset new tank lab.csv --fish trout.toml").stdout
    _same(tmp_path / "tank")
    for text in (
        "text read as cp1252",
        "columns separated by semicolons",
        "2 lines above the header",
        "decimal commas",
    ):
        assert f"  files     {text}" in shown
        assert f"files     {text}" in (tmp_path / "tank" / "dataset.toml").read_text(encoding="utf-8")
    assert "files  " not in laboratory("dataset new plain slow.csv --fish trout.toml").stdout


def test_how_files_are_written_is_given_by_options(
    laboratory: Run, refuse: Callable[[str], str], tmp_path: Path
) -> None:
    above = "\t".join("123456") + "\n"
    _written(tmp_path / "lab.csv", "\t", above, "utf-16-le")
    line = "dataset new tank lab.csv --fish trout.toml"
    assert "give --encoding" in refuse(line)
    assert "give --skip" in refuse(f"{line} --encoding utf-16-le")
    assert "row 36 (line 38), column 't [ms]': '350,00000000000006' is not a number such as -0.25" in refuse(
        f"{line} --encoding utf-16-le --skip 1 --decimal ."
    )
    assert "separator: expected ',', ';', 'tab' or '|'" in refuse(f"{line} --encoding utf-16-le --separator space")
    laboratory(f"{line} --encoding utf-16-le --skip 1 --decimal , --separator tab")
    _same(tmp_path / "tank")


def test_dates_are_said_and_their_unit_is_not_assumed(laboratory: Run, tmp_path: Path) -> None:
    dates = np.datetime64("2024-05-01T12:00:00", "us") + np.round(1e6 * TIME).astype("timedelta64[us]")
    rows = [f"{date}," + ",".join(map(str, row[1:])) for date, row in zip(dates, FOREIGN, strict=True)]
    header = "time,u (mm/s),v (mm/s),Yaw rate (deg/s),servo1_deg,servo2_deg"
    (tmp_path / "dates.csv").write_text("\n".join([header, *rows]), encoding="utf-8")
    shown = laboratory("dataset new tank dates.csv --fish trout.toml").stdout
    _same(tmp_path / "tank")
    assert "files     times are dates: they count from the first row, 2024-05-01T12:00:00.000 UTC" in shown
    assert "its unit is assumed" not in shown


REFUSED = {
    "unclear": ("odd.csv --fish trout.toml", "not given and not clear from the headers a, b, c, d, e, f:"),
    "unclear, of places": ("odd.csv --fish trout.toml", "for places of a camera --x, --y and --heading"),
    "no fish": ("slow.csv", "Fish: a TOML, or a shipped one (--fish)"),
    "no files": ("", "no files, expected one CSV file a run"),
    "absent": ("none.csv --fish trout.toml", "none.csv: no such file"),
    "column": ("slow.csv --fish trout.toml --surge w", "unknown column in slow.csv 'w'; known: "),
    "both kinds": ("slow.csv --fish trout.toml --surge a --x b", "--surge beside --x, expected velocities or places"),
    "unit": ("slow.csv --fish trout.toml --length-unit ft", "--length-unit: found 'ft', expected m or cm or mm"),
    "joints": ("slow.csv --fish pike", "joints.columns: 2 columns, expected 4"),
    "frequencies of files with commas": (
        "slow.csv fast.csv --fish trout.toml --frequency 1.2,2 --amplitude 1,1 --phase 0,0",
        "expected one number; repeat the option for every file: --frequency 1.2 --frequency 2",
    ),
    "both drives": ("slow.csv --fish trout.toml --joints a,b --frequency 1", "--joints beside a drive"),
    "amplitudes": (
        "slow.csv --fish trout.toml --frequency 1 --amplitude 1 --phase 0",
        "amplitude: 1 numbers, expected 2, one for each joint",
    ),
    "twice": (
        "slow.csv --fish trout.toml --frequency 1 --frequency 2 --amplitude 1,1 --phase 0,0",
        "--frequency: given 2 times for 1 files, expected once, or once a file",
    ),
    "key": ("slow.csv --fish trout.toml --set sway=port_side=x", "'port_side=x'"),
    "joints are": ("film.csv --fish trout.toml --joints-are told", "joints.are: expected 'measured' or 'commanded'"),
    "hold": ("film.csv --fish trout.toml --hold zero", 'hold = "zero" of measured angles, expected it of commanded'),
    "joints of a drive": (
        "slow.csv --fish trout.toml --frequency 1 --amplitude 1,1 --phase 0,0 --joints-are commanded",
        "keys of [joints] (--set joints.KEY, --joints-are, --hold) beside a drive",
    ),
    "wave of joints": ("slow.csv --fish trout.toml --set wave.ramp=1", "keys of [wave] (--set wave.KEY) beside joint"),
    "a table as a value": (
        "film.csv --fish trout.toml --set axes=y_down --set joints=commanded",
        "--set: 'joints=commanded', but joints is a table, expected one of its keys: --joints-are commanded",
    ),
    "off the head": ("film.csv --fish trout.toml --set behind_nose=-0.1", "behind_nose: -0.1 m, expected a point of"),
    "no key": ("slow.csv --fish trout.toml --set sway_to", "--set: found 'sway_to', expected KEY=VALUE"),
    "held out": ("slow.csv fast.csv --fish trout.toml --held-out last", "unknown trial to hold out 'last'"),
    "two units": ("mixed.csv --fish trout.toml", "headers name the units m and mm of one kind, expected one"),
    "no header": ("bare.csv --fish trout.toml", "bare.csv: looks like a CSV file of 6 columns without a header line"),
}  # fmt: skip


@pytest.mark.parametrize(("options", "complaint"), REFUSED.values(), ids=REFUSED)
@pytest.mark.usefixtures("laboratory")
def test_what_is_wrong_or_lacking_is_said_and_nothing_written(
    refuse: Callable[[str], str], tmp_path: Path, options: str, complaint: str
) -> None:
    _film(tmp_path, "film")
    _table(tmp_path / "mixed.csv", "t_ms,u_mm_s,v_m_s,r_dps,j1_deg,j2_deg", FOREIGN)
    _table(tmp_path / "bare.csv", ",".join("123456"), FOREIGN)
    assert complaint in refuse(f"dataset new tank {options}")


@pytest.mark.usefixtures("laboratory")
def test_a_folder_with_anything_in_it_is_not_touched(refuse: Callable[[str], str], run: Run, tmp_path: Path) -> None:
    line = "dataset new tank slow.csv --fish trout.toml"
    run(line)
    assert "tank: is not empty, expected a new folder; choose another" in refuse(line)
    shutil.rmtree(tmp_path / "tank")
    run(line)
