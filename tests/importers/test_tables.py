"""Pose and velocity tables: units and axes by a mapping file; gaps; an importer in a file of one's own.

Poses become sensors, with the samples as they are.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from mjfish import data as trial
from mjfish.data import Dataset, Trial, importers
from mjfish.errors import InputError, MjfishError
from mjfish.numerics.arrays import FloatArray

RATE = 50.0
BEAT = 0.9
WAVE = "[wave]\nfrequency = 0.9\namplitude = [14.0, 12.0, 9.0, 6.0, 10.0]\nphase = [0, -23.0, -46.0, -69.0, -92.0]\n"
WAVE += 'unit = "deg"\nfree = true\n'


def _swim(seconds: float = 8.0) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return times, poses and velocities of a nose that swims and swings; integrated on a fine grid."""
    fine = np.linspace(0.0, seconds, int(seconds * 2000) + 1)
    omega = 2 * np.pi * BEAT
    yaw = 0.3 + 0.05 * fine - 0.12 * np.sin(omega * fine)
    turn = 0.05 - 0.12 * omega * np.cos(omega * fine)
    surge = 0.1 + 0.02 * np.cos(2 * omega * fine)
    sway = 0.09 * np.cos(omega * fine + 0.5)
    world = np.column_stack([np.cos(yaw) * surge - np.sin(yaw) * sway, np.sin(yaw) * surge + np.cos(yaw) * sway])
    step = fine[1]
    path = np.concatenate([np.zeros((1, 2)), np.cumsum(0.5 * step * (world[1:] + world[:-1]), axis=0)])
    take = slice(None, None, int(2000 / RATE))
    return fine[take], np.column_stack([path, yaw])[take], np.column_stack([surge, sway, turn])[take]


def _table(path: Path, header: str, values: FloatArray) -> Path:
    rows = [",".join("" if np.isnan(cell) else repr(float(cell)) for cell in row) for row in values]
    path.write_text("\n".join([header, *rows]) + "\n")
    return path


def _map(path: Path, text: str, kind: str) -> Path:
    path.write_text(f'schema = 1\nkind = "{kind}"\nfish = "eth_tendon"\n{text}')
    return path


def _import(kind: str, file: Path, mapping: Path) -> tuple[Dataset, importers.FileReport]:
    dataset, report = importers.import_files(kind, [file], mapping=mapping)
    return dataset, report.files[0]


def test_velocities_in_other_units_and_axes_come_back_in_ours(tmp_path: Path) -> None:
    """mm/s, degrees, starboard positive, clockwise positive, a point 0.2 m behind the nose: every sign once."""
    time, _, true = _swim()
    behind = 0.2
    there = np.column_stack(
        [time * 1e3, true[:, 0] * 1e3, -(true[:, 1] - behind * true[:, 2]) * 1e3, -true[:, 2] * 180 / np.pi]
    )
    file = _table(tmp_path / "log_a.csv", "t,u,v,r", there)
    mapping = _map(
        tmp_path / "map.toml",
        'prefix = "log_"\ntime = "t"\nsurge = "u"\nsway = "v"\nyaw_rate = "r"\ntime_unit = "ms"\nlength_unit = "mm"\n'
        'angle_unit = "deg"\nsway_to = "starboard"\nturn_to = "starboard"\nbehind_nose = 0.2\n'
        "noise = [0.01, 0.01, 0.05]\n" + WAVE,
        "velocities",
    )
    dataset, report = _import("velocities", file, mapping)
    (run,) = dataset.trials
    np.testing.assert_allclose(run.velocity, true, atol=1e-12)
    np.testing.assert_allclose(run.time, time, atol=1e-12)
    assert run.wave is not None
    assert run.wave.free
    assert run.wave.amplitude[0] == pytest.approx(np.radians(14.0))
    assert (run.name, report.beat) == ("a", None)
    trial.save(dataset, tmp_path / "out")
    assert trial.load_dataset(tmp_path / "out").trials[0].wave == run.wave


