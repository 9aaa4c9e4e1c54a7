"""What is written as TOML is read back by the standard library."""

from __future__ import annotations

import tomllib
from typing import Any

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from mjfish.files import tomlfile

text = st.text(st.characters(exclude_categories=["Cs"]))
numbers = st.integers(-(2**63), 2**63 - 1) | st.floats(allow_nan=False) | st.booleans()
plain = text | numbers | st.lists(text | numbers, max_size=3)


def tables(children: st.SearchStrategy[Any]) -> st.SearchStrategy[Any]:
    table = st.dictionaries(text, children, max_size=4)
    return table | st.lists(table, min_size=1, max_size=3)


@given(st.dictionaries(text, st.recursive(plain, tables, max_leaves=12), max_size=5))
@settings(max_examples=60, deadline=None)
def test_reading_gives_back_every_table(table: dict[str, Any]) -> None:
    assert tomllib.loads(tomlfile.text(table)) == table


def test_nothing_is_written_for_none_and_numbers_keep_their_type_and_sign() -> None:
    written = tomlfile.text({"a": None, "b": -0.0, "c": 1, "d": 1.0, "e": True, "f": 1e22, "g": {"h": None}})
    assert written == "b = -0.0\nc = 1\nd = 1.0\ne = true\nf = 1e+22\n\n[g]\n"


def test_layout_is_the_one_a_person_would_write() -> None:
    table = {"a": {"b.c": {"low": 0.1}}, "t": [{"name": "x", "drive": [{"start": 0.0, "bias": [0, 1]}]}]}
    assert tomlfile.text(table) == (
        '[a]\n"b.c" = {low = 0.1}\n\n[[t]]\nname = "x"\n\n[[t.drive]]\nstart = 0.0\nbias = [0, 1]\n'
    )


def test_numbers_of_numpy_are_numbers() -> None:
    """Their own text names their type."""
    assert tomlfile.text({"a": np.float64(0.1), "b": [np.float64(1e-7)]}) == "a = 0.1\nb = [1e-07]\n"
