"""``mjfish compare``: from files to numbers and an exit code."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow.csv
import pytest
from command_line import Run

import mjfish
from mjfish.data import save
from mjfish.fish import load_fish
from mjfish.numerics.formats import number
from mjfish.simulation.synthetic import generate


@pytest.fixture
def pool(tmp_path: Path) -> Path:
    """A small dataset in the working folder."""
    noise = np.array([0.01, 0.01, 0.05])
    save(generate(load_fish("pike"), ["v1", "v3"], noise=noise, duration=4.2, name="pool [/]"), tmp_path / "pool")
    return tmp_path / "pool"


@pytest.fixture
def rollouts(run: Run, pool: Path, tmp_path: Path) -> Path:
    """What `mjfish simulate` writes for both trials."""
    assert pool.is_dir()
    for mode in ("v1", "v3"):
        run(f"simulate --mode {mode} --duration 4.2 --out sim/{mode}")
    return tmp_path / "sim"


@pytest.mark.usefixtures("rollouts")
def test_rollouts_of_simulate_are_compared_shown_and_written(run: Run, tmp_path: Path) -> None:
    """The right fish leaves the noise, and no shift."""
    shown = run("compare pool --against sim --json out.json --table out.csv --bound 0.05").stdout
    assert "pool [/]: rollouts against measurements" in shown
    assert "fit [%]" in shown
    assert "shift [ms]: what is measured at t" in shown
    told = json.loads((tmp_path / "out.json").read_text(encoding="utf-8"))
    assert told["passed"] is True
    assert [one["status"] for one in told["trials"]] == ["covered", "covered"]
    scores = [score for one in told["trials"] for score in one["scores"] if score["part"] == "whole"]
    np.testing.assert_allclose([score["rmse"] for score in scores], [0.01, 0.01, 0.05] * 2, rtol=0.15)
    for score in scores:
        for key in ("rmse", "nrmse", "fit"):
            assert f" {number(score[key])} " in shown
    for one in told["trials"]:
        assert abs(one["shifts"]["all"]["time"]) < 1e-3
    table = pyarrow.csv.read_csv(tmp_path / "out.csv").to_pylist()
    assert [row["rmse"] for row in table if row["part"] == "whole"] == [score["rmse"] for score in scores]


def test_a_bound_that_is_passed_or_a_trial_left_out_exits_with_1(run: Run, rollouts: Path, tmp_path: Path) -> None:
    told = run("compare pool --against sim --bound 0.001 --json out.json", exit_code=1)
    assert "not good: v1: nRMSE 0.0" in told.stderr
    assert "is beyond the bound 0.001" in told.stderr
    assert json.loads((tmp_path / "out.json").read_text(encoding="utf-8"))["passed"] is False
    (rollouts / "v3" / "rollout.csv").unlink()
    told = run("compare pool --against sim", exit_code=1)
    assert "not good: v3: no rollout; expected a file v3.csv" in told.stderr
    assert "absent" in told.stdout
    run("simulate --mode v3 --duration 2 --out sim/v3")
    assert "and does not cover" in run("compare pool --against sim", exit_code=1).stderr


def test_files_may_be_named_one_by_one(run: Run, rollouts: Path) -> None:
    """And what is said is the same; a table of no trial in a folder is told."""
    whole = run("compare pool --against sim").stdout
    assert run("compare pool --against sim/v1 --against sim/v3/rollout.csv").stdout == whole
    (rollouts / "notes.csv").write_text("x", encoding="utf-8")
    assert "named as no trial, and left alone: sim/notes.csv" in run("compare pool --against sim").stdout


@pytest.mark.usefixtures("pool")
def test_misuse_is_refused_and_nothing_written(refuse: Callable[[str], str], tmp_path: Path) -> None:
    (tmp_path / "v1.csv").write_text("time [s],surge [m/s]\n0,1\n0,2\n", encoding="utf-8")
    assert "Missing option '--against'" in refuse("compare pool")
    assert "absent: no such file or folder" in refuse("compare pool --against absent")
    assert "v1.csv: row 2 (line 3), column 'time [s]': 0 s repeats" in refuse("compare pool --against v1.csv")
    assert "is the measurement of the trial" in refuse("compare pool --against pool")
    assert "expected a finite nRMSE above 0" in refuse("compare pool --against v1.csv --bound 0")
    assert "absent: no such file" in refuse("compare absent --against v1.csv")


@pytest.mark.usefixtures("pool")
@pytest.mark.parametrize("option", ["--json absent/out.json", "--table absent/out.csv", "--table out.xlsx"])
def test_a_result_that_cannot_be_written_is_refused_before_the_work(
    refuse: Callable[[str], str], monkeypatch: pytest.MonkeyPatch, option: str
) -> None:
    monkeypatch.setattr(mjfish, "compare", None)
    told = refuse(f"compare pool --against pool {option}")
    assert "there is no folder absent" in told or "expected .csv or .parquet" in told
