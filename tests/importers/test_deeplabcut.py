"""Tracks in the layout of DeepLabCut."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from filmed_swimming import Swim

from mjfish.data.importers import import_files
from mjfish.data.importers.mapping import LAYOUTS
from mjfish.errors import MjfishError

PARTS = [f"part{k}" for k in range(9)]


def _columns(path: Path) -> np.ndarray:
    """Return a film's columns X0, Y0, ..., X8, Y8 in pixels, and write it as the importer of fishsim reads it."""
    return np.loadtxt(Swim(seconds=4.0).write(path), delimiter=",")


def _write(path: Path, pixels: np.ndarray, likelihood: np.ndarray) -> Path:
    names = [part for part in PARTS for _ in range(3)]
    rows = [["scorer", *["net"] * 27], ["bodyparts", *names], ["coords", *["x", "y", "likelihood"] * 9]]
    for frame, (row, sure) in enumerate(zip(pixels, likelihood, strict=True)):
        cells = [f"{value!r}" for k in range(9) for value in (*row[2 * k : 2 * k + 2].tolist(), float(sure[k]))]
        rows.append([str(frame), *cells])
    path.write_text("\n".join(",".join(row) for row in rows) + "\n")
    return path


@pytest.fixture
def mapping(tmp_path: Path) -> Path:
    """The mapping of fishsim, its markers under the names of the body parts."""
    text = (LAYOUTS / "fishsim.toml").read_text()
    for k, part in enumerate(PARTS):
        text = text.replace(f'name = "{k}"', f'name = "{part}"')
        text = text.replace(f'"{k}",', f'"{part}",').replace(f'"{k}"]', f'"{part}"]')
    path = tmp_path / "map.toml"
    path.write_text(text)
    return path


def test_sure_tracks_are_those_of_the_same_film(tmp_path: Path, mapping: Path) -> None:
    pixels = _columns(tmp_path / "markers_run.csv")
    file = _write(tmp_path / "run.csv", pixels, np.ones((len(pixels), 9)))
    dataset, report = import_files("deeplabcut", [file], mapping=mapping)
    expected, _ = import_files("fishsim", [tmp_path / "markers_run.csv"])
    assert report.importer == "deeplabcut"
    np.testing.assert_array_equal(dataset.trials[0].velocity, expected.trials[0].velocity)


def test_a_point_that_the_tracker_is_not_sure_of_is_lost(tmp_path: Path, mapping: Path) -> None:
    """Far off, but with a likelihood below that of the mapping: the velocities hardly change."""
    pixels = _columns(tmp_path / "markers_run.csv")
    sure, spoiled = np.ones((len(pixels), 9)), pixels.copy()
    sure[100:103, 5] = 0.3
    spoiled[100:103, 10:12] += 400.0
    dataset, _ = import_files("deeplabcut", [_write(tmp_path / "run.csv", spoiled, sure)], mapping=mapping)
    expected, _ = import_files("fishsim", [tmp_path / "markers_run.csv"])
    difference = dataset.trials[0].velocity - expected.trials[0].velocity
    assert np.abs(difference).max() < 0.3 * np.ptp(expected.trials[0].velocity, axis=0).min()


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("X0,Y0\n1,2\n", "no CSV of DeepLabCut, expected lines that begin with scorer, bodyparts, coords"),
        ("scorer,a\nindividuals,b\nbodyparts,c\ncoords,x\n", "has tracks of several animals; export those of one"),
        ("scorer,n,n,n\nbodyparts,a,a,a\ncoords,x,y,likelihood\n0,1,2,1\n", "body part in .*part0"),
    ],
)
def test_other_files_are_refused(tmp_path: Path, mapping: Path, text: str, complaint: str) -> None:
    (tmp_path / "run.csv").write_text(text)
    with pytest.raises(MjfishError, match=complaint):
        import_files("deeplabcut", [tmp_path / "run.csv"], mapping=mapping)


def test_cells_that_are_no_numbers_are_named(tmp_path: Path, mapping: Path) -> None:
    pixels = _columns(tmp_path / "markers_run.csv")
    file = _write(tmp_path / "run.csv", pixels, np.ones((len(pixels), 9)))
    lines = file.read_text().splitlines()
    file.write_text("\n".join([*lines[:12], lines[12] + ",1"]))
    with pytest.raises(MjfishError, match=r"row 10 \(line 13\): 29 cells, expected 28"):
        import_files("deeplabcut", [file], mapping=mapping)
    lines[9] = lines[9].replace(lines[9].split(",")[4], "lost", 1)
    file.write_text("\n".join(lines))
    with pytest.raises(MjfishError, match=r"row 7 \(line 10\), column 5 \(part1 x\): 'lost' is not a number"):
        import_files("deeplabcut", [file], mapping=mapping)
