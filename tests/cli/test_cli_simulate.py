"""``mjfish simulate``."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from command_line import Run

from mjfish import fish as fishes
from mjfish import ode
from mjfish.data import Trial, columns, read_table, write_table
from mjfish.drive import cpg, modes
from mjfish.effects import find
from mjfish.fish import Fish, load_fish
from mjfish.model import Model
from mjfish.mujoco import viewer
from mjfish.mujoco.viewer import Tank

COLUMNS = ["time", "surge", "sway", "yaw_rate", "x", "y", "yaw", "joint_1", "joint_2", "joint_3", "joint_4"]


def _own_fish(folder: Path, *edits: tuple[str, str]) -> Path:
    text = fishes.shipped()["pike"].read_text(encoding="utf-8")
    for old, new in edits:
        assert old in text
        text = text.replace(old, new, 1)
    path = folder / "mine.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_a_run_of_the_ode_is_written_as_table_and_log(run: Run, tmp_path: Path) -> None:
    shown = run("simulate --mode v3 --duration 1 --out runs/a").stdout
    table = read_table(tmp_path / "runs" / "a" / "rollout.csv")
    assert list(table) == COLUMNS
    np.testing.assert_allclose(table["time"], np.arange(101) / 100)
    pike = load_fish("pike")
    motion = cpg.joint_motion(pike.cpg, modes.drive("v3"), 1.0, 0.001)
    state = ode.simulate(pike, motion).at(table["time"])
    np.testing.assert_allclose(np.column_stack([table[name] for name in COLUMNS[1:7]]), state[:, :6], atol=1e-12)
    np.testing.assert_allclose(table["joint_4"], motion.angle_at(table["time"])[:, 3], atol=1e-12)
    assert (tmp_path / "runs" / "a" / "rollout.rrd").stat().st_size > 1000
    assert f"mean surge of the second half {table['surge'][50:].mean():.3f} m/s" in shown
    assert "view runs/a/rollout.rrd)" in shown
    assert sorted(path.name for path in (tmp_path / "runs" / "a").iterdir()) == ["rollout.csv", "rollout.rrd"]


def test_mujoco_swims_as_the_ode_does(run: Run, tmp_path: Path) -> None:
    """Its servos follow the command a little late, so the runs are near and not the same."""
    for engine in ("ode", "mujoco"):
        run(f"simulate --duration 3 --engine {engine} --out {engine}")
    a, b = (read_table(tmp_path / engine / "rollout.csv") for engine in ("ode", "mujoco"))
    assert list(a) == list(b) == COLUMNS
    speeds = [table["surge"][150:].mean() for table in (a, b)]
    assert speeds[1] == pytest.approx(speeds[0], rel=0.1)
    assert speeds[1] != speeds[0]


def test_coefficients_can_be_set(run: Run, tmp_path: Path) -> None:
    run("simulate --duration 0.5 --out a")
    run("simulate --duration 0.5 --set c_d.head=1 --set c_m.tail=0.5 --out b")
    a, b = (read_table(tmp_path / name / "rollout.csv")["sway"] for name in "ab")
    assert np.max(np.abs(a - b)) > 0.01


def test_a_fish_of_ones_own_swims_and_its_name_is_no_markup(run: Run, tmp_path: Path) -> None:
    _own_fish(tmp_path, ('name = "pike"', 'name = "mine [/]"'))
    assert "mine [/], v1, ode: mean surge" in run("simulate --fish mine.toml --duration 0.5 --out a").stdout


def test_a_run_may_be_shorter_than_one_sample(run: Run, tmp_path: Path) -> None:
    run("simulate --duration 0.005 --out a")
    assert read_table(tmp_path / "a" / "rollout.csv")["time"].tolist() == [0.0]


@pytest.mark.parametrize("engine", ["ode", "mujoco"])
def test_a_run_that_diverges_is_written_as_far_as_it_went_and_exits_with_1(
    run: Run, tmp_path: Path, engine: str
) -> None:
    """The message names the time and the coefficients."""
    _own_fish(
        tmp_path,
        ("beta = 60.0", "beta = 6000.0"),
        ("high = 4.0 }\ntail = { value = 2.5", "high = 4.0 }\ntail = { value = 3.5"),
    )
    result = run(f"simulate --fish mine.toml --engine {engine} --duration 1 --out a", exit_code=1)
    assert "diverged: diverged at 0." in result.stderr
    assert " s with c_m.head = 0.01" in result.stderr
    assert "c_d.tail = 3.5" in result.stderr
    table = read_table(tmp_path / "a" / "rollout.csv")
    assert 1 <= len(table["time"]) < 101
    assert "wrote" not in result.stdout


REFUSED = {
    "unknown fish": (
        "--fish carp",
        "unknown fish 'carp'; known: eth_tendon, one_joint, pike; or give the path of a fish TOML",
    ),
    "missing fish": ("--fish carp.toml", "carp.toml: no such fish file; shipped fish: eth_tendon, one_joint, pike"),
    "fish without cpg": ("--fish eth_tendon", "eth_tendon has no [cpg], which a mode of swimming needs; add one"),
    "unknown mode": ("--mode v2", "unknown mode 'v2'; known: v1, v1-t1"),
    "unknown coefficient": ("--set c_d.fin=1", "unknown parameter 'c_d.fin'; known: c_d.body"),
    "out of bounds": ("--set c_d.head=9", "c_d.head: value 9 - is outside its bounds [0.1, 4]; choose a value inside"),
    "no value": ("--set c_d.head", "--set: found 'c_d.head', expected NAME=VALUE, e.g. c_d.head=2.0"),
    "no number": ("--set c_d.head=two", "--set c_d.head: found 'two', expected a number; correct it"),
    "no finite number": ("--set c_d.head=nan", "--set c_d.head: found 'nan', expected a number"),
    "set twice": ("--set c_d.head=1 --set c_d.head=2", "--set: 'c_d.head' is set twice; set it once"),
    "no time": ("--duration 0", "duration 0 s at 100 Hz: expected more than 0 and at most 10000 s"),
    "endless": ("--duration inf", "duration inf s at 100 Hz: expected more than 0 and at most 10000 s"),
    "unknown effect": ("--effect drag:x=1", "unknown effect 'drag'; known: added_mass_amplitude, added_mass_law"),
    "effect out of bounds": ("--set munk_moment.kappa=9", "munk_moment.kappa: value 9 - is outside its bounds"),
    "unknown parameter": ("--effect munk_moment:size=1", "unknown parameter of munk_moment 'size'; known: kappa"),
    "two drives": ("--wave frequency=1 --joints a.csv", "--wave: found with --joints, expected one drive; drop one"),
    "no wave": ("--wave fast", "wave: found 'fast', expected e.g. frequency=1.5, amplitude=[0.2, 0.3]"),
    "half a wave": ("--wave frequency=1", "wave: amplitude: this key is missing; add it"),
    "uneven wave": (
        "--wave 'frequency=1,amplitude=[0.1,0.2],phase=[0]'",
        "expected one amplitude, phase and bias a joint",
    ),
    "wave of another fish": (
        "--wave 'frequency=1,amplitude=[0.1],phase=[0]'",
        "the wave has 1 amplitudes, expected 4",
    ),
    "no file of joints": ("--joints absent.csv", "absent.csv: no such file"),
    "engine": ("--engine bullet", "'bullet' is not one of 'ode', 'mujoco'"),
}


@pytest.mark.parametrize(("options", "complaint"), REFUSED.values(), ids=REFUSED)
def test_bad_input_is_refused_and_nothing_written(refuse: Callable[[str], str], options: str, complaint: str) -> None:
    assert complaint in refuse(f"simulate {options} --out a").replace("│ ", "")


def test_an_unknown_key_in_a_fish_is_refused_by_its_name(refuse: Callable[[str], str], tmp_path: Path) -> None:
    _own_fish(tmp_path, ("density = 1000.0", "density = 1000.0\ncolour = 3"))
    assert "mine.toml: colour: unknown key; remove it or correct its spelling" in refuse(
        "simulate --fish mine.toml --out a"
    )


@pytest.mark.parametrize("out", ["file", "file/below"])
def test_an_output_that_cannot_be_written_is_refused_before_anything_is_simulated(
    refuse: Callable[[str], str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, out: str
) -> None:
    (tmp_path / "file").write_text("x", encoding="utf-8")
    monkeypatch.setattr(ode, "simulate", None)
    assert "file: is a file, expected a folder; choose another place" in refuse(f"simulate --out {out}")


def test_out_must_be_given(refuse: Callable[[str], str]) -> None:
    assert "Invalid value for '--out': give a folder, or --viewer" in refuse("simulate")


@pytest.mark.parametrize("option", ["--set munk_moment.kappa=1", "--effect munk_moment:kappa=1"])
def test_a_plain_fish_gets_an_effect(run: Run, tmp_path: Path, option: str, pike: Fish) -> None:
    shown = run(f"simulate {option} --duration 1 --out a").stdout
    assert "with munk_moment: kappa = 1\n" in shown
    table = read_table(tmp_path / "a" / "rollout.csv")
    time = table["time"]
    model = Model(pike, (find("munk_moment"),), step=0.001)
    trial = Trial("v1", None, time, np.zeros((len(time), 3)), drive=modes.drive("v1"))
    expected = model.predict(trial, model.values({"munk_moment.kappa": 1.0})).velocity
    np.testing.assert_allclose(table["yaw_rate"], expected[:, 2], rtol=0, atol=1e-12)


@pytest.mark.parametrize("engine", ["ode", "mujoco"])
def test_a_fish_without_cpg_swims_by_a_wave(run: Run, tmp_path: Path, engine: str) -> None:
    wave = "frequency=1.0, amplitude=[0.1, 0.2, 0.3, 0.3, 0.3], phase=[0.0, -0.8, -1.6, -2.4, -3.2], ramp=0.5"
    shown = run(f"simulate --fish eth_tendon --wave '{wave}' --engine {engine} --duration 2 --out a").stdout
    assert f"eth_tendon, wave, {engine}: mean surge of the second half " in shown
    table = read_table(tmp_path / "a" / "rollout.csv")
    assert table["surge"][-1] > 0.02
    if engine == "ode":
        late = table["time"] > 0.5
        swing = 0.3 * np.sin(2.0 * np.pi * table["time"] - 1.6)
        np.testing.assert_allclose(table["joint_3"][late], swing[late], atol=1e-3)


def test_joint_angles_of_ones_own_drive_the_fish(run: Run, tmp_path: Path) -> None:
    """Those of another run make the same run, but for the smoothing of their spline."""
    run("simulate --mode v1 --duration 2 --out a")
    first = read_table(tmp_path / "a" / "rollout.csv")
    names = ["time", *(f"joint_{k}" for k in range(1, 5))]
    write_table(tmp_path / "mine.csv", {columns.header(name): first[name] for name in names})
    assert "pike, mine, ode: mean surge" in run("simulate --joints mine.csv --out b").stdout
    second = read_table(tmp_path / "b" / "rollout.csv")
    np.testing.assert_array_equal(second["time"], first["time"])
    for name in ("surge", "sway", "yaw_rate"):
        np.testing.assert_allclose(second[name], first[name], atol=0.02 * np.ptp(first[name]))


def test_joint_angles_of_another_fish_are_refused(refuse: Callable[[str], str], tmp_path: Path) -> None:
    header = "time [s],joint_1 [rad],joint_2 [rad],joint_3 [rad]\n"
    (tmp_path / "mine.csv").write_text(header + "0,0,0,0\n0.01,0,0,0\n", encoding="utf-8")
    assert "mine.csv: joint_4 [rad] missing; expected the time and 4 joints, those of pike" in refuse(
        "simulate --joints mine.csv --out a"
    )


def test_the_viewer_needs_a_display_and_writes_nothing(
    refuse: Callable[[str], str], monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr("sys.platform", "linux")
    assert "--viewer: there is no display to open a window on" in refuse("simulate --viewer")
    assert "--viewer: found with --out, but writes nothing; drop one" in refuse("simulate --viewer --out a")


def test_the_viewer_shows_the_fish_of_the_command_line(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    shown: list[Tank] = []
    monkeypatch.setattr(viewer, "check_display", lambda: None)
    monkeypatch.setattr(viewer, "show", shown.append)
    assert "panel Control" in run("simulate --viewer --mode v3 --set c_d.tail=1.7 --free").stdout
    (tank,) = shown
    assert tank.water.links[-1].c_d == 1.7
    assert tank.model.nq == 7 + 4
