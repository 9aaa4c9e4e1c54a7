"""The commands and the Python of README and docs run as they stand there."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest
from doc_blocks import ROOT, blocks

from mjfish.data import load_dataset

PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]


def _run(command: str, folder: Path, codes: tuple[int, ...] = (0,)) -> str:
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    done = subprocess.run(
        command, shell=True, cwd=folder, capture_output=True, text=True, env={**os.environ, "PATH": path}, check=False
    )
    assert done.returncode in codes, f"{command}\n{done.stdout}\n{done.stderr}"
    return done.stdout


def test_readme_commands_and_python_run(tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    commands = [line for line in blocks(ROOT / "README.md", "sh")[1].splitlines() if line]
    assert all(command.startswith("mjfish ") for command in commands)
    for command in commands:
        told = _run(command, tmp_path)
        if " diagnose " in command:
            assert "The cause is servo_lag" in told
    for name in ("diagnosis.json", "report.html", "fish.rrd", "turn/rollout.csv", "turn/rollout.rrd"):
        assert (tmp_path / "out" / name).stat().st_size > 0, name
    plate, script = blocks(ROOT / "README.md", "python")
    (tmp_path / "plate.py").write_text(plate)
    assert _run("python plate.py", tmp_path) == "0.35 m/s2, added-mass force -0.82 N\n"  # 1 / (0.5 + rho pi/4 h^2 L)
    (tmp_path / "example.py").write_text(script)
    told = _run("python example.py", tmp_path)
    assert "The cause is servo_lag" in told
    assert re.search(r"servo_lag.time_constant = 0.0(19|20)\d+ ", told)
    assert "held-out error falls by" in told


def test_readme_makes_targets_that_exist() -> None:
    makefile = (ROOT / "Makefile").read_text()
    for command in re.findall(r"^make (\S+)", blocks(ROOT / "README.md", "sh")[0], re.MULTILINE):
        assert re.search(rf"^{command}:", makefile, re.MULTILINE), command


def test_the_dataset_that_is_described_can_be_read(tmp_path: Path) -> None:
    """Every key of the page, with recordings that fit it; a command writes one as well."""
    page = ROOT / "docs" / "datasets.md"
    (command,) = blocks(page, "sh")
    _run(command, tmp_path)
    assert (tmp_path / "out" / "pool" / "dataset.toml").is_file()
    (described,) = blocks(page, "toml")
    (tmp_path / "dataset.toml").write_text(described)
    time = np.arange(0.0, 8.0, 0.02)
    plain = {"time [s]": time, "surge [m/s]": 0.1 * time, "sway [m/s]": 0.0 * time, "yaw_rate [rad/s]": 0.0 * time}
    posed = {**plain, "x [m]": 1.0 + 0.0 * time, "y [m]": 1.0 + 0.0 * time, "yaw [rad]": 0.0 * time}
    joints = {f"joint_{j} [rad]": 0.3 * np.sin(9.0 * time) for j in range(1, 5)}
    for name, columns in (("straight", posed), ("wave", plain), ("angles", {**plain, **joints})):
        table = np.column_stack([*columns.values()])
        rows = np.delete(table, [50, 51], axis=0) if name == "straight" else table
        np.savetxt(tmp_path / f"{name}.csv", rows, delimiter=",", header=",".join(columns), comments="")
    dataset = load_dataset(tmp_path)
    straight, wave, angles = dataset.trials
    assert straight.gaps
    assert len(straight.time) == len(time) - 2
    assert straight.tank is not None
    assert [segment.start for segment in straight.drive] == [0.0, 5.2]
    assert wave.wave is not None
    assert wave.wave.ramp == 0.5
    assert angles.joint_angle is not None
    assert {p.name: p.start for p in dataset.fish.parameters}["c_d.tail"] == 1.8
    described_columns = set(re.findall(r"`([a-z_1]+ \[.*?\])`", page.read_text()))
    assert {header.replace("joint_2", "joint_1") for header in [*posed, "joint_1 [rad]"]} <= described_columns


def test_the_walk_through_an_identification_runs(tmp_path: Path) -> None:
    """Its commands and its Python, in their order; what it says of their output is so."""
    page = ROOT / "docs" / "identification.md"
    (tmp_path / "out").mkdir()
    commands = [line for block in blocks(page, "sh") for line in block.splitlines()]
    told = [_run(command, tmp_path, (1,) if " compare " in command else (0,)) for command in commands]
    fitted, compared = told[1], told[-1]
    assert fitted.count("rests on its") == 5
    assert "residuals: passed" in fitted
    assert "4 of 4 starts reached the best optimum" in fitted
    assert compared.count("absent") == 3
    for name in ("coefficients.csv", "identified.json", "my_fish.toml", "figures/profiles.html"):
        assert (tmp_path / "out" / name).stat().st_size > 0, name
    (script,) = blocks(page, "python")
    (tmp_path / "own.py").write_text(script)
    assert "'c_m.tail': np.float64(0.061)" in _run("python own.py", tmp_path)


def test_the_walk_through_a_diagnosis_runs(tmp_path: Path) -> None:
    """A clock or the servos: the data cannot tell, and the plan knows what would."""
    page = ROOT / "docs" / "diagnosis.md"
    (tmp_path / "out").mkdir()
    _, diagnosed, planned = (_run(command, tmp_path) for command in blocks(page, "sh")[0].splitlines())
    assert diagnosed.startswith("cannot_tell")
    assert "To confirm servo_lag" in diagnosed
    assert "Verdict" not in planned
    assert "The data cannot tell" in planned
    (script,) = blocks(page, "python")
    (tmp_path / "own.py").write_text(script)
    told = _run("python own.py", tmp_path)
    assert told.startswith("cannot_tell servo_lag time_offset\n")
    assert "section_height" in told


def test_a_cause_of_ones_own_goes_through_all_of_it(tmp_path: Path) -> None:
    """The how-to's file and commands, as they stand."""
    page = ROOT / "docs" / "own-cause.md"
    source, *forces = blocks(page, "python")
    (tmp_path / "my_effects.py").write_text(source)
    (tmp_path / "force.py").write_text("\n".join(forces))
    (tmp_path / "out").mkdir()
    _run("python force.py", tmp_path)
    told = [_run(command, tmp_path) for command in blocks(page, "sh")[0].splitlines()]
    assert "gyro_gain" in told[0]
    assert "The cause is gyro_gain" in told[2]
    estimate = re.search(r"gyro_gain\.error +│ +(\S+)", told[2])
    assert estimate is not None
    assert abs(float(estimate[1]) - 0.06) < 0.002