JOINTS = '[joints]\ncolumns = ["j1", "j2", "j3", "j4", "j5"]\n'
POSE = "time,x,y,yaw,j1,j2,j3,j4,j5"


def _joints(time: FloatArray) -> FloatArray:
    return 0.3 * np.sin(2.0 * np.pi * BEAT * time[:, None] - np.arange(5.0))


def _filmed(
    tmp_path: Path, change: Callable[[FloatArray], FloatArray] = np.copy, keys: str = "", joints: str = JOINTS
) -> tuple[Trial, ...]:
    """Import a run of poses and joint angles (n, 9) after a change of its rows, and read it back from its files."""
    time, pose, _ = _swim()
    rows = change(np.column_stack([time, pose, _joints(time)]))
    file = _table(tmp_path / "run.csv", POSE, rows)
    dataset, _ = _import("poses", file, _map(tmp_path / "map.toml", keys + joints, "poses"))
    trial.save(dataset, tmp_path / "saved")
    return trial.load_dataset(tmp_path / "saved").trials


@pytest.mark.parametrize(("axes", "turn"), [("y_up", ""), ("y_down", ""), ("y_up", "starboard"), ("y_down", "port")])
def test_poses_become_sensors_sample_by_sample(tmp_path: Path, axes: str, turn: str) -> None:
    """Centimetres, degrees with another zero that run over 180, y and heading either way: every sign once."""
    time, pose, _ = _swim()
    up = 1.0 if axes == "y_up" else -1.0
    grows = {"": up, "port": 1.0, "starboard": -1.0}[turn]
    wrapped = (np.degrees(grows * pose[:, 2]) + 170.0 + 180.0) % 360.0 - 180.0
    table = np.column_stack([time + 3.0, 100.0 * pose[:, 0], up * 100.0 * pose[:, 1], wrapped])
    keys = (
        f'time = "t"\nx = "px"\ny = "py"\nyaw = "heading"\nlength_unit = "cm"\nangle_unit = "deg"\naxes = "{axes}"\n'
        "yaw_zero = 170.0\nbehind_nose = 0.15\n" + (f'turn_to = "{turn}"\n' if turn else "")
    )
    file = _table(tmp_path / "run.csv", "t,px,py,heading", table)
    dataset, report = _import("poses", file, _map(tmp_path / "map.toml", keys + WAVE, "poses"))
    (run,) = dataset.trials
    assert not run.measured.any()
    assert (dataset.noise, dataset.known) == (None, {})
    place, heading = run.sensors
    assert (place.name, heading.name, place.link, place.station) == ("position", "heading", 0, 0.15)
    assert place.placed
    np.testing.assert_allclose(place.values, pose[:, :2], atol=1e-12)
    np.testing.assert_allclose(heading.values[:, 0] % (2.0 * np.pi), pose[:, 2] % (2.0 * np.pi), atol=1e-12)
    assert np.abs(np.diff(heading.values[:, 0])).max() < 0.1
    for sensor in run.sensors:
        np.testing.assert_allclose(sensor.time, time + 3.0)  # the clock stays that of the file, which the wave goes by
    assert (report.frames, report.usable, report.kept) == (len(time),) * 3
    assert report.beat == BEAT
    trial.save(dataset, tmp_path / "out")
    (again,) = trial.load_dataset(tmp_path / "out").trials
    assert again.wave == run.wave
    for old, new in zip(run.sensors, again.sensors, strict=True):
        np.testing.assert_array_equal(old.values, new.values)


def test_a_point_that_nobody_places_is_somewhere_on_the_head(tmp_path: Path) -> None:
    time, pose, _ = _swim()
    file = _table(tmp_path / "run.csv", "time,x,y,yaw", np.column_stack([time, pose]))
    dataset, _ = _import("poses", file, _map(tmp_path / "map.toml", WAVE, "poses"))
    assert [sensor.placed for sensor in dataset.trials[0].sensors] == [False, False]
    for place in (-0.01, 0.9):
        mapping = _map(tmp_path / "map.toml", f"behind_nose = {place}\n" + WAVE, "poses")
        with pytest.raises(InputError, match=r"map.toml: behind_nose: .* expected a point of the head, 0 to .*fitted"):
            _import("poses", file, mapping)


