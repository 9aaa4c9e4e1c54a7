"""A cause is one file: its name occurs nowhere else in the package."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import mjfish
from mjfish.effects import catalogue

PACKAGE = Path(mjfish.__file__).parent
#: Names of effects that are columns of a trial or fields of a fish, too.
FIELDS = {"roll", "munk_moment", "tail_compliance"}


def _sources() -> dict[Path, str]:
    """Return the text of every file but those of the command line, whose help has examples."""
    return {path: path.read_text(encoding="utf-8") for path in PACKAGE.rglob("*.py") if "cli" not in path.parts}


@pytest.mark.parametrize("name", sorted(catalogue()))
def test_no_other_file_names_it(name: str) -> None:
    """As a string: what checks, planning and reports need to know of a cause, it declares."""
    own = PACKAGE / "effects" / f"{name}.py"
    assert own.is_file()
    if name in FIELDS:
        return
    quoted = re.compile(rf"""["']{name}["'.]""")
    assert [
        str(path.relative_to(PACKAGE)) for path, text in _sources().items() if path != own and quoted.search(text)
    ] == []
