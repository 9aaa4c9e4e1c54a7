"""The numbers in docs/theory.md are those that the code gives."""

from __future__ import annotations

import re
from collections.abc import Callable

import pytest

import proof
from proofs import tables
from proofs.tables import Table

#: Numbers that rounding makes; any machine's are as good.
_ROUNDING = 1e-10
_NUMBER = re.compile(r"(?<![\w.])\d+(?:\.\d+)?(?:e[+-]?\d+)?(?![\w.])")


@pytest.fixture(scope="module")
def written() -> list[Table]:
    """The tables as they stand in the docs."""
    found = []
    for block in re.split(r"\n\n(?!\|)", proof.section(proof.PAGE.read_text(encoding="utf-8"))):
        title, _, rest = block.partition("\n\n")
        head, _, *rows = (tuple(cell.strip() for cell in line.strip("|").split("|")) for line in rest.splitlines())
        found.append(Table(title, head, tuple(rows)))
    return found


def _same(told: str, measured: str) -> bool:
    """Return whether two cells say the same, numbers to what another machine may make of them."""
    if _NUMBER.sub("#", told) != _NUMBER.sub("#", measured):
        return False
    for a, b in zip(map(float, _NUMBER.findall(told)), map(float, _NUMBER.findall(measured)), strict=True):
        near = abs(a - b) <= 0.05 * max(a, b) if max(a, b) > 1e-6 else max(a, b) <= 10.0 * min(a, b)
        if not near and max(a, b) > _ROUNDING:
            return False
    return True


def test_every_table_is_in_the_docs_in_the_tools_own_format(written: list[Table]) -> None:
    """Catches an edit by hand, and a table that was added without running the tool."""
    assert len(written) == len(tables.TABLES)
    page = proof.section(proof.PAGE.read_text(encoding="utf-8"))
    assert "\n\n".join(table.markdown() for table in written) == page
    assert all(len(row) == len(table.head) for table in written for row in table.rows)


CHEAP = (
    tables.push_table,
    tables.derivation_table,
    tables.constraint_table,
    tables.refused_table,
    tables.symmetry_table,
    tables.inverse_table,
)


@pytest.mark.parametrize("make", CHEAP)
def test_cheap_numbers_in_the_docs_are_those_of_the_code(make: Callable[[], Table], written: list[Table]) -> None:
    _compare(make(), written)


@pytest.mark.slow
@pytest.mark.parametrize("make", [table for table in tables.TABLES if table not in CHEAP])
def test_all_other_numbers_in_the_docs_are_those_of_the_code(make: Callable[[], Table], written: list[Table]) -> None:
    _compare(make(), written)


def _compare(measured: Table, written: list[Table]) -> None:
    told = next(table for table in written if table.title == measured.title)
    assert told.head == measured.head
    assert len(told.rows) == len(measured.rows)
    for ours, theirs in zip(measured.rows, told.rows, strict=True):
        assert all(map(_same, theirs, ours)), f"docs {theirs}, code {ours}; run tools/proof.py"


def test_a_wrong_number_is_seen() -> None:
    """Catches a comparison that lets everything pass."""
    assert _same("diverged at step 6", "diverged at step 6")
    assert not _same("diverged at step 6", "diverged at step 9")
    assert not _same("error 6", "diverged at step 6")
    assert _same("3e-15", "2e-13")
    assert not _same("3e-15", "2e-09")
    assert not _same("4e-07", "9e-06")
    assert not _same("0.73", "0.58")


def test_the_page_must_have_both_markers() -> None:
    page = proof.PAGE.read_text(encoding="utf-8")
    with pytest.raises(SystemExit, match="expected the lines"):
        proof.section(page.replace(proof.END, ""))