def test_missing_cells_are_absent_samples_and_said(tmp_path: Path) -> None:
    """Of the place ten, of the heading thirty. Catches a filled or a smoothed gap."""
    time, pose, _ = _swim()
    holed = np.column_stack([time, pose])
    holed[100:110, 1] = np.nan
    holed[200:230, 3] = np.nan
    file = _table(tmp_path / "run.csv", "time,x,y,yaw", holed)
    dataset, report = _import("poses", file, _map(tmp_path / "map.toml", WAVE, "poses"))
    place, heading = dataset.trials[0].sensors
    np.testing.assert_array_equal(place.time, np.delete(time, np.s_[100:110]))
    np.testing.assert_array_equal(place.values, np.delete(pose[:, :2], np.s_[100:110], axis=0))
    np.testing.assert_array_equal(heading.time, np.delete(time, np.s_[200:230]))
    assert (report.frames, report.usable, report.kept) == (len(time), len(time) - 40, len(time) - 10)
    assert f"heading: 30 of {len(time)} samples left out: a value is missing" in report.notes


def test_a_frame_that_is_there_twice_counts_once(tmp_path: Path) -> None:
    (run,) = _filmed(tmp_path, lambda rows: np.insert(rows, [50, 50, 90], rows[[50, 50, 90]], axis=0))
    time, pose, _ = _swim()
    np.testing.assert_allclose(run.time, time, atol=1e-12)
    np.testing.assert_array_equal(run.sensors[0].values, pose[:, :2])


def _repeated(rows: FloatArray) -> FloatArray:
    rows[40, 0] = rows[39, 0]
    return rows


def _backwards(rows: FloatArray) -> FloatArray:
    rows[40, 0] = 0.1
    return rows


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (_repeated, r"run.csv: row 41 \(line 42\), column 'time': 0.78 s repeats that of row 40, .* row is repeated"),
        (_backwards, r"row 41 \(line 42\), column 'time': 0.1 s is before the 0.78 s of row 40, .*; sort the rows"),
    ],
)  # fmt: skip
def test_times_that_repeat_or_run_backwards_are_refused(
    tmp_path: Path, change: Callable[[FloatArray], FloatArray], said: str
) -> None:
    with pytest.raises(InputError, match=said):
        _filmed(tmp_path, change)


def _without(*gaps: slice) -> Callable[[FloatArray], FloatArray]:
    def change(rows: FloatArray) -> FloatArray:
        for gap in gaps:
            rows[gap, 5] = np.nan
        return rows

    return change


def test_short_gaps_of_joint_angles_are_left_to_the_spline(tmp_path: Path) -> None:
    """A beat has 56 rows; 10 are missing. The places of the gap stay, and so does the gap, in files too."""
    (run,) = _filmed(tmp_path, _without(np.s_[150:160]))
    time, pose, _ = _swim()
    np.testing.assert_allclose(run.time, np.delete(time, np.s_[150:160]), atol=1e-12)
    assert run.joint_angle is not None
    np.testing.assert_array_equal(run.joint_angle, np.delete(_joints(time), np.s_[150:160], axis=0))
    np.testing.assert_array_equal(run.sensors[0].values, pose[:, :2])
    assert not run.measured.any()


def test_long_gaps_of_joint_angles_cut_the_run(tmp_path: Path) -> None:
    """Half a beat is missing, and the ends: parts begin at 0, on one clock with their sensors; one at rest."""
    change = _without(np.s_[180:208], np.s_[390:])
    first, second = _filmed(tmp_path, change, "from_rest = true\n", JOINTS + 'are = "commanded"\nhold = "zero"\n')
    time, pose, _ = _swim()
    assert (first.name, second.name) == ("run-a", "run-b")
    for run, rows in ((first, np.s_[:180]), (second, np.s_[208:390])):
        np.testing.assert_allclose(run.time, time[rows] - time[rows][0], atol=1e-12)
        assert run.joint_angle is not None
        np.testing.assert_array_equal(run.joint_angle, _joints(time)[rows])
        np.testing.assert_allclose(run.sensors[0].time, run.time, atol=1e-12)
        np.testing.assert_array_equal(run.sensors[0].values, pose[rows, :2])
        assert (run.commanded, run.hold) == (True, "zero")
    assert (first.from_rest, second.from_rest) == (True, False)


