"""``mjfish sample``, and the band of its fish in ``mjfish simulate``."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow.csv
import pytest
from command_line import Run
from diagnosed import diagnosis

from mjfish.data import read_table
from mjfish.fish import shipped
from mjfish.model import extended


@pytest.fixture
def diagnosed(tmp_path: Path) -> Path:
    """A folder with the diagnosis of a fish whose servos lag."""
    folder = tmp_path / "found"
    folder.mkdir()
    diagnosis("named").save(folder / "diagnosis.json")
    return folder


def test_the_fish_of_a_diagnosis_have_its_cause_and_swim_in_a_band(run: Run, tmp_path: Path, diagnosed: Path) -> None:
    """The extended fish itself lies inside; the log has the curves of the band."""
    shown = run("sample found --n 12 --seed 4 --out draws").stdout
    assert "wrote 12 fish to draws" in shown
    files = sorted((tmp_path / "draws").iterdir())
    assert [file.name for file in files] == [f"draw_{k:03d}.toml" for k in range(1, 13)]
    lags = [extended.load(file).values["servo_lag.time_constant"] for file in files]
    assert np.std(lags) == pytest.approx(0.0003, rel=0.5)
    assert np.mean(lags) == pytest.approx(0.0201, abs=0.0004)
    assert files[0].read_text(encoding="utf-8").startswith("# Drawn by mjfish sample from found, 12 draws, seed 4.\n")
    run("simulate --mode v3 --set servo_lag.time_constant=0.0201 --duration 2 --out a")
    shown = run("simulate --fish draws/draw_001.toml --draws draws --mode v3 --duration 2 --out b").stdout
    assert "5 / 50 / 95 % of 12 draws: mean surge of the second half " in shown
    assert "wrote b/rollout.csv, b/band.csv and b/rollout.rrd" in shown
    band = pyarrow.csv.read_csv(tmp_path / "b" / "band.csv")
    surge = read_table(tmp_path / "a" / "rollout.csv")["surge"][100:]
    low, high = (band[f"surge_{level} [m/s]"].to_numpy()[100:] for level in (5, 95))
    assert np.mean((low <= surge) & (surge <= high)) > 0.8
    assert not (tmp_path / "a" / "band.csv").exists()
    assert b"draws_95" in (tmp_path / "b" / "rollout.rrd").read_bytes()


def test_an_identification_is_sampled_too(run: Run, tmp_path: Path) -> None:
    run("generate --modes v1,v3,v5 --duration 3 --out pool")
    run("identify pool --starts 1 --jobs 1 --json found.json")
    saved = json.loads((tmp_path / "found.json").read_text(encoding="utf-8"))["posterior"]
    assert saved["effects"] == []
    assert np.shape(saved["covariance"]) == (9, 9)
    run("sample found.json --n 3 --out draws")
    values = [extended.load(tmp_path / "draws" / f"draw_00{k}.toml").values for k in (1, 2, 3)]
    assert values[0] != values[1] != values[2]


def test_draws_that_diverge_are_counted_and_exit_with_1(run: Run, tmp_path: Path) -> None:
    text = shipped()["pike"].read_text(encoding="utf-8")
    (tmp_path / "draws").mkdir()
    (tmp_path / "draws" / "a.toml").write_text(text, encoding="utf-8")
    wild = text.replace("beta = 60.0", "beta = 6000.0")
    (tmp_path / "draws" / "b.toml").write_text(wild, encoding="utf-8")
    result = run("simulate --draws draws --duration 1 --out out", exit_code=1)
    assert "diverged: 1 of 2 draws, which the band leaves out" in result.stderr
    assert "5 / 50 / 95 % of 1 draws" in result.stdout
    assert (tmp_path / "out" / "band.csv").is_file()


@pytest.mark.parametrize(
    ("line", "complaint"),
    [
        ("sample absent.json --out a", "absent.json: no such file; write it by 'mjfish diagnose DATASET --json FILE'"),
        ("sample found --out found", "found: is not empty, expected a new folder; choose another"),
        ("sample found --n 0 --out a", "Invalid value for '--n': "),
        ("simulate --draws absent --out a", "--draws: no fish TOML in absent; write some by 'mjfish sample DIAGNOSIS"),
    ],
)
def test_what_cannot_be_is_refused(refuse: Callable[[str], str], diagnosed: Path, line: str, complaint: str) -> None:
    assert diagnosed.is_dir()
    assert complaint in refuse(line)
