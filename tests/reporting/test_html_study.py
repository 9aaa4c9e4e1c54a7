"""The page of a study: outcomes and right answers by dataset and setting, estimates beside the truth."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from browser import look

from mjfish.reporting.html import study
from mjfish.study import Collected


def _row(dataset: str, seed: int, estimate: float, **more: Any) -> dict[str, Any]:
    """Return a row with an interval of 0.1 to each side and a true value of 1."""
    row = {"dataset": dataset, "setting": "drag", "seed": seed, "outcome": "converged", "right": None}
    return {**row, "c": estimate, "c low": estimate - 0.1, "c high": estimate + 0.1, "c true": 1.0, **more}


ROWS = (
    _row("pool <b>", 1, 1.05),
    _row("pool <b>", 2, 1.30),
    _row("tank", 1, 0.95, **{"c low": None, "c high": None}),
    {"dataset": "tank", "setting": "drag", "seed": 2, "outcome": "failed", "right": None},
)


@pytest.fixture
def figures(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """The sections of the page of these rows, by title."""
    found: dict[str, Any] = {}
    monkeypatch.setattr(
        study, "write_figures", lambda _, *sections, **__: found.update({one.title: one for one in sections})
    )
    study.write_study(Collected(ROWS, {"c": "m/s"}, "4 of 4 pieces are done.\n", 0, ()), Path("unused"))
    return found


def test_outcomes_are_counted_by_dataset_and_setting(figures: dict[str, Any]) -> None:
    (block,) = figures["What came of the pieces"].blocks
    assert {bars.name: list(bars.x) for bars in block.figure.data} == {"converged": [2, 1], "failed": [0, 1]}
    assert list(block.figure.layout.yaxis.ticktext) == ["pool &lt;b&gt;, drag", "tank, drag"]


def test_intervals_that_miss_the_truth_stand_out(figures: dict[str, Any]) -> None:
    """An estimate without an interval is drawn, and counts neither way; a failed piece is not drawn."""
    (block,) = figures["Estimates"].blocks
    *truths, inside, missed = block.figure.data
    assert [list(truth.x) for truth in truths] == [[1.0, 1.0], [1.0, 1.0]]
    assert (list(inside.x), list(missed.x)) == ([1.05, 0.95], [1.30])
    assert list(inside.error_x.array) == pytest.approx([0.1, 0.0])
    assert inside.marker.color != missed.marker.color
    assert block.remark == "the true value is in 1 of 2 intervals"


@pytest.mark.slow
def test_a_browser_draws_every_figure(tmp_path: Path) -> None:
    rows = (*ROWS, _row("tank", 3, 1.0, outcome="named", right="yes"))
    study.write_study(Collected(rows, {"c": "-"}, "4 of 4 pieces are done.\n", 0, ()), tmp_path / "study.html")
    for width in (1200, 360):
        seen = look((tmp_path / "study.html").read_text(encoding="utf-8"), width)
        assert (seen.complaints, seen.wide) == ([], [])
        assert seen.drawn >= 3
