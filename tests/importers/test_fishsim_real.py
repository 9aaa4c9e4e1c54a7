"""The measured files: what is published about them, and that the tail swims as a fish's does."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mjfish import importers, model, trial
from mjfish.errors import InputError
from mjfish.importers import ImportReport
from mjfish.importers.fishsim import markers, tracking
from mjfish.trial import Dataset

pytestmark = pytest.mark.real

#: Frames, beat [Hz], mean speed [m/s], usable frames, yaw rate from peak to peak [rad/s].
TABLE = {
    "f0_50": (541, 0.381, 0.022, 537, 0.90),
    "f1_00": (301, 0.747, 0.080, 299, 1.44),
    "f1_25": (301, 0.938, 0.103, 162, 1.68),
}


@pytest.fixture(scope="module")
def imported(fishsim: Path) -> tuple[Dataset, ImportReport]:
    return importers.import_files("fishsim", [fishsim / f"markers_{name}.csv" for name in TABLE])


@pytest.mark.parametrize("index", range(3), ids=list(TABLE))
def test_beat_speed_and_usable_frames_are_the_published_ones(
    imported: tuple[Dataset, ImportReport], index: int
) -> None:
    frames, beat, speed, usable, yaw_rate = list(TABLE.values())[index]
    dataset, report = imported
    file, run = report.files[index], dataset.trials[index]
    assert file.frames == frames
    assert file.beat == pytest.approx(beat, rel=0.015)
    assert file.speed == pytest.approx(speed, abs=1.5e-3)
    assert file.usable == pytest.approx(usable, abs=5)
    # The published peaks carry the noise of a shorter window and one baseline.
    assert np.ptp(run.velocity[:, 2]) == pytest.approx(yaw_rate, rel=0.2)
    assert file.kept == len(run.time) > 0.85 * frames


def test_the_run_with_a_lost_marker_is_held_out(imported: tuple[Dataset, ImportReport]) -> None:
    dataset, report = imported
    assert [(run.name, run.role) for run in dataset.trials] == [
        ("f0_50", "fit"), ("f1_00", "fit"), ("f1_25", "held_out"),
    ]  # fmt: skip
    assert any("marker 6 lost" in note for note in report.files[2].notes)


def test_f1_50_is_refused_for_its_joint_angles(fishsim: Path) -> None:
    path = fishsim / "markers_f1_50.csv"
    with pytest.raises(InputError) as caught:
        importers.import_files("fishsim", [fishsim / "markers_f1_00.csv", path])
    text = str(caught.value)
    for part in (str(path), "joint angles", "4 in", "6 in", "of 351", "track these markers again", "leave this file"):
        assert part in text, (part, text)
    file = markers.read(path)
    whole = ~tracking.lost(file.position)[:, list(markers.TAIL)].any(axis=1)
    assert 5 <= whole.sum() <= 20
    assert not tracking.lost(file.position)[:, list(markers.HEAD)].any()


@pytest.mark.parametrize("index", range(3), ids=list(TABLE))
def test_a_wave_travels_down_the_tail_and_grows(imported: tuple[Dataset, ImportReport], index: int) -> None:
    dataset, report = imported
    run, beat = dataset.trials[index], report.files[index].beat
    assert run.joint_angle is not None
    phase = 2 * np.pi * beat * run.time
    design = np.column_stack([np.ones_like(phase), run.time, np.cos(phase), np.sin(phase)])
    direction = np.cumsum(run.joint_angle, axis=1)
    wave = np.array([1, -1j]) @ np.linalg.lstsq(design, direction)[0][2:]
    turn = np.array([1, -1j]) @ np.linalg.lstsq(design, run.velocity[:, 2])[0][2:]
    lag = -np.unwrap(np.angle(wave))
    assert np.all(np.diff(lag) > 0.0), lag
    assert 0.15 < lag[-1] - lag[0] < 1.5
    assert abs(wave[-1]) > 1.6 * abs(wave[0])
    assert np.radians(25) < abs(wave[-1]) < np.radians(45)
    # The head recoils: it turns to the other side than the tail, which is a quarter beat ahead of the rate of yaw.
    recoil = np.degrees(np.angle(turn / 1j / wave[-1]))
    assert abs(abs(recoil) - 180.0) < 60.0


def test_noise_is_a_few_per_cent_of_the_motion(imported: tuple[Dataset, ImportReport]) -> None:
    dataset, _ = imported
    assert dataset.noise is not None
    moved = np.mean([np.ptp(run.velocity, axis=0) for run in dataset.trials], axis=0)
    assert np.all(dataset.noise / moved < [0.10, 0.04, 0.04])
    assert np.all(dataset.noise / moved > 0.003)


def test_the_dataset_is_saved_and_drives_the_model(imported: tuple[Dataset, ImportReport], tmp_path: Path) -> None:
    """Unfitted textbook coefficients already swim the right way, at about the right speed and turn in step."""
    trial.save(imported[0], tmp_path / "out")
    dataset = trial.load(tmp_path / "out")
    nominal = model.Model(dataset.fish)
    for run in dataset.trials:
        predicted = nominal.predict(run, nominal.values(), velocity=run.velocity[0])
        assert predicted.status == "ok"
        assert predicted.velocity[:, 0].mean() == pytest.approx(run.velocity[:, 0].mean(), abs=0.03)
        turned = np.corrcoef(predicted.velocity[:, 2], run.velocity[:, 2])[0, 1]
        assert turned > 0.9
