"""``mjfish generate`` and ``mjfish import``."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from command_line import Run

import mjfish
from mjfish.data import load_dataset
from mjfish.data.importers import HEADERS
from mjfish.drive import modes

OWN = Path(__file__).parents[1] / "effects" / "own_effects.py"
SHORT = "generate --modes v1,v3 --duration 1"


def test_a_synthetic_dataset_can_be_read_back(run: Run, tmp_path: Path) -> None:
    shown = run(
        "generate --modes v1,v3,v1 --duration 1.5 --rate 40 --noise 0.01,0.02,0.03 --seed 7 --out sets/a"
    ).stdout
    assert "dataset.toml with 3 trials" in shown
    dataset = load_dataset(tmp_path / "sets" / "a")
    assert (dataset.name, dataset.fish.name) == ("a", "pike")
    assert [trial.name for trial in dataset.trials] == ["v1", "v3", "v1.2"]
    assert dataset.trials[1].drive == modes.drive("v3")
    np.testing.assert_allclose(dataset.trials[0].time, np.arange(61) / 40)
    np.testing.assert_array_equal(dataset.noise, [0.01, 0.02, 0.03])


def test_the_modes_by_default_are_four_whole_runs(run: Run, tmp_path: Path) -> None:
    run("generate --seed 1 --out a")
    trials = load_dataset(tmp_path / "a").trials
    assert [trial.name for trial in trials] == ["v1", "v3", "v5-v1", "v1-t2"]
    assert trials[0].time[-1] == pytest.approx(10.4)


def _surge(folder: Path) -> np.ndarray:
    return load_dataset(folder).trials[0].velocity[:, 0]


def test_the_seed_is_that_of_the_noise(run: Run, tmp_path: Path) -> None:
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        run(f"{SHORT} --seed {seed} --out {name}")
    a, b, c = (_surge(tmp_path / name) for name in "abc")
    np.testing.assert_array_equal(a, b)
    assert np.all(a != c)


def test_effects_and_coefficients_are_hidden_in_it_and_not_said(run: Run, tmp_path: Path) -> None:
    quiet = f"{SHORT} --noise 0,0,0"
    run(f"{quiet} --out plain")
    run(f"{quiet} --effect servo_lag:time_constant=0.05 --set c_d.head=2 --out lag")
    run(f"{quiet} --effect ambient_current:x=0.1,y=-0.05 --out current")
    run(f"{quiet} --effects {OWN} --effect camera_scale:error=0.1 --out scale")
    plain, lag, current, scale = (_surge(tmp_path / name) for name in ("plain", "lag", "current", "scale"))
    assert np.max(np.abs(lag - plain)) > 0.01
    assert current[0] == pytest.approx(0.1)
    np.testing.assert_allclose(scale, 1.1 * plain, rtol=1e-12)
    for file in (tmp_path / "lag").iterdir():
        text = file.read_text(encoding="utf-8")
        assert "servo_lag" not in text
        assert "c_d" not in text


def test_held_out_trials_are_marked(run: Run, tmp_path: Path) -> None:
    run(f"{SHORT} --held-out v3 --out a")
    assert [trial.role for trial in load_dataset(tmp_path / "a").trials] == ["fit", "held_out"]


def test_an_older_synthetic_dataset_is_replaced_by_force_only(
    run: Run, refuse: Callable[[str], str], tmp_path: Path
) -> None:
    run(f"{SHORT} --out a")
    assert "a: holds a dataset; choose another folder, or --force to replace it" in refuse(f"{SHORT} --out a")
    assert "or --force to replace it" in refuse("import fishsim f1.csv --out a")
    run("generate --modes v5 --duration 1 --out a --force")
    assert [trial.name for trial in load_dataset(tmp_path / "a").trials] == ["v5"]
    assert sorted(file.name for file in (tmp_path / "a").iterdir()) == ["dataset.toml", "v5.csv"]


REFUSED = {
    "fish": ("--fish carp", "unknown fish 'carp'; known: eth_tendon, one_joint, pike"),
    "fish without cpg": ("--fish eth_tendon", "add [cpg] to the fish"),
    "mode": ("--modes v1,v2", "unknown mode 'v2'; known: v1, v1-t1"),
    "mode too late": ("--modes v1-t2", "mode 'v1-t2' changes at 5.2 s, after the end of a trial of 1 s; make"),
    "two sigmas": ("--noise 0.01,0.01", "--noise: found '0.01,0.01', expected 3 numbers separated by commas"),
    "sigma no number": ("--noise 0.01,big,0.05", "--noise: found '0.01,big,0.05', expected 3 numbers"),
    "negative sigma": ("--noise 0.01,-1,0.05", "expected three numbers of at least 0: surge, sway, yaw rate"),
    "rate": ("--rate 0", "duration 1 s at 0 Hz: expected more than 0 and at most 10000 s, more than 0 Hz"),
    "one sample": ("--rate 0.5", "the dataset cannot be saved"),
    "duration": ("--duration -1", "duration -1 s at 50 Hz: expected more than 0 and at most 10000 s"),
    "seed": ("--seed -1", "Invalid value for '--seed'"),
    "held out": ("--held-out v7", "unknown trial 'v7'; known: v1, v3"),
    "unknown effect": ("--effect drag:x=1", "unknown effect 'drag'; known: added_mass_amplitude, added_mass_law"),
    "no parameter": ("--effect servo_lag", "--effect: found 'servo_lag', expected NAME:PARAM=VALUE, e.g. "),
    "empty parameter": ("--effect servo_lag:", "--effect: found 'servo_lag:', expected NAME:PARAM=VALUE"),
    "unknown parameter": ("--effect servo_lag:tau=1", "unknown parameter of servo_lag 'tau'; known: time_constant"),
    "no value": ("--effect servo_lag:time_constant", "found 'time_constant', expected NAME=VALUE"),
    "no number": ("--effect servo_lag:time_constant=slow", "time_constant: found 'slow', expected a number"),
    "out of bounds": ("--effect servo_lag:time_constant=9", "time_constant: value 9 s is outside its bounds [0, 0.5]"),
    "twice": (
        "--effect servo_lag:time_constant=0.1 --effect servo_lag:time_constant=0.2",
        "--effect: 'servo_lag.time_constant' is set twice; set it once",
    ),
    "effects file": ("--effects absent.py", "absent.py: no such file of effects"),
    "coefficient": ("--set c_d.fin=1", "unknown parameter 'c_d.fin'; known: c_d.body"),
    "no setting": ("--set c_d.head:1", "--set: found 'c_d.head:1', expected NAME=VALUE"),
}  # fmt: skip


@pytest.mark.parametrize(("options", "complaint"), REFUSED.values(), ids=REFUSED)
def test_bad_input_of_generate_is_refused_and_nothing_written(
    refuse: Callable[[str], str], options: str, complaint: str
) -> None:
    assert complaint in refuse(f"{SHORT} {options} --out a").replace("│ ", "")


@pytest.fixture
def taken(tmp_path: Path) -> Path:
    """A folder with something of the user's in it."""
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.txt").write_text("x", encoding="utf-8")
    return tmp_path


