"""The page on Table IV: its command runs, and prints the numbers that are there."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path

import pytest
from doc_blocks import ROOT, blocks
from typer.testing import CliRunner, Result

from studies import console
from studies.table_iv.__main__ import app

PAGE = ROOT / "docs" / "table-iv.md"


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Callable[[str], Result]:
    """Run a line of the page."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(console.out, "_width", 140)
    (tmp_path / "out").mkdir()

    def line(text: str) -> Result:
        python, option, study, *arguments = text.split()
        assert (python, option, study) == ("python", "-m", "studies.table_iv")
        result = CliRunner().invoke(app, arguments)
        assert result.exit_code == 0, result.output
        return result

    return line


def _rows(text: str) -> list[list[str]]:
    return [line.split() for line in text.splitlines() if re.search(r"\d\.\d{3}", line)]


def test_ranges_of_lambda_star_are_those_of_the_page(run: Callable[[str], Result]) -> None:
    (command,) = blocks(PAGE, "sh")
    printed = _rows(run(command).stdout)
    written = _rows(blocks(PAGE, "text")[1])
    assert len(written) == 30
    for told, page in zip(printed, written, strict=False):
        columns = len(told) - 1  # all but the steady range; the page goes on with what was fitted
        assert told[:columns] == page[:columns]
    first = blocks(PAGE, "text")[3].splitlines()[0]
    assert first in run(command).stdout


@pytest.mark.slow
def test_fits_and_reasons_are_those_of_the_page(run: Callable[[str], Result], tmp_path: Path) -> None:
    run(blocks(PAGE, "text")[0].strip())
    told = json.loads((tmp_path / "out" / "table-iv.json").read_text(encoding="utf-8"))
    written = {row[0]: row for row in _rows(blocks(PAGE, "text")[2])}
    for reason in told["reasons"]:
        page = [float(number) for number in re.findall(r"(\d\.\d{3}) \(", " ".join(written[reason["reason"]]))]
        fits = [reason[key] for key in ("alone", "with_coefficients", "with_coefficients_and_unit")]
        assert page == pytest.approx([fit["misfit"] for fit in fits if fit is not None], abs=0.004)
    said = "\n".join(told["says"])
    assert "Most likely reason: the unit of beta psi" in said
    assert "Units from 0.03 to 0.08 deg fit about as well" in said
    assert "28 of 30 simulated ranges" in said
