"""Pose and velocity tables: units and axes by a mapping file; gaps; an importer in a file of one's own."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mjfish import data as trial
from mjfish.arrays import FloatArray
from mjfish.data import Dataset, importers
from mjfish.errors import InputError, MjfishError

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


@pytest.mark.parametrize("axes", ["y_up", "y_down"])
def test_poses_become_velocities_of_the_nose(tmp_path: Path, axes: str) -> None:
    """A point behind the nose in centimetres, degrees with another zero that run over 180, y up or down."""
    time, pose, true = _swim()
    mirror = 1.0 if axes == "y_up" else -1.0
    rng = np.random.default_rng(3)
    x = pose[:, 0] - 0.15 * np.cos(pose[:, 2])
    y = pose[:, 1] - 0.15 * np.sin(pose[:, 2])
    noisy = np.column_stack([x, y, pose[:, 2]]) + rng.normal(0.0, [5e-4, 5e-4, 4e-3], pose.shape)
    degrees = np.degrees(mirror * noisy[:, 2]) + 170.0
    wrapped = (degrees + 180.0) % 360.0 - 180.0
    file = _table(
        tmp_path / "run.csv",
        "t,px,py,heading",
        np.column_stack([time, 100 * noisy[:, 0], mirror * 100 * noisy[:, 1], wrapped]),
    )
    mapping = _map(
        tmp_path / "map.toml",
        f'time = "t"\nx = "px"\ny = "py"\nyaw = "heading"\nlength_unit = "cm"\nangle_unit = "deg"\naxes = "{axes}"\n'
        f"yaw_zero = 170.0\nbehind_nose = 0.15\n" + WAVE,
        "poses",
    )
    dataset, report = _import("poses", file, mapping)
    (run,) = dataset.trials
    assert dataset.noise is not None
    off = (run.velocity - np.column_stack([np.interp(run.time, time, column) for column in true.T])) / dataset.noise
    rms = np.sqrt(np.square(off).mean(axis=0))
    assert np.all((rms > 0.5) & (rms < 1.5)), rms
    assert report.beat == pytest.approx(BEAT, rel=0.01)
    assert run.wave is not None  # and the clock stays that of the file, which the wave goes by
    assert run.time[0] == pytest.approx(next((cut.end for cut in report.cuts if cut.start == 0.0), 0.0))


def _gap(tmp_path: Path, pose: FloatArray, time: FloatArray) -> tuple[Dataset, importers.FileReport]:
    rng = np.random.default_rng(5)
    noisy = pose + rng.normal(0.0, [5e-4, 5e-4, 4e-3], pose.shape)
    noisy[180:208] = np.nan
    file = _table(tmp_path / "run.csv", "time,x,y,yaw", np.column_stack([time, noisy]))
    return _import("poses", file, _map(tmp_path / "map.toml", WAVE, "poses"))


def test_a_gap_in_periodic_motion_is_bridged_and_said(tmp_path: Path) -> None:
    """More than half a beat: what the beat repeats is known there, and the velocities prove it."""
    time, pose, true = _swim()
    dataset, report = _gap(tmp_path, pose, time)
    (run,) = dataset.trials
    assert any("28 frames without a pose bridged" in note for note in report.notes), (report.notes, report.cuts)
    inside = (run.time > 3.6) & (run.time < 4.16)
    off = run.velocity[inside] - np.column_stack([np.interp(run.time[inside], time, column) for column in true.T])
    assert dataset.noise is not None
    assert np.all(np.abs(off) < 4.0 * dataset.noise)


def test_a_gap_in_motion_that_does_not_repeat_is_cut(tmp_path: Path) -> None:
    """The same gap where the fish turns now here, now there: two trials, and the cut is reported."""
    time, _, _ = _swim()
    rng = np.random.default_rng(1)
    steps = np.cumsum(rng.normal(0.0, 1.0, (len(time), 3)), axis=0)
    kernel = np.hanning(25) / np.hanning(25).sum()
    wandering = np.column_stack([np.convolve(column, kernel, mode="same") for column in steps.T]) * [0.01, 0.01, 0.1]
    dataset, report = _gap(tmp_path, wandering, time)
    assert [run.name for run in dataset.trials] == ["run-a", "run-b"]
    assert report.beat is None
    cut = next(cut for cut in report.cuts if cut.start > 1.0 and cut.end < 7.0)
    assert (cut.start, cut.end) == pytest.approx((180 / RATE, 208 / RATE), abs=0.3)
    assert "pose lost" in cut.reason


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
    "fails": ("raise ValueError('no')\n", "fails when it is read: ValueError: no"),
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


def test_a_held_out_file_changes_no_stated_noise(tmp_path: Path) -> None:
    """The second file is ten times as noisy. Catches a noise averaged over files that the fit must not know."""
    time, pose, _ = _swim()
    mapping = _map(tmp_path / "map.toml", WAVE, "poses")
    rng = np.random.default_rng(3)
    files = []
    for name, sigma in (("good", 0.001), ("bad", 0.01)):
        noisy = pose + rng.normal(size=pose.shape) * sigma
        files.append(_table(tmp_path / f"{name}.csv", "time,x,y,yaw", np.column_stack([time, noisy])))
    alone, _ = importers.import_files("poses", files[:1], mapping=mapping)
    beside, _ = importers.import_files("poses", files, held_out=["bad"], mapping=mapping)
    both, _ = importers.import_files("poses", [files[0], files[1]], held_out=["good"], mapping=mapping)
    assert alone.noise is not None
    assert beside.noise is not None
    assert both.noise is not None
    np.testing.assert_array_equal(beside.noise, alone.noise)
    assert np.all(both.noise > 3.0 * alone.noise)


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