def _told(page: Path, folder: Path) -> list[str]:
    """Run a page's Python blocks one after another, from the root; return what each of them printed.

    A block that begins with a comment ``# name.py`` is a file that others import.
    """
    told = []
    for number, block in enumerate(blocks(page, "python")):
        named = re.match(r"# (\w+\.py)\n", block)
        path = folder / (named[1] if named else f"block_{number}.py")
        path.write_text(block)
        if not named:
            told.append(_run(f"{sys.executable} -W error {path}", ROOT))
    return told


def _assert_alike(told: str, written: str) -> None:
    """The same words; numbers to a unit or so of the last digit, and below 1e-12 if they are rounding errors."""
    number = r"-?\d+(?:\.\d+)?(?:e-?\d+)?"
    assert re.sub(number, "#", told) == re.sub(number, "#", written)
    pairs = [[float(text) for text in re.findall(number, page)] for page in (told, written)]
    np.testing.assert_allclose(*pairs, rtol=5e-3, atol=1e-12)


def test_plug_in_page_does_what_it_says(tmp_path: Path) -> None:
    """Its scripts print what the page shows; the three ways to describe a plate describe the same one."""
    page = ROOT / "docs" / "mujoco-plugin.md"
    _, swimmer, plate = _told(page, tmp_path)
    shown = blocks(page, "text")
    _assert_alike(swimmer, shown[0])
    _assert_alike(plate, shown[1])


