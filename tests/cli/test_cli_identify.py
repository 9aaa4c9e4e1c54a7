"""``mjfish identify`` and the refusals of ``mjfish diagnose``."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from command_line import Run
from pike_coefficients import COEFFICIENTS
from schema_check import complaints

import mjfish
from mjfish.cli import console
from mjfish.data import save
from mjfish.fish import load_fish
from mjfish.numerics.formats import number
from mjfish.simulation.synthetic import generate

TRUTH = dict(zip(COEFFICIENTS, (0.5, 0.6, 0.4, 1.5, 1.2, 1.6, 0.01, 0.008, 0.012), strict=True))


@pytest.fixture
def pool(tmp_path: Path) -> Path:
    """A small dataset in the working folder."""
    sigma = np.array([0.01, 0.01, 0.05])
    dataset = generate(
        load_fish("pike"), ["v1", "v5", "v3"], values=TRUTH, noise=sigma, duration=2.0, seed=3, held_out=["v3"],
        name="pool [/]",
    )  # fmt: skip
    save(dataset, tmp_path / "pool")
    return tmp_path / "pool"


def _edit(pool: Path, old: str, new: str, file: str = "dataset.toml") -> None:
    text = (pool / file).read_text(encoding="utf-8")
    assert old in text
    (pool / file).write_text(text.replace(old, new, 1), encoding="utf-8")


def test_estimates_are_shown_and_written(run: Run, pool: Path, tmp_path: Path) -> None:
    """The folder or its dataset.toml; brackets in the name of the dataset are no markup."""
    shown = run("identify pool --json out.json --jobs 1 --starts 2").stdout
    assert "pool [/]: estimates with 95 % intervals" in shown
    told = json.loads((tmp_path / "out.json").read_text(encoding="utf-8"))
    assert told["status"] == "converged"
    assert told["dataset"] == "pool [/]"
    assert list(told["parameters"]) == list(COEFFICIENTS)
    for name, entry in told["parameters"].items():
        assert f"{name} " in shown
        assert f" {number(entry['estimate'], 4)} " in shown
        assert abs(entry["estimate"] - TRUTH[name]) < 4.0 * (entry["standard_error"] or np.inf)
    assert [score["role"] for score in told["scores"]] == ["fit", "fit", "held_out"]
    assert "held_out" in shown
    again = run("identify pool/dataset.toml --jobs 1 --starts 2").stdout
    assert again == shown.replace("wrote out.json\n", "")


def test_at_80_columns_no_line_is_longer_and_no_number_is_broken(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Names of runs may be long, and numbers of a run are many: the name of the run stands above."""
    monkeypatch.setattr(console.out, "_width", 80)
    dataset = generate(load_fish("pike"), ["v1", "v3", "v7"], noise=np.array([0.01, 0.01, 0.05]), duration=2.0)
    names = ("straight_2026-01-31", "swim_fast", "turn")
    renamed = tuple(replace(trial, name=name) for trial, name in zip(dataset.trials, names, strict=True))
    save(replace(dataset, clock="free", trials=renamed), tmp_path / "pool")
    shown = run("identify pool --starts 1 --json out.json").stdout
    lines = shown.splitlines()
    assert all(len(line) <= 80 for line in lines)
    at = lines.index(next(line for line in lines if line.startswith("straight_2026-01-31:")))
    assert lines[at + 1].startswith("clock.offset")
    for entry in json.loads((tmp_path / "out.json").read_text(encoding="utf-8"))["parameters"].values():
        assert f" {number(entry['estimate'], 4)} " in shown


