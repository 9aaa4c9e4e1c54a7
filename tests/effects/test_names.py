"""A cause is one file: its name occurs nowhere else in the package."""

from __future__ import annotations

import ast
import re
from functools import cache
from pathlib import Path

import pytest

import mjfish
from mjfish.effects import catalogue, find
from mjfish.effects.mechanism import MECHANISMS

PACKAGE = Path(mjfish.__file__).parent
#: Names of effects that are columns of a trial or fields of a fish, too.
FIELDS = {"roll", "munk_moment", "tail_compliance"}


@cache
def _strings() -> list[tuple[Path, str]]:
    """Return the strings of every file but docstrings, and but the command line, whose help has examples."""
    found = []
    for path in PACKAGE.rglob("*.py"):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        loose = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
        if "cli" not in path.parts:
            constants = (node for node in ast.walk(tree) if isinstance(node, ast.Constant) and id(node) not in loose)
            found += [(path, node.value) for node in constants if isinstance(node.value, str)]
    return found


@pytest.mark.parametrize("name", sorted(catalogue()))
def test_no_other_file_names_it(name: str) -> None:
    """As a string: what checks, planning and reports need to know of a cause, it declares."""
    own = PACKAGE / "effects" / f"{name}.py"
    assert own.is_file()
    # The name of a mechanism is no name of the cause: its causes declare it, and its curves are drawn.
    of_mechanism = {*own.parent.glob("*.py"), PACKAGE / "diagnosis" / "curves.py"}
    # A learned form knows at which of its numbers it is like a formula of its mechanism (`Effect.like`).
    like = {own.with_stem(e.name) for e in catalogue().values() if e.learned and e.mechanism == find(name).mechanism}
    # So does a form whose limit it is.
    limit_of = {own.with_stem(e.name) for e in catalogue().values() if name in e.limits}
    homes = of_mechanism if name in MECHANISMS else {own, *like, *limit_of}
    word = re.compile(rf"\b{name}\b")
    elsewhere = {path.name for path, text in _strings() if path not in homes and word.search(text)}
    assert name in FIELDS or not elsewhere