def test_what_was_cut_and_what_the_joints_are_is_reported(tmp_path: Path) -> None:
    time, pose, _ = _swim()
    rows = _without(np.s_[180:208])(np.column_stack([time, pose, _joints(time)]))
    file = _table(tmp_path / "run.csv", POSE, rows)
    mapping = _map(tmp_path / "map.toml", JOINTS + 'are = "commanded"\n', "poses")
    _, report = _import("poses", file, mapping)
    (cut,) = report.cuts
    assert (cut.start, cut.end) == pytest.approx((3.6, 4.16))
    assert cut.reason == "j2 lost"
    assert report.beat == pytest.approx(BEAT, rel=0.15)
    assert "a sample every 20 ms" in report.notes
    assert report.notes[-1] == (
        "joint angles as commanded, moving smoothly in between (hold linear); --set hold=zero holds each "
        "until the next, half a sample, 10 ms, later"
    )
    (row,) = importers.ImportReport("poses", (report,)).rows()
    assert row[6:12] == ("-",) * 6  # nothing is smoothed, no velocity is made


def test_a_run_whose_joints_are_hardly_known_is_refused(tmp_path: Path) -> None:
    with pytest.raises(
        InputError, match=r"longest stretch without a gap in the joint angles lasts 1\.\d* s, expected 2 beats"
    ):
        _filmed(tmp_path, _without(np.s_[60:120], np.s_[180:260], np.s_[310:380]))


def test_a_hold_is_of_commanded_angles(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r'joints: hold = "zero" of measured angles, .* add are = "commanded"'):
        _filmed(tmp_path, joints=JOINTS + 'hold = "zero"\n')


def test_a_ramp_begins_at_zero(tmp_path: Path) -> None:
    """What was filmed before is left out, and said."""
    time, pose, _ = _swim()
    file = _table(tmp_path / "run.csv", "time,x,y,yaw", np.column_stack([time - 1.0, pose]))
    mapping = _map(tmp_path / "map.toml", WAVE.replace("free = true", "ramp = 0.5"), "poses")
    dataset, report = _import("poses", file, mapping)
    (run,) = dataset.trials
    assert run.starts_at_rest
    assert (run.time[0], run.sensors[1].time[0]) == (0.0, 0.0)
    assert report.cuts[0].reason == "before the drive starts"


def test_an_importer_in_a_file_of_ones_own_works_the_same(tmp_path: Path) -> None:
    time, _, true = _swim()
    _table(tmp_path / "run.csv", "time,surge,sway,yaw_rate", np.column_stack([time, true]))
    own = tmp_path / "mine.py"
    own.write_text(
        "from mjfish.data.importers import import_files as by_name\n"
        "def import_files(files, held_out=(), mapping=None):\n"
        "    return by_name('velocities', files, held_out, mapping)\n"
    )
    mapping = _map(tmp_path / "map.toml", WAVE, "velocities")
    dataset, _ = importers.import_files(own, [tmp_path / "run.csv"], mapping=mapping)
    np.testing.assert_allclose(dataset.trials[0].velocity, true, atol=1e-12)


BROKEN = {
    "no function": ("x = 1\n", "defines no function 'import_files'"),
    "fails": ("raise ValueError('no')\n", "line 1: running the file failed: ValueError: no"),
}


@pytest.mark.parametrize("case", BROKEN)
def test_importers_that_are_none_are_refused(tmp_path: Path, case: str) -> None:
    text, message = BROKEN[case]
    (tmp_path / "mine.py").write_text(text)
    with pytest.raises(InputError, match=message):
        importers.import_files(tmp_path / "mine.py", [tmp_path / "run.csv"])
    with pytest.raises(InputError, match="no such file"):
        importers.import_files(tmp_path / "other.py", [tmp_path / "run.csv"])


