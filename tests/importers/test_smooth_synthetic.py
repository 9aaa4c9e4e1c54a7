"""A simulated fish, filmed: its velocities come back without bias and with the errors that are stated."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from filmed_swimming import Swim

from mjfish.data import importers
from mjfish.data.importers import FileReport, markers
from mjfish.data.importers.mapping import LAYOUTS, MarkersMap, read_mapping
from mjfish.data.importers.trials import nose_velocities
from mjfish.errors import InputError
from mjfish.numerics.arrays import FloatArray

#: Seen from above, where the heights of the markers do not show; and as the real camera saw its fish.
ABOVE = Swim()
TILTED = Swim(tilt=0.3, heights=True)
SEEDS = range(2)
#: Left out at either end: there sigma grows, and few samples would rule the ratio.
_EDGE = 12


@dataclass(frozen=True, eq=False)
class Errors:
    """Errors over stated sigma of the velocities (n, 3), and peak to peak found over true (3,)."""

    scaled: FloatArray
    swing: FloatArray


def _errors(swim: Swim, folder: Path) -> Errors:
    table, fish, place = read_mapping(LAYOUTS / "fishsim.toml", MarkersMap, "fishsim")
    where = markers.placed(table, fish, place)
    path = swim.write(folder / "markers_run.csv")
    points = markers.metres(path, markers.read_points(path, table), table, where)[0]
    velocity, sigma, _ = nose_velocities(markers.fit_track(points, where, table.rate, path).fit)
    inner = slice(_EDGE, -_EDGE)
    true = swim.truth[1][inner]
    return Errors((velocity[inner] - true) / sigma[inner], np.ptp(velocity[inner], axis=0) / np.ptp(true, axis=0))


def _began(file: FileReport) -> float:
    """Return when the first trial begins in the file [s]."""
    return next((cut.end for cut in file.cuts if cut.start == 0.0), 0.0)


def _at(time: FloatArray, values: FloatArray) -> FloatArray:
    """Return values (300, k) at frames, at other times."""
    frames = np.arange(len(values)) / 60.0
    return np.column_stack([np.interp(time, frames, column) for column in values.T])


@pytest.mark.parametrize("swim", [ABOVE, pytest.param(TILTED, marks=pytest.mark.slow)], ids=["above", "tilted"])
def test_velocities_have_no_bias_and_the_stated_errors(tmp_path: Path, swim: Swim) -> None:
    """Over two draws. A sigma that is stated half as large doubles the ratio; a smoother that cuts peaks shows below.

    The tilted camera has the lower tail shifted by 40 mm and the scale change over the image: neither may turn up in
    the velocities.
    """
    drawn = [_errors(replace(swim, seed=seed), tmp_path) for seed in SEEDS]
    scaled = np.concatenate([one.scaled for one in drawn])
    ratio = np.sqrt(np.square(scaled).mean(axis=0))
    assert np.all((ratio > 0.8) & (ratio < 1.2)), ratio
    assert np.all(np.abs(scaled.mean(axis=0)) < 0.2), scaled.mean(axis=0)
    np.testing.assert_allclose(np.mean([one.swing for one in drawn], axis=0), 1.0, atol=0.02)


def test_tracking_that_wanders_is_stated_as_worse(tmp_path: Path) -> None:
    """Noise with a memory of five frames at the same variance. Taken for white, the ratio would be 1.8.

    The stated errors go by the noise at low frequencies and are up to a quarter too large at the third harmonic.
    """
    scaled = np.concatenate([_errors(replace(ABOVE, wander=0.8, seed=seed), tmp_path).scaled for seed in SEEDS])
    ratio = np.sqrt(np.square(scaled).mean(axis=0))
    assert np.all((ratio > 0.6) & (ratio < 1.2)), ratio


def test_roll_is_read_off_what_the_tail_does_under_the_head(tmp_path: Path) -> None:
    """Head markers 60 mm over those of the plates, which the mapping takes for 100 mm: six tenths of the roll.

    With the wrong sign the sway of the head would be put right twice over instead of once.
    """
    swim = replace(ABOVE, roll=0.15)
    dataset, report = importers.import_files("fishsim", [swim.write(tmp_path / "markers_run.csv")])
    (run,) = dataset.trials
    assert run.roll is not None
    true = np.interp(run.time + _began(report.files[0]), swim.truth[0], swim.rolled())
    seen = float(run.roll @ true / (true @ true))
    assert seen == pytest.approx(0.6, abs=0.12)
    assert np.std(run.roll - 0.6 * true) < 0.25 * np.std(0.6 * true)
    sway = _at(run.time + _began(report.files[0]), swim.truth[1])[:, 1]
    rate = np.gradient(true, run.time)
    assert np.std(run.velocity[:, 1] - sway + 0.1 * rate) < 0.25 * np.std(0.1 * rate)


def test_lost_and_exchanged_markers_are_noticed_and_hardly_matter(tmp_path: Path) -> None:
    """Two plates exchanged, one jumping, one stuck on its neighbour, at four times."""

    def spoil(pixel: FloatArray) -> None:
        pixel[50:62, [4, 5]] = pixel[50:62, [5, 4]]
        pixel[100:104, 6] += [40.0, -25.0]
        pixel[150:156, 3] = pixel[150:156, 4] + 1.0
        pixel[200, 0] += 80.0

    swim = replace(ABOVE, seed=4)
    dataset, report = importers.import_files("fishsim", [swim.write(tmp_path / "markers_run.csv", spoil)])
    spoiled, (file,) = dataset.trials[0], report.files
    assert dataset.noise is not None
    assert any("exchanged in 12 frames" in note for note in file.notes), file.notes
    assert any("bridged" in note for note in file.notes), file.notes
    assert len(dataset.trials) == 1
    assert file.usable == pytest.approx(300 - 10, abs=3)  # exchanged ones are put back
    off = (spoiled.velocity - _at(spoiled.time + _began(file), swim.truth[1]))[3:-3]
    # One draw of errors that are alike for long: 1.5 sigma is common, what the lost frames would cost is ten.
    assert np.all(np.sqrt(np.square(off).mean(axis=0)) < 1.7 * dataset.noise), off


def test_joint_angles_are_recovered_within_what_is_stated(tmp_path: Path) -> None:
    """A marker to the side of its plate costs a constant error, the free wobble of the tail one that beats."""
    swim = replace(TILTED, seed=2)
    dataset, report = importers.import_files("fishsim", [swim.write(tmp_path / "markers_run.csv")])
    (trial,) = dataset.trials
    assert trial.joint_angle is not None
    assert report.files[0].joint_noise is not None
    error = trial.joint_angle - _at(trial.time + _began(report.files[0]), swim.truth[2])
    rms = float(np.sqrt(np.square(error).mean()))
    assert 0.3 < rms / report.files[0].joint_noise < 1.2
    assert np.abs(error - error.mean(axis=0)).max() < 0.1


def test_a_marker_that_is_stuck_half_of_the_time_is_left_out_and_the_run_held_out(tmp_path: Path) -> None:
    swim = replace(ABOVE, seconds=3.0)
    stuck = np.arange(180) / 60 * 0.9 % 1.0 < 0.5

    def spoil(pixel: FloatArray) -> None:
        pixel[stuck, 6] += 0.6 * (pixel[stuck, 5] - pixel[stuck, 6]) + [3.0, 6.0]

    files = [swim.write(tmp_path / "markers_bad.csv", spoil), swim.write(tmp_path / "markers_good.csv")]
    dataset, report = importers.import_files("fishsim", files)
    assert any("marker 6 lost" in note and "not used" in note for note in report.files[0].notes), report.files[0].notes
    assert [trial.role for trial in dataset.trials] == ["held_out", "fit"]
    bad, good = dataset.trials
    count = min(len(bad.time), len(good.time))
    np.testing.assert_allclose(bad.velocity[:count], good.velocity[:count], atol=0.05)


def test_two_plates_lost_are_refused(tmp_path: Path) -> None:
    def spoil(pixel: FloatArray) -> None:
        pixel[20:, 4] = pixel[20:, 5] + [1.0, 2.0]
        pixel[30:, 6] = pixel[30:, 7] + [2.0, 0.0]

    path = replace(ABOVE, seconds=3.0).write(tmp_path / "markers_run.csv", spoil)
    with pytest.raises(InputError) as caught:
        importers.import_files("fishsim", [path])
    for part in (str(path), "no joint angles to be had", "markers 4, 6", "leaves 4", "expected 5", "track"):
        assert part in str(caught.value), (part, str(caught.value))


@pytest.mark.parametrize("heading", [pytest.param(0.4, marks=pytest.mark.slow), 1.9])
def test_swimming_forward_is_positive_surge_and_turning_counter_clockwise_positive_yaw(
    tmp_path: Path, heading: float
) -> None:
    """A slip in the image's sign of y turns the yaw rate and sway around, one in the head's direction the surge."""
    swim = replace(ABOVE, heading=heading, noise=0.05, seconds=4.0)
    dataset, report = importers.import_files("fishsim", [swim.write(tmp_path / "markers_run.csv")])
    (trial,) = dataset.trials
    true = swim.truth[1]
    time = trial.time + _began(report.files[0])
    assert trial.pose is not None
    off = np.abs(trial.velocity - _at(time, true))[2:-2] / np.ptp(true, axis=0)
    assert off.max() < 0.04
    pose = _at(time, swim.pose())
    np.testing.assert_allclose(trial.pose[0, :2], 0.0, atol=1e-12)
    np.testing.assert_allclose(trial.pose[:, 2], pose[:, 2], atol=0.01)
    np.testing.assert_allclose(trial.pose[-1, :2], pose[-1, :2] - pose[0, :2], atol=3e-3)


def test_a_long_film_is_smoothed_in_pieces(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each piece swims as the film does there; one that cannot be used is told, and all go where their run goes."""
    monkeypatch.setattr(markers, "_LONGEST_SECONDS", 3.0)

    def spoil(pixel: FloatArray) -> None:
        pixel[337:, [4, 6]] = pixel[337:, [5, 7]] + 1.0

    swim = replace(ABOVE, seconds=8.25)
    files = [
        swim.write(tmp_path / "markers_long.csv", spoil),
        replace(ABOVE, seconds=5.0).write(tmp_path / "markers_short.csv"),
    ]
    dataset, report = importers.import_files("fishsim", files, held_out=["long"])
    assert [(trial.name, trial.role) for trial in dataset.trials] == [
        ("long-a", "held_out"), ("long-b", "held_out"), ("short-a", "fit"), ("short-b", "fit"),
    ]  # fmt: skip
    assert [file.path for file in report.files] == [files[0], files[0], files[1], files[1]]
    (lost,) = (cut for cut in report.files[0].cuts if "no joint angles to be had" in cut.reason)
    assert (lost.start, lost.end) == (pytest.approx(330 / 60), pytest.approx(495 / 60))
    second, file = dataset.trials[1], report.files[1]
    assert file.cuts
    assert all(165 / 60 - 1e-9 < cut.start < cut.end < 330 / 60 + 1e-9 for cut in file.cuts)
    began = next((cut.end for cut in file.cuts if cut.start == pytest.approx(165 / 60)), 165 / 60)
    time, true, _ = swim.truth
    at = np.column_stack([np.interp(second.time + began, time, column) for column in true.T])
    off = np.sqrt(np.square((second.velocity - at)[3:-3]).mean(axis=0))
    assert file.noise is not None
    assert np.all(off < 2.0 * np.array(file.noise)), off
