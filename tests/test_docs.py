"""The commands and the Python of README and docs run as they stand there."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]


def _blocks(page: Path, language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", page.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)


def _run(command: str, folder: Path, codes: tuple[int, ...] = (0,)) -> str:
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    done = subprocess.run(
        command, shell=True, cwd=folder, capture_output=True, text=True, env={**os.environ, "PATH": path}, check=False
    )
    assert done.returncode in codes, f"{command}\n{done.stdout}\n{done.stderr}"
    return done.stdout


def test_readme_commands_and_python_run(tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    commands = [line for line in _blocks(ROOT / "README.md", "sh")[1].splitlines() if line]
    assert all(command.startswith("mjfish ") for command in commands)
    for command in commands:
        told = _run(command, tmp_path)
        if " diagnose " in command:
            assert "The cause is servo_lag" in told
    for name in ("diagnosis.json", "report.html", "fish.rrd", "turn/rollout.csv", "turn/rollout.rrd"):
        assert (tmp_path / "out" / name).stat().st_size > 0, name
    (script,) = _blocks(ROOT / "README.md", "python")
    (tmp_path / "example.py").write_text(script)
    told = _run("python example.py", tmp_path)
    assert "The cause is servo_lag" in told
    assert re.search(r"servo_lag.time_constant = 0.0(19|20)\d+ ", told)
    assert "held-out error falls by" in told


def test_readme_makes_targets_that_exist() -> None:
    makefile = (ROOT / "Makefile").read_text()
    for command in re.findall(r"^make (\S+)", _blocks(ROOT / "README.md", "sh")[0], re.MULTILINE):
        assert re.search(rf"^{command}:", makefile, re.MULTILINE), command


def test_a_cause_of_ones_own_goes_through_all_of_it(tmp_path: Path) -> None:
    """The how-to's file and commands, as they stand."""
    page = ROOT / "docs" / "own-cause.md"
    source, force = _blocks(page, "python")
    (tmp_path / "my_effects.py").write_text(source)
    (tmp_path / "force.py").write_text(force)
    (tmp_path / "out").mkdir()
    _run("python force.py", tmp_path)
    told = [_run(command, tmp_path) for command in _blocks(page, "sh")[0].splitlines()]
    assert "camera_scale" in told[0]
    assert "The cause is camera_scale" in told[2]


@pytest.mark.real
def test_the_measured_fish_is_imported_and_diagnosed(fishsim: Path, tmp_path: Path) -> None:
    """The import page's commands, on the measured files; f1_25 is held out."""
    for file in fishsim.glob("markers_*.csv"):
        (tmp_path / file.name).symlink_to(file)
    imported, diagnosed = _blocks(ROOT / "docs" / "import-fishsim.md", "sh")[0].splitlines()
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