@pytest.mark.parametrize(
    ("out", "complaint"),
    [
        ("mine", "mine: holds files and no dataset.toml, expected an empty folder or a dataset"),
        ("mine/thesis.txt", "thesis.txt: is a file, expected a folder; choose another place"),
        ("mine/thesis.txt/a", "thesis.txt: is a file, expected a folder; choose another place"),
    ],
)
def test_a_folder_that_cannot_be_written_is_refused_before_the_work(
    refuse: Callable[[str], str], taken: Path, monkeypatch: pytest.MonkeyPatch, out: str, complaint: str
) -> None:
    monkeypatch.setattr(mjfish, "generate", None)
    monkeypatch.setattr("mjfish.data.importers.import_files", None)
    (taken / "f1.csv").write_text("x", encoding="utf-8")
    for line in (f"generate --out {out}", f"import fishsim f1.csv --out {out}"):
        assert complaint in refuse(line)


def test_bad_input_of_import_is_refused_and_nothing_written(refuse: Callable[[str], str], tmp_path: Path) -> None:
    (tmp_path / "f1.csv").write_text("not,markers\n1,2\n", encoding="utf-8")
    assert "unknown importer 'pool'; known: deeplabcut, fishsim, markers, mcap, poses, velocities" in refuse(
        "import pool f1.csv --out a"
    )
    assert "absent.csv" in refuse("import fishsim absent.csv --out a")
    assert "f1.csv" in refuse("import fishsim f1.csv --out a")
    assert "f1.csv: given twice, expected every file once; remove one" in refuse("import fishsim f1.csv f1.csv --out a")
    assert "Missing argument" in refuse("import fishsim --out a")
    assert "Missing option '--out'" in refuse("import fishsim f1.csv")


def _named(fishsim: Path, part: str) -> Path:
    return next(path for path in sorted(fishsim.iterdir()) if part in path.name and path.suffix == ".csv")


@pytest.mark.real
def test_measured_markers_become_a_dataset_and_what_was_kept_is_said(run: Run, fishsim: Path, tmp_path: Path) -> None:
    shown = run(f"import fishsim {_named(fishsim, 'f1_00')} --out a").stdout
    dataset = load_dataset(tmp_path / "a")
    assert dataset.fish.joints == 5
    assert all(trial.joint_angle is not None for trial in dataset.trials)
    assert "what was kept" in shown
    assert f"dataset.toml with {len(dataset.trials)} trials" in shown


@pytest.mark.real
def test_a_recording_without_usable_joint_angles_is_refused_with_the_reason(
    refuse: Callable[[str], str], fishsim: Path
) -> None:
    message = refuse(f"import fishsim {_named(fishsim, 'f1_50')} --out a")
    assert "f1_50" in message
    assert "joint" in message


def test_what_an_importer_kept_is_shown_with_its_units(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Report:
        importer = "velocities [own]"

        def rows(self) -> list[list[str]]:
            return [["v1.csv", *("cut [s]" for _ in HEADERS[1:])]]

    dataset = mjfish.generate(mjfish.load_fish("pike"), ["v1"], duration=1.0, name="a")
    monkeypatch.setattr("mjfish.data.importers.import_files", lambda *_: (dataset, Report()))
    shown = run("import velocities v1.csv --out a").stdout
    assert "velocities [own]: what was kept" in shown
    for heading in HEADERS[1:-1]:
        assert f"{heading} cut [s]" in shown
    assert "remark  cut [s]" in shown
