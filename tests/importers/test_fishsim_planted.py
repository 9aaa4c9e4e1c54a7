"""Planted tracks: what is known is recovered, with the errors that the importer states."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from planted_markers import Planted

from mjfish import importers, trial
from mjfish.errors import InputError
from mjfish.importers.fishsim.motion import Smoother
from mjfish.importers.report import FileReport
from mjfish.trial import Dataset, Trial


def _import(path: Path, fish: Planted) -> tuple[Dataset, FileReport]:
    dataset, report = importers.import_files("fishsim", [fish.write(path / "markers_run.csv")])
    return dataset, report.files[0]


def _errors(fish: Planted, found: Trial) -> tuple[np.ndarray, np.ndarray]:
    """Return errors of velocity (n, 3) and joint angle (n, 5), frame by frame."""
    first = Smoother.for_beat(fish.beat).edge
    time = fish.time[first : first + len(found.time)]
    assert found.joint_angle is not None
    return found.velocity - fish.velocity(time), found.joint_angle - fish.joint_angle(time)


SHIFTED = {"tail_shift": (-0.04, 0.02), "fin_shift": (0.02, -0.01), "body_shift": (-0.015, -0.02)}


@pytest.mark.parametrize("heading", [-2.5, 0.4, 1.9])
def test_swimming_forward_is_positive_surge_and_turning_counter_clockwise_positive_yaw(
    tmp_path: Path, heading: float
) -> None:
    """A slip in the image's sign of y turns the yaw rate and sway around, one in the head's direction the surge."""
    fish = Planted(heading=heading, noise=0.0)
    dataset, _ = _import(tmp_path, fish)
    velocity, joint = _errors(fish, dataset.trials[0])
    assert np.abs(velocity / np.ptp(fish.velocity(fish.time), axis=0)).max() < 0.02
    assert np.abs(joint).max() < 0.01


def test_a_fish_that_turns_left_in_the_picture_has_positive_yaw_rate(tmp_path: Path) -> None:
    """Built by hand from pixels, y down: the head points right and turns up the image."""
    fish = Planted(heading=0.0, swing=0.0, turn=0.3, noise=0.1)
    pixel = fish.pixels()
    assert pixel[0, 0, 0] > pixel[0, 8, 0]  # the front is on the right
    assert pixel[-1, 0, 1] - pixel[-1, 1, 1] < pixel[0, 0, 1] - pixel[0, 1, 1]  # and rises: image y falls
    dataset, _ = _import(tmp_path, fish)
    np.testing.assert_allclose(dataset.trials[0].velocity[:, 2], 0.3, atol=0.05)
    np.testing.assert_allclose(dataset.trials[0].velocity[:, 0].mean(), 0.1, atol=0.002)


@pytest.mark.parametrize("shifts", [{}, SHIFTED], ids=["straight", "shifted by parallax"])
@pytest.mark.parametrize("beat", [0.4, 0.9])
def test_velocities_are_unbiased_with_the_stated_noise(
    tmp_path: Path, beat: float, shifts: dict[str, tuple[float, float]]
) -> None:
    """Over four seeds, so that rms over sigma is known to about a tenth."""
    squares, means, sigmas = [], [], []
    for seed in range(4):
        fish = Planted(beat=beat, seed=seed, frames=600, **shifts)
        dataset, _ = _import(tmp_path, fish)
        velocity, _ = _errors(fish, dataset.trials[0])
        assert dataset.noise is not None
        squares.append(np.square(velocity).mean(axis=0))
        means.append(velocity.mean(axis=0))
        sigmas.append(dataset.noise)
    ratio = np.sqrt(np.mean(squares, axis=0)) / np.sqrt(np.mean(np.square(sigmas), axis=0))
    # A shifted marker costs a slow error of yaw beyond the noise: the tilt of the line through head and shift.
    assert np.all((ratio > 0.75) & (ratio < 1.3)), ratio
    assert np.all(np.abs(np.mean(means, axis=0)) < 0.25 * np.mean(sigmas, axis=0))


@pytest.mark.parametrize("shifts", [{}, SHIFTED], ids=["straight", "shifted by parallax"])
def test_joint_angles_are_recovered(tmp_path: Path, shifts: dict[str, tuple[float, float]]) -> None:
    fish = Planted(**shifts, seed=3)
    dataset, report = _import(tmp_path, fish)
    _, joint = _errors(fish, dataset.trials[0])
    assert np.abs(joint.mean(axis=0)).max() < 0.03
    rms = np.sqrt(np.square(joint).mean())
    assert rms < 0.06
    # Stated is what markers and beliefs leave open together; the planted tail zigzags less than is believed possible.
    assert 0.4 < rms / report.joint_noise < 1.1


def test_pose_is_the_cameras_and_starts_at_the_origin(tmp_path: Path) -> None:
    fish = Planted()
    dataset, _ = _import(tmp_path, fish)
    pose, first = dataset.trials[0].pose, Smoother.for_beat(fish.beat).edge
    assert pose is not None
    expected = fish.pose()[first : first + len(pose)]
    np.testing.assert_allclose(pose[0, :2], 0.0, atol=1e-12)
    np.testing.assert_allclose(pose[:, 2], expected[:, 2], atol=0.01)
    np.testing.assert_allclose(pose[-1, :2], expected[-1, :2] - expected[0, :2], atol=2e-3)
    assert dataset.trials[0].time[0] == 0.0
    np.testing.assert_allclose(np.diff(dataset.trials[0].time), 1 / 60, atol=1e-12)


def test_the_scale_does_not_depend_on_the_camera(tmp_path: Path) -> None:
    near, far = Planted(scale=0.0005, noise=0.2), Planted(scale=0.002, noise=0.05)
    speeds = [_import(tmp_path, fish)[1].speed for fish in (near, far)]
    np.testing.assert_allclose(speeds, 0.1, rtol=0.01)


@pytest.mark.parametrize("beat", [0.38, 0.75, 1.13, 2.0])
def test_the_beat_is_found(tmp_path: Path, beat: float) -> None:
    _, report = _import(tmp_path, Planted(beat=beat, frames=400))
    assert report.beat == pytest.approx(beat, rel=0.01)


def test_short_losses_are_found_and_filled(tmp_path: Path) -> None:
    """Two plates swapped, one jumping, one stuck, at three times: each is seen, and the angles hardly notice."""
    fish = Planted(seed=5)
    clean, _ = _import(tmp_path, fish)
    pixel = fish.pixels()
    pixel[100:104, [4, 5]] = pixel[100:104, [5, 4]]
    pixel[200:203, 7] += [40.0, -25.0]
    pixel[300:305, 5] = pixel[300:305, 6]
    dataset, report = importers.import_files("fishsim", [fish.write(tmp_path / "markers_run.csv", pixel)])
    # A frame beside a swap may be blamed too.
    assert fish.frames - 16 <= report.files[0].usable <= fish.frames - 12
    assert report.files[0].trials == ("run",)
    assert any("short losses filled" in note for note in report.files[0].notes)
    spoiled, whole = dataset.trials[0].joint_angle, clean.trials[0].joint_angle
    assert spoiled is not None
    assert whole is not None
    assert np.abs(spoiled - whole).max() < 0.15


def test_a_marker_that_slips_sideways_is_found_by_the_turn_it_makes(tmp_path: Path) -> None:
    """Its distances to its neighbours stay within what parallax does; what comes before is too short to keep."""
    fish = Planted(swing=0.0, turn=0.0, heading=0.0)
    pixel = fish.pixels()
    pixel[100:130, 5, 1] += 0.025 / fish.scale
    dataset, report = importers.import_files("fishsim", [fish.write(tmp_path / "markers_run.csv", pixel)])
    assert report.files[0].usable == pytest.approx(fish.frames - 30, abs=3)
    (cut,) = report.files[0].cuts
    assert "marker 5 lost" in cut.reason
    assert cut.end == pytest.approx(130 / 60, abs=0.05)
    assert len(dataset.trials[0].time) == pytest.approx(290 - 24, abs=4)


def test_a_marker_lost_half_of_the_time_is_left_out_throughout(tmp_path: Path) -> None:
    """It would make the angles jump each time it came back; the run is held out, complete ones are fitted."""
    fish = Planted(seed=6)
    pixel = fish.pixels()
    stuck = (fish.time * fish.beat % 1.0) < 0.5
    pixel[stuck, 6] += 0.5 * (pixel[stuck, 5] - pixel[stuck, 6])
    files = [fish.write(tmp_path / "markers_bad.csv", pixel), fish.write(tmp_path / "markers_good.csv")]
    dataset, report = importers.import_files("fishsim", files)
    bad = report.files[0]
    assert bad.usable == pytest.approx((~stuck).sum(), abs=2)
    assert any("marker 6 lost" in note for note in bad.notes)
    assert [run.role for run in dataset.trials] == ["held_out", "fit"]
    _, joint = _errors(fish, dataset.trials[0])
    assert np.abs(joint.mean(axis=0)).max() < 0.05
    assert np.sqrt(np.square(joint).mean()) < 0.09
    # Nothing jumps where the marker comes and goes.
    assert np.abs(np.diff(joint, axis=0)).std() < 2.0 * np.sqrt(2.0) * bad.joint_noise


def test_two_plates_lost_are_refused(tmp_path: Path) -> None:
    fish = Planted()
    pixel = fish.pixels()
    pixel[20:, 4] = pixel[20:, 5] + [1.0, 2.0]
    pixel[30:, 6] = pixel[30:, 7] + [2.0, 0.0]
    path = fish.write(tmp_path / "markers_run.csv", pixel)
    with pytest.raises(InputError) as caught:
        importers.import_files("fishsim", [path])
    text = str(caught.value)
    for part in (str(path), "joint angles", "4 in 400 frames", "6 in 390 frames", "20 of 420", "track"):
        assert part in text, (part, text)


def test_a_head_lost_in_the_middle_makes_two_trials(tmp_path: Path) -> None:
    fish = Planted(frames=600)
    pixel = fish.pixels()
    pixel[290:310, 0] += [30.0, 30.0]
    dataset, report = importers.import_files("fishsim", [fish.write(tmp_path / "markers_run.csv", pixel)])
    assert [run.name for run in dataset.trials] == ["run-a", "run-b"]
    assert all(run.time[0] == 0.0 for run in dataset.trials)
    (cut,) = report.files[0].cuts
    assert (cut.start, cut.end) == pytest.approx((290 / 60, 310 / 60), abs=0.05)
    assert "marker 0" in cut.reason


def test_a_head_lost_too_often_is_refused_for_the_pose(tmp_path: Path) -> None:
    fish = Planted()
    pixel = fish.pixels()
    for start in range(40, 420, 80):
        pixel[start : start + 12, 1] += 60.0
    with pytest.raises(InputError, match=r"no head pose to be had.*1 in \d+ frames"):
        importers.import_files("fishsim", [fish.write(tmp_path / "markers_run.csv", pixel)])


def test_the_dataset_reads_back(tmp_path: Path) -> None:
    fish = Planted()
    dataset, _ = importers.import_files(
        "fishsim", [fish.write(tmp_path / "markers_a.csv"), fish.write(tmp_path / "markers_b.csv")], held_out=["b"]
    )
    trial.save(dataset, tmp_path / "out")
    again = trial.load(tmp_path / "out")
    assert again.fish.name == "eth_tendon"
    assert [run.role for run in again.trials] == ["fit", "held_out"]
    np.testing.assert_array_equal(again.trials[1].velocity, dataset.trials[1].velocity)
    assert again.noise is not None
    assert dataset.noise is not None
    np.testing.assert_array_equal(again.noise, dataset.noise)
