"""``mjfish demo``: datasets shipped and small, files written, and the learned form is the planted one."""

from __future__ import annotations

import subprocess
import sys
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_line import Run
from diagnosed import diagnosis, learned_diagnosis

import make_demo
import mjfish
from mjfish.cli.diagnose import DEMO, LEARNED
from mjfish.cli.diagnosis_text import LINES
from mjfish.data import load_dataset
from mjfish.diagnosis import Diagnosis

_ROOT = Path(__file__).parents[2]
_FILES = {"diagnosis.json", "report.html", "fish.rrd", "extended.toml"}


@pytest.fixture
def seen(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Names of the datasets that were diagnosed; the diagnosis is made by hand, learned where the demo is."""
    names: list[str] = []

    def diagnose(dataset: Any, **rest: Any) -> Diagnosis:
        del rest
        names.append(dataset.name)
        return learned_diagnosis() if dataset.name == load_dataset(LEARNED).name else diagnosis()

    monkeypatch.setattr(mjfish, "diagnose", diagnose)
    return names


def _bytes(folder: Path) -> int:
    return sum(path.stat().st_size for path in folder.iterdir() if path.is_file())


def test_each_demo_diagnoses_its_own_dataset_and_writes_to_its_own_folder(
    run: Run, tmp_path: Path, seen: list[str]
) -> None:
    run("demo")
    shown = run("demo --learned").stdout
    assert seen == [load_dataset(DEMO).name, load_dataset(LEARNED).name]
    assert seen[0] != seen[1]
    for folder, files in (("demo", _FILES), ("learned", {*_FILES, "curves"})):
        assert {path.name for path in (tmp_path / "out" / folder).iterdir()} == files
    assert "drag_law: these data do not settle its form" in shown
    assert "c_d of body: " in shown
    assert "out/learned: diagnosis.json, report.html, fish.rrd, extended.toml, curves" in shown
    assert (tmp_path / "out" / "learned" / "curves" / "drag_law-c_d-body.csv").is_file()


def test_the_folder_may_be_chosen(run: Run, tmp_path: Path, seen: list[str]) -> None:
    shown = run("demo --out here").stdout
    assert len(shown.splitlines()) <= LINES
    assert "view here/fish.rrd" in shown
    assert "curves" not in shown
    run("demo --learned --out there")
    assert seen
    assert {path.name for path in tmp_path.iterdir()} == {"here", "there"}


def test_the_second_dataset_is_no_larger_than_the_first() -> None:
    assert _bytes(LEARNED) <= _bytes(DEMO)
    assert len(load_dataset(LEARNED).trials) <= len(load_dataset(DEMO).trials)


@pytest.mark.slow
def test_the_learned_form_is_the_planted_one(run: Run, tmp_path: Path) -> None:
    """As the demo measures it, by its files."""
    shown = run("demo --learned").stdout
    assert shown.startswith("named")
    assert "drag_law: no formula fits, its form is learned" in shown
    files = sorted((tmp_path / "out" / "learned" / "curves").iterdir())
    assert [file.stem for file in files] == [
        f"drag_law-{quantity}-{group}" for quantity in ("c_d", "c_f") for group in ("body", "head", "tail")
    ]
    for file in files:
        x, _, low, high, _, visited = np.loadtxt(file, delimiter=",", skiprows=1).T
        truth = make_demo.coefficient(file.stem.removeprefix("drag_law-").replace("-", "."), x)
        held = ((low <= truth) & (truth <= high))[visited == 1.0]
        assert held.mean() > 0.85, (file.stem, held)
    assert (tmp_path / "out" / "learned" / "fish.rrd").stat().st_size > 0
    run("simulate --fish out/learned/extended.toml --out out/learned/swim")


@pytest.mark.slow
def test_the_wheel_has_both_datasets(tmp_path: Path) -> None:
    made = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--wheel-dir", str(tmp_path), str(_ROOT)]
    subprocess.run(made, check=True)
    with zipfile.ZipFile(next(tmp_path.glob("mjfish-*.whl"))) as wheel:
        names = set(wheel.namelist())
    for folder in (DEMO, LEARNED):
        files = {path.relative_to(_ROOT).as_posix() for path in folder.iterdir() if path.is_file()}
        assert len(files) > 3
        assert files <= names
