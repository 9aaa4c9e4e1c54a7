"""Runs of the one-joint fish, in files that are laid out like the public ones."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mjfish.data import Trial
from mjfish.data.importers import import_files
from mjfish.drive.wave import Wave
from mjfish.errors import MjfishError
from mjfish.estimation import Noise, Problem, fit
from mjfish.estimation.clocks import aligned
from mjfish.fish import load_fish
from mjfish.model import Model
from mjfish.numerics.arrays import FloatArray, readonly

#: As a user gives it.
IMPORTER = Path(__file__).parents[2] / "tools" / "importers" / "tail_fish.py"


def _swum(amplitude: float, bias: float, frequency: float, phase: float) -> FloatArray:
    """Return a table (n, 7) as the files have it, of the simulated fish: its centre of mass is tracked."""
    fish = load_fish("one_joint")
    behind = fish.links[0].com
    time = 0.0667 + np.arange(180) / 30.0
    angles = [np.radians(amplitude)], [phase], [np.radians(bias)]
    wave = Wave(frequency, *(tuple(map(float, own)) for own in angles))
    blank = Trial("run", None, readonly(time), readonly(np.zeros((len(time), 3))), wave=wave)
    blank = replace(blank, pose=readonly(np.broadcast_to([0.3, -0.2, 0.7], (len(time), 3))))
    run = Model(fish).predict(blank, Model(fish).values(), velocity=np.array([0.05, 0.0, 0.0]))
    yaw = run.pose[:, 2]
    place = run.pose[:, :2] - behind * np.column_stack([np.cos(yaw), np.sin(yaw)])
    velocity = run.velocity.copy()
    velocity[:, 1] -= behind * velocity[:, 2]
    return np.column_stack([time, velocity, yaw, place])


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three runs."""
    made = tmp_path_factory.mktemp("runs")
    for name, amplitude, bias in (("Amp20Bias0", 20, 0), ("Amp20Bias-30", 20, -30), ("Amp15Bias40", 15, 40)):
        np.savetxt(made / f"{name}.txt", _swum(amplitude, bias, 2.1, 0.8), fmt="%.6f")
    return made


def test_a_run_is_what_its_file_says(folder: Path) -> None:
    dataset, report = import_files(IMPORTER, sorted(folder.glob("*.txt")), ["Amp15Bias40"])
    assert [trial.role for trial in dataset.trials] == ["held_out", "fit", "fit"]
    assert dataset.fish == load_fish("one_joint")
    waves = [trial.wave for trial in dataset.trials]
    assert all(wave is not None and wave.free for wave in waves)
    told = [(round(np.degrees(w.amplitude[0])), round(np.degrees(w.bias[0]))) for w in waves if w is not None]
    assert told == [(15, 40), (20, -30), (20, 0)]
    assert [w.frequency for w in waves if w is not None] == pytest.approx([2.1] * 3, rel=0.02)
    assert [file.beat for file in report.files] == [w.frequency for w in waves if w is not None]


def test_the_tracked_point_is_carried_to_the_nose(folder: Path) -> None:
    """Velocities of the nose are the rates of its poses."""
    dataset, _ = import_files(IMPORTER, [folder / "Amp20Bias0.txt"])
    (trial,) = dataset.trials
    assert trial.pose is not None
    rate = np.gradient(trial.pose, trial.time, axis=0)
    cos, sin = np.cos(trial.pose[:, 2]), np.sin(trial.pose[:, 2])
    across = -rate[:, 0] * sin + rate[:, 1] * cos
    inner = slice(2, -2)
    assert np.corrcoef(across[inner], trial.velocity[inner, 1])[0, 1] > 0.995


def test_what_swam_is_found_again(folder: Path) -> None:
    """Frequency, phase and coefficients: a fit is at the level of the rounding of the files."""
    dataset, _ = import_files(IMPORTER, sorted(folder.glob("*.txt")))
    problem = Problem(Model(dataset.fish), aligned(dataset).trials, Noise.white(np.full(3, 1e-3)))
    found = fit(problem)
    assert found.sse < 0.01 * len(found.residual)


@pytest.mark.parametrize(
    ("name", "text", "complaint"),
    [
        ("run1.txt", "", "its name says no amplitude and bias, expected e.g. Amp20Bias-30.txt"),
        ("Amp20Bias0.txt", "0.1 0.2 0.3\n" * 30, "30 rows of 3 numbers, expected 20 rows or more of seven"),
        ("Amp20Bias0.txt", "0.1 0 0 0 0 0 0\n", "1 rows of 7 numbers, expected 20 rows or more"),
        ("Amp20Bias0.txt", " \n", "no rows; expected rows of seven numbers"),
        ("Amp20Bias0.txt", "# 1\n", "expected rows of seven numbers"),
        ("Amp20Bias0.txt", "time u v w h x y\n", "expected rows of seven numbers: time, velocity along"),
        ("Amp20Bias0.txt", "0.1 0 0 0 0 0 0\n" * 30, "row 2, column 'time': 0.1 s repeats that of row 1"),
        ("Amp20Bias0.txt", "0.1 0 nan 0 0 0 0\n" * 30, "row 1, velocity across: no finite number"),
    ],
)
def test_what_is_no_such_file_is_refused(tmp_path: Path, name: str, text: str, complaint: str) -> None:
    (tmp_path / name).write_text(text, encoding="utf-8")
    with pytest.raises(MjfishError, match=complaint.replace("(", r"\(")):
        import_files(IMPORTER, [tmp_path / name])


def test_a_missing_file_and_a_mapping_are_refused(tmp_path: Path) -> None:
    with pytest.raises(MjfishError, match="cannot be read"):
        import_files(IMPORTER, [tmp_path / "Amp1Bias1.txt"])
    with pytest.raises(MjfishError, match="takes no mapping file"):
        import_files(IMPORTER, [tmp_path / "Amp1Bias1.txt"], mapping=tmp_path / "map.toml")
