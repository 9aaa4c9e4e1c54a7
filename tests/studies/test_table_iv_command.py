"""``python -m studies.table_iv``: what is shown, written and refused."""

from __future__ import annotations

import json
import shlex
from collections.abc import Callable
from pathlib import Path

import pyarrow.csv
import pytest
from typer.testing import CliRunner, Result

from studies import console
from studies.table_iv import __main__ as command
from studies.table_iv import study
from studies.table_iv.reasons import UNIT, Reason, noise_parameters

#: Arguments and the exit code to expect in, what was printed out.
Run = Callable[..., Result]


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Run:
    """Run the study in an empty folder."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "200")
    monkeypatch.setattr(console.out, "_width", 200)

    def study_with(arguments: str, exit_code: int = 0) -> Result:
        result = CliRunner().invoke(command.app, shlex.split(arguments))
        assert result.exit_code == exit_code, result.output
        return result

    return study_with


def test_lambda_star_alone_is_shown_and_written(run: Run, tmp_path: Path) -> None:
    shown = run("--no-fit --json out.json --table out.csv").stdout
    assert "pike: ranges of the modes of Table IV" in shown
    assert "What a reason removes" not in shown
    told = json.loads((tmp_path / "out.json").read_text(encoding="utf-8"))
    assert f"misfit (rms of log ratios) {told['nominal']['misfit']:.3f}" in shown
    assert told["says"][0] in shown
    rows = pyarrow.csv.read_csv(tmp_path / "out.csv").to_pylist()
    assert [row["mode"] for row in rows[::3]][:2] == ["v1", "v3"]
    assert [row["published"] for row in rows] == [row["published"] for row in told["ranges"]]
    assert f" {rows[0]['published']:.3f} " in shown
    assert f" {rows[0]['nominal']:.3f} " in shown


def test_fits_and_reasons_are_shown_and_written(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One mode, two reasons, one start, for time; the numbers shown are those written."""
    few = (UNIT, Reason("noise", "ranges of noisy records are larger", (), noise_parameters()))
    monkeypatch.setattr(study, "reasons", lambda: few)
    monkeypatch.setattr(study, "_UNITS", (0.05,))
    monkeypatch.setattr(study, "_STARTS", 1)
    whole = command.compare_paper
    monkeypatch.setattr(command, "compare_paper", lambda fish, **rest: whole(fish, names=("v1",), **rest))
    shown = run("--json out.json --table out.csv --seed 3 --jobs 1").stdout
    told = json.loads((tmp_path / "out.json").read_text(encoding="utf-8"))
    assert "What a reason removes" in shown
    for reason in told["reasons"]:
        assert f"{reason['with_coefficients']['misfit']:.3f} (" in shown
    assert "noise.surge [m/s]" in shown
    assert f"at {told['fitted']['unit [deg]']:.4f} deg" in shown
    for row in pyarrow.csv.read_csv(tmp_path / "out.csv").to_pylist():
        assert f" {row['fitted']:.3f} " in shown


@pytest.mark.parametrize(
    ("line", "told"),
    [
        ("--fish trout", "unknown fish 'trout'"),
        ("--fish eth_tendon", "expected a fish with a [cpg] of four joints"),
        ("--json absent/out.json", "there is no folder absent"),
        ("--table out.xlsx", "expected .csv or .parquet"),
    ],
)
def test_misuse_is_refused(run: Run, tmp_path: Path, line: str, told: str) -> None:
    result = run(line, exit_code=2)
    assert told in " ".join(result.stderr.split())
    assert result.stdout == ""
    assert not list(tmp_path.iterdir())