REFUSED = {
    "no mapping": (None, "needs a mapping file"),
    "no drive": ("", r"expected one of \[joints\]"),
    "joints too few": ('[joints]\ncolumns = ["j1"]\n', "joints.columns: 1 columns, expected 5"),
    "another kind": (WAVE.replace("[wave]", "kind2 = 1\n[wave]"), "kind2: unknown key"),
    "a column that is not there": ('surge = "speed"\n' + WAVE, "unknown column in .*'speed'; known: .*surge"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_mappings_that_do_not_fit_are_refused(tmp_path: Path, case: str) -> None:
    time, _, true = _swim(2.0)
    header = "time,surge,sway,yaw_rate,j1"
    file = _table(tmp_path / "run.csv", header, np.column_stack([time, true, time]))
    text, message = REFUSED[case]
    mapping = None if text is None else _map(tmp_path / "map.toml", text, "velocities")
    with pytest.raises(MjfishError, match=message):
        importers.import_files("velocities", [file], mapping=mapping)


def test_any_layout_of_markers_is_a_mapping(tmp_path: Path) -> None:
    """A fish of two links of one's own: the mapping names markers, links, columns; a marker off the head is needed."""
    mapping = _map(
        tmp_path / "map.toml",
        "rate = 50.0\n"
        + "".join(
            f'[[markers]]\nname = "{name}"\nlink = "{link}"\nstation = {station}\n'
            for name, link, station in (("a", "head", 0.0), ("b", "head", 0.2), ("c", "fin", 0.5))
        ),
        "markers",
    )
    with pytest.raises(InputError, match="1 behind the head, expected 5 or more"):
        importers.import_files("markers", [tmp_path / "run.csv"], mapping=mapping)
    planes = "".join(f'[[planes]]\nmarkers = ["{m}"]\nshift = 0.1\nslip = 0.02\nbelow = 0.1\n' for m in "bc")
    plain = mapping.read_text()
    mapping.write_text(plain + planes)
    with pytest.raises(InputError, match=r"map.toml: below in 2 planes \(markers b; c\), expected one"):
        importers.import_files("markers", [tmp_path / "run.csv"], mapping=mapping)
    mapping.write_text(plain.replace('"fin"', '"tail_9"'))
    with pytest.raises(MjfishError, match=r"unknown link in .* marker c 'tail_9'; known: fin, head"):
        importers.import_files("markers", [tmp_path / "run.csv"], mapping=mapping)


def test_every_file_has_the_wave_that_its_name_says(tmp_path: Path) -> None:
    time, _, true = _swim()
    files = [
        _table(tmp_path / f"{name}.csv", "t,u,v,r", np.column_stack([time, true])) for name in ("slow_1", "fast_1")
    ]
    columns = 'time = "t"\nsurge = "u"\nsway = "v"\nyaw_rate = "r"\n'
    waves = WAVE.replace("[wave]", '[waves."slow_*"]') + WAVE.replace("[wave]", '[waves."fast_*"]').replace(
        "0.9", "1.8"
    )
    mapping = _map(tmp_path / "map.toml", columns + waves, "velocities")
    dataset, _ = importers.import_files("velocities", files, mapping=mapping)
    told = [run.wave.frequency for run in dataset.trials if run.wave is not None]
    assert told == [0.9, 1.8]
    other = _table(tmp_path / "odd.csv", "t,u,v,r", np.column_stack([time, true]))
    with pytest.raises(InputError, match=r'waves: no pattern fits odd\.csv.*add \[waves\."odd\.csv"\]'):
        importers.import_files("velocities", [other], mapping=mapping)
    both = _map(tmp_path / "both.toml", columns + WAVE + WAVE.replace("[wave]", '[waves."*"]'), "velocities")
    with pytest.raises(InputError, match="give one"):
        importers.import_files("velocities", files, mapping=both)