def test_everything_that_can_be_written_is(run: Run, pool: Path, tmp_path: Path) -> None:
    """Profile, table, figures and the fish, which is read again and swims with the estimates."""
    shown = run(
        "identify pool --starts 1 --fix c_f.* --fix c_m.head=0.4 --bounds c_d.head=0.5:3 --start c_d.head=1 "
        "--profile c_d.tail --json out.json --table out.parquet --figures figures --fish mine.toml"
    ).stdout
    told = json.loads((tmp_path / "out.json").read_text(encoding="utf-8"))
    assert not complaints("identification-3", told)
    assert [one["name"] for one in told["profiles"]] == ["c_d.tail"]
    assert "profile of c_d.tail" in shown
    assert set(told["parameters"]) == {"c_m.body", "c_m.tail", "c_d.head", "c_d.body", "c_d.tail"}
    assert {path.name for path in (tmp_path / "figures").iterdir()} == {
        "simulated.html", "autocorrelation.html", "cross_correlation.html", "profiles.html",
    }  # fmt: skip
    mine = load_fish(tmp_path / "mine.toml")
    assert mine.values["c_d.tail"] == told["parameters"]["c_d.tail"]["estimate"]
    assert mine.values["c_m.head"] == 0.4
    known = told["assessment"]["intervals"]["parameters"]["c_d.tail"]
    assert mine.identified is not None
    assert mine.identified.intervals["c_d.tail"] == (known["low"], known["high"]), "of the table, not the plain error"
    assert "c_m.head" not in mine.identified.intervals
    np.testing.assert_allclose(mine.identified.range["beat"], (2.865, 4.138), atol=1e-3)
    assert (tmp_path / "out.parquet").stat().st_size > 0
    for part in ("intervals", "agreement", "residual_tests", "criteria", "stability"):
        assert told["assessment"][part]


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        ("--fix c_x", "unknown parameter of fix 'c_x'; known: c_d.body"),
        ("--free nothing", "unknown parameter of free 'nothing'"),
        ("--bounds c_d.head=3", "--bounds: found 'c_d.head=3', expected NAME=LOW:HIGH"),
        ("--bounds c_d.head=a:3", "--bounds c_d.head: found 'a', expected a number"),
        ("--start c_d.head=9", "c_d.head: start 9 - is outside its bounds"),
        ("--loss square", "unknown loss 'square'"),
        ("--weights mine", "unknown weights 'mine'"),
        ("--profile c_x", "unknown free parameter of --profile 'c_x'"),
        ("--fix c_d.head --profile c_d.head", "unknown free parameter of --profile 'c_d.head'"),
        ("--fish mine.yaml", "ends in '.yaml', expected .xml or .toml"),
        ("--table out.txt", "ends in '.txt', expected .csv or .parquet"),
        ("--fix *", "every parameter is fixed; leave one free"),
    ],
)
def test_settings_that_cannot_be_meant_are_refused_before_the_fit(
    refuse: Callable[[str], str], pool: Path, options: str, complaint: str
) -> None:
    assert complaint in refuse(f"identify pool {options}")


def test_an_estimate_at_its_bound_is_marked(run: Run, pool: Path, tmp_path: Path) -> None:
    _edit(pool, "[[trials]]", "[start]\nc_d.head = { start = 1.0, high = 1.2 }\n\n[[trials]]")
    shown = run("identify pool --json out.json --jobs 1 --starts 2").stdout
    entry = json.loads((tmp_path / "out.json").read_text(encoding="utf-8"))["parameters"]["c_d.head"]
    assert (entry["estimate"], entry["at_bound"]) == (1.2, True)
    assert 0.0 < entry["standard_error"] < 0.1  # were the bound not there
    assert re.search(r"^at its bound: c_d\.head", shown, re.MULTILINE)


def test_a_fit_that_diverges_exits_with_1_and_says_when_and_with_what(run: Run, pool: Path, tmp_path: Path) -> None:
    _edit(pool, "[[trials]]", "[start]\nc_d.tail = { start = 1e8, low = 1e7, high = 1e9 }\n\n[[trials]]")
    result = run("identify pool --json out.json --jobs 1 --starts 2", exit_code=1)
    assert "diverged: v1 diverged at 0." in result.stderr
    assert "c_d.tail = 1e+08" in result.stderr
    told = json.loads((tmp_path / "out.json").read_text(encoding="utf-8"))
    assert told["status"] == "diverged"
    assert told["scores"][0]["nrmse"] == [None, None, None]


