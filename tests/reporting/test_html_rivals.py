"""Rivals side by side: a column a set of causes, with its numbers, and which of them the figures show."""

from __future__ import annotations

from dataclasses import replace

import pytest
from diagnosed import diagnosis, page, row
from html_tree import Element, tree

from mjfish.diagnosis import Diagnosis
from mjfish.diagnosis.table import Comparison
from mjfish.reporting.html.candidates import rivals
from mjfish.reporting.html.diagnosis import render_diagnosis


def _table(found: Diagnosis) -> Element:
    (table,) = tree(render_diagnosis(found)).every("table", "rivals")
    return table


def test_every_rival_has_a_column_with_its_numbers_and_the_drawn_one_says_so() -> None:
    found = diagnosis("cannot_tell")
    table = _table(replace(found, best=("time_offset",)))
    heads = [head.text for head in next(table.every("thead")).every("th")]
    assert heads == [
        "The clocks of camera and drive are apart time_offset drawn",
        "The servos follow their command late servo_lag",
    ]
    rows = {
        next(row.every("th")).text: [cell.text for cell in row.every("td")]
        for row in next(table.every("tbody")).every("tr")
    }
    assert rows["evidence against the nominal model"] == ["640", "903"]
    assert rows["p against the best"] == ["0.40", "1.0"]
    assert rows["share of the misfit that remains"] == ["9.09 %", "9.09 %"]
    assert rows["estimates (95 %)"][1] == "time_constant 0.02010 s (0.01950 to 0.02070)"
    assert all(rows["what it leaves in the residual"])


def test_sets_of_several_causes_have_a_column_each_with_numbers_of_the_table() -> None:
    found = diagnosis("cannot_tell")
    pairs = (("servo_lag", "munk_moment"), ("servo_lag", "fin_lift"))
    known = row(("munk_moment", "servo_lag"), 990.0, 0.0, 1.0, 0.2)  # in another order
    table = replace(found.table, several=Comparison({known.names: known}))
    several = replace(found, alternatives=pairs, best=pairs[1], table=table)
    first, second = rivals(several)
    assert (first, second) == ((pairs[1], None), (pairs[0], known))
    assert "Rivals side by side" in render_diagnosis(several)


@pytest.mark.parametrize("verdict", ["named", "nothing_wrong", "unexplained"])
def test_without_rivals_there_is_no_such_section(verdict: str) -> None:
    found = diagnosis(verdict)  # type: ignore[arg-type]
    assert rivals(found) == []
    assert "Rivals side by side" not in page(verdict)  # type: ignore[arg-type]


def test_the_legend_names_the_cause_that_is_drawn() -> None:
    found = replace(diagnosis("cannot_tell"), best=("time_offset",))
    assert "extended model, with time_offset" in render_diagnosis(found)