def test_fitter_page_recovers_what_it_says(tmp_path: Path) -> None:
    """The fitter prints its iterations first."""
    page = ROOT / "docs" / "mujoco-sysid.md"
    (told,) = _told(page, tmp_path)
    found = "".join(line for line in told.splitlines(keepends=True) if line.startswith("c_"))
    _assert_alike(found, blocks(page, "text")[0])
    for (value, half), truth in zip(re.findall(r"= (\S+) \+- (\S+)", found), (1.9, 1.0), strict=True):
        assert abs(float(value) - truth) < 2.0 * float(half) < 0.03


def test_plug_in_page_describes_one_plate_in_three_ways(tmp_path: Path) -> None:
    import mujoco

    from mjfish import StripFluid

    page = ROOT / "docs" / "mujoco-plugin.md"
    scene = ROOT / "models" / "xml" / "towed_plate.xml"
    (toml,) = blocks(page, "toml")
    (tmp_path / "water.toml").write_text(toml)
    spec = mujoco.MjSpec.from_file(str(scene))
    named: dict[str, object] = {"__name__": "page"}
    exec(blocks(page, "python")[0].replace("models/xml/towed_plate.xml", scene.as_posix()), named)  # noqa: S102
    by_python = named["fluid"]
    assert isinstance(by_python, StripFluid)
    by_toml = StripFluid.from_toml(spec.compile(), tmp_path / "water.toml")
    by_mjcf = StripFluid(spec.compile())
    assert by_toml.links == by_mjcf.links == by_python.links
    assert by_toml.density == by_mjcf.density == by_python.density
    custom, outline = blocks(page, "xml")
    lines = {line.strip() for line in scene.read_text().splitlines()}
    assert {line.strip() for line in custom.splitlines()} <= lines
    bodies = '<body name="head"><freejoint/><geom size=".1"/><body name="tail"><joint/><geom size=".1"/></body></body>'
    fish = StripFluid(mujoco.MjModel.from_xml_string(f"<mujoco>{outline}<worldbody>{bodies}</worldbody></mujoco>"))
    assert [(link.body, link.start, len(link.sections)) for link in fish.links] == [("head", 0.0, 2), ("tail", 0.3, 2)]


@pytest.mark.slow
@pytest.mark.real
def test_the_measured_fish_is_imported_and_diagnosed(fishsim: Path, tmp_path: Path) -> None:
    """The import page's commands, on the measured files; f1_25 is held out."""
    for file in fishsim.glob("markers_*.csv"):
        (tmp_path / file.name).symlink_to(file)
    imported, diagnosed = blocks(ROOT / "docs" / "import-fishsim.md", "sh")[0].splitlines()
    _run(imported, tmp_path)
    roles = tomllib.loads((tmp_path / "swimming" / "dataset.toml").read_text())["trials"]
    assert {trial["name"]: trial["role"] for trial in roles} == {"f0_50": "fit", "f1_00": "fit", "f1_25": "held_out"}
    told = _run(f"{diagnosed} --json found.json", tmp_path, codes=(0, 1))
    assert "mean speed error" in told
    found = json.loads((tmp_path / "found.json").read_text())
    assert found["verdict"] != "nothing_wrong"
    held = found["gain"]["held_out"]
    for model in ("nominal", "extended"):
        assert 0.0 < held[model]["yaw_rate"] < 0.2
        assert 0.0 < found["gain"]["mean_speed_error"][model] < 0.03


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_somewhere(page: Path) -> None:
    for target in re.findall(r"\]\(([^)#]+)[^)]*\)", page.read_text(encoding="utf-8")):
        if "://" not in target:
            assert (page.parent / target).exists(), target
