"""``mjfish compare --paper``: what is shown, written and refused."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pyarrow.csv
import pytest
from command_line import Run

from mjfish.cli import paper
from mjfish.comparison.paper import study
from mjfish.comparison.paper.reasons import UNIT, Reason, noise_parameters


def test_lambda_star_alone_is_shown_and_written(run: Run, tmp_path: Path) -> None:
    shown = run("compare --paper --no-fit --json out.json --table out.csv").stdout
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
    whole = paper.compare_paper
    monkeypatch.setattr(paper, "compare_paper", lambda fish, **rest: whole(fish, names=("v1",), **rest))
    shown = run("compare --paper --json out.json --table out.csv --seed 3 --jobs 1").stdout
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
        ("compare", "Missing argument 'DATASET'; give it, or --paper"),
        ("compare pool", "Missing option '--against'"),
        ("compare pool --paper", "DATASET: found with --paper"),
        ("compare --paper --against sim", "--against: found with --paper"),
        ("compare --paper --bound 0.1", "--bound: found with --paper"),
        ("compare pool --against sim --no-fit", "--fit: found without --paper"),
        ("compare pool --against sim --seed 0", "--seed: found without --paper"),
        ("compare --paper --fish trout", "unknown fish 'trout'"),
        ("compare --paper --fish eth_tendon", "expected a fish with a [cpg] of four joints"),
        ("compare --paper --json absent/out.json", "there is no folder absent"),
        ("compare --paper --table out.xlsx", "expected .csv or .parquet"),
    ],
)
def test_misuse_is_refused(refuse: Callable[[str], str], line: str, told: str) -> None:
    assert told in refuse(line)
