"""The section of a report that says how firmly the verdict is held, and its figure."""

from __future__ import annotations

import re
from pathlib import Path

from diagnosed import diagnosis, splits

from mjfish import reporting
from mjfish.reporting.html.diagnosis import render_diagnosis


def _cells(html: str) -> list[list[str]]:
    section = html[html.index("<h2>How firmly the verdict is held</h2>") :]
    section = section[: section.index("</section>")].replace("\N{NO-BREAK SPACE}", " ")
    rows = re.findall(r"<tr>(.*?)</tr>", section, re.DOTALL)
    found = [
        re.findall(r"<t[dh].*?>(.*?)</t[dh]>", row, re.DOTALL) for row in rows if "<td>" in row or 'scope="row"' in row
    ]
    return [[" ".join(re.sub(r"<.*?>", "", cell).split()) for cell in row] for row in found if row]


def test_the_section_has_a_row_a_mechanism_and_a_row_a_split() -> None:
    """In the words of the terminal; what came from a user is escaped."""
    html = render_diagnosis(diagnosis(), splits())
    assert _cells(html) == [
        ["The fish rolls roll", "", "1 of 2", "0", "1", "0"],
        ["The joints follow their command late servo_dynamics", "", "1 of 2", "1", "0", "0"],
        ["The water moves current", "", "0 of 2", "0", "0", "1"],
        ["a as divided", "b, c", "named", "servo_dynamics (form), roll", "61.8 % less (57.0 % to 66.0 %)"],
        ["b", "a, c", "cannot tell", "certain: roll; not named: current", "2.00 % more (57.0 % to 66.0 %)"],
        ["&lt;c&gt;", "a, b", "–", "not diagnosed: too &lt;few&gt; numbers", "–"],
    ]
    assert "Possible splits: 20." in html


def test_without_splits_there_is_no_section(tmp_path: Path) -> None:
    diagnosis().report(tmp_path / "plain.html")
    assert "How firmly the verdict is held" not in (tmp_path / "plain.html").read_text(encoding="utf-8")
    splits().report(tmp_path / "splits.html")
    assert "How firmly the verdict is held" in (tmp_path / "splits.html").read_text(encoding="utf-8")


def test_the_figure_stacks_what_is_named_on_what_is_not() -> None:
    named, certain, rest = reporting.figure(splits()).data
    assert list(named.y) == ["current", "servo_dynamics", "roll"]  # the first on top
    assert [list(bars.x) for bars in (named, certain, rest)] == [[0, 1, 1], [0, 0, 1], [1, 0, 0]]
    assert reporting.figure(splits()).layout.barmode == "stack"