BROKEN = {
    "wrong unit": ("v1.csv", "surge [m/s]", "surge [cm/s]", "unit [cm/s], expected [m/s]; convert the values"),
    "missing column": ("v1.csv", "time [s]", "roll [rad]", "column 'time [s]' is missing"),
    "text": ("v1.csv", "\n0.02,", "\nsoon,", "row 2 (line 3)"),
    "repeated time": ("v1.csv", "\n0.04,", "\n0.02,", "row 3 (line 4), column 'time [s]': 0.02 s repeats"),
    "gap": ("v1.csv", "\n0.04,", "\n0.0200001,", "row 4 (line 5): a gap of"),
    "nan": ("v1.csv", "\n0.04,", "\nnan,", "expected a finite number"),
    "key": ("dataset.toml", "schema = 1", "schema = 1\ncolour = 2", "dataset.toml: colour: unknown key"),
    "fish": ("dataset.toml", '"pike"', '"carp"', "dataset.toml: fish: unknown fish 'carp'; known: eth_tendon, "),
    "file": ("dataset.toml", '"v1.csv"', '"v2.csv"', "v2.csv: no such file"),
    "start": ("dataset.toml", "[[trials]]", "[start]\nc_d.fin = 1.0\n\n[[trials]]", "unknown coefficient 'c_d.fin'"),
}  # fmt: skip


@pytest.mark.parametrize("command", ["identify pool", "diagnose pool"])
@pytest.mark.parametrize(("file", "old", "new", "complaint"), BROKEN.values(), ids=BROKEN)
def test_a_broken_dataset_is_refused_by_place(
    refuse: Callable[[str], str], pool: Path, command: str, file: str, old: str, new: str, complaint: str
) -> None:
    _edit(pool, old, new, file)
    assert complaint in refuse(f"{command} --json out.json")


@pytest.mark.parametrize("command", ["identify", "diagnose"])
def test_a_folder_without_dataset_is_refused(refuse: Callable[[str], str], tmp_path: Path, command: str) -> None:
    (tmp_path / "empty").mkdir()
    assert "empty: has no dataset.toml, expected the folder of a dataset" in refuse(f"{command} empty")
    assert "absent" in refuse(f"{command} absent")


@pytest.mark.parametrize(
    "option", ["identify pool --json", "diagnose pool --json", "diagnose pool --report", "diagnose pool --rrd"]
)
@pytest.mark.parametrize("target", ["absent/out", "pool", "pool/v1.csv/out"])
def test_a_result_that_cannot_be_written_is_refused_before_the_work(
    refuse: Callable[[str], str], pool: Path, monkeypatch: pytest.MonkeyPatch, option: str, target: str
) -> None:
    monkeypatch.setattr(mjfish, "identify", None)
    monkeypatch.setattr(mjfish, "diagnose", None)
    assert pool.is_dir()
    assert target.partition("/")[0] in refuse(f"{option} {target}")


def test_other_misuse_of_diagnose_is_refused_before_the_work(
    refuse: Callable[[str], str], pool: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mjfish, "diagnose", None)
    assert pool.is_dir()
    assert "absent.py: no such file of effects" in refuse("diagnose pool --effects absent.py")
    assert "Invalid value for '--seed'" in refuse("diagnose pool --seed -1")
    assert "Invalid value for '--jobs'" in refuse("diagnose pool --jobs 0")


def test_demo_refuses_an_output_that_is_a_file_before_the_work(
    refuse: Callable[[str], str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mjfish, "diagnose", None)
    (tmp_path / "file").write_text("x", encoding="utf-8")
    assert "file: is a file, expected a folder" in refuse("demo --out file/demo")
