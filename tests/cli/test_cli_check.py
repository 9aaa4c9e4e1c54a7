"""``mjfish check``, on runs shorter than a user's."""

from __future__ import annotations

import functools
import json
from collections.abc import Callable
from pathlib import Path

import pytest
from command_line import Run

from mjfish import fish as fishes
from mjfish import simulation as crosscheck
from mjfish.cli import console


@pytest.fixture
def short(monkeypatch: pytest.MonkeyPatch) -> None:
    """Cross-checks last one second, at two steps."""
    monkeypatch.setattr(crosscheck, "check", functools.partial(crosscheck.check, duration=1.0, halvings=1))


@pytest.mark.usefixtures("short")
def test_engines_that_agree_exit_with_0_and_say_by_how_much(run: Run, tmp_path: Path) -> None:
    shown = run("check --mode v1 --mode v3 --json out.json").stdout
    told = json.loads((tmp_path / "out.json").read_text(encoding="utf-8"))
    assert (told["schema"], told["passed"]) == (1, True)
    assert [check["drive"] for check in told["checks"]] == ["v1", "v3"]
    for check in told["checks"]:
        assert check["passed"] is True
        assert check["levels"][0]["ratio"]["surge"] < check["bound"] == 1e-3
        assert check["message"] in shown
    assert "v1: agrees" in shown
    for heading in ("step [ms]", "surge [m/s]", "sway [m/s]", "yaw_rate [rad/s]"):
        assert heading in shown


@pytest.mark.usefixtures("short")
def test_at_80_columns_no_line_is_longer_and_no_mode_or_heading_is_cut(
    run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(console.out, "_width", 80)
    lines = run("check --mode v3-t2").stdout.splitlines()
    assert all(len(line) <= 80 for line in lines)
    (headings,) = (line for line in lines if line.startswith("mode"))
    for heading in ("step [ms]", "surge [m/s]", "sway [m/s]", "yaw_rate [rad/s]", "of the bound", "order"):
        assert heading in headings
    assert sum(line.startswith("v3-t2 ") for line in lines) == 2  # a row a step


@pytest.mark.usefixtures("short")
def test_the_printed_terms_exit_with_1(run: Run, tmp_path: Path) -> None:
    shown = run("check --mode v1 --coriolis printed --json out.json", exit_code=1).stdout
    told = json.loads((tmp_path / "out.json").read_text(encoding="utf-8"))
    assert told["passed"] is False
    assert max(told["checks"][0]["levels"][0]["ratio"].values()) > 20 * told["checks"][0]["bound"]
    assert "v1: disagrees" in shown


@pytest.mark.usefixtures("short")
def test_a_run_that_diverges_exits_with_1_and_its_json_is_valid(run: Run, tmp_path: Path) -> None:
    """A range that nobody reached is null, for JSON has no NaN."""
    text = fishes.shipped()["pike"].read_text(encoding="utf-8")
    assert "beta = 60.0" in text
    wild = text.replace("beta = 60.0", "beta = 600.0")
    (tmp_path / "wild.toml").write_text(wild, encoding="utf-8")
    shown = run("check --fish wild.toml --mode v1 --json out.json", exit_code=1).stdout
    assert "v1: diverged" in shown

    def refuse(constant: str) -> float:
        raise AssertionError(constant)

    told = json.loads((tmp_path / "out.json").read_text(encoding="utf-8"), parse_constant=refuse)
    assert told["checks"][0]["status"] == "diverged"


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        ("--mode v1 --mode v2", "unknown mode 'v2'; known: v1, "),
        ("--fish carp", "unknown fish 'carp'; known: "),
        ("--fish eth_tendon", "fish 'eth_tendon' has no CPG to drive it; add [cpg]"),
        ("--coriolis wrong", "'wrong' is not one of 'corrected', 'printed'"),
        ("--json absent/out.json", "absent/out.json: there is no folder absent; make it, or choose another"),
        ("--json .", ".: is a folder, expected the name of a file; add one"),
    ],
)
def test_bad_input_is_refused_before_any_engine_runs(
    refuse: Callable[[str], str], monkeypatch: pytest.MonkeyPatch, options: str, complaint: str
) -> None:
    monkeypatch.setattr(crosscheck.cross_check, "simulate", None)
    assert complaint in refuse(f"check {options}").replace("│ ", "")
