"""How messages name a place in a file: a row of data, or a key."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path

from mjfish.errors import MjfishError


def row(path: Path, index: int) -> str:
    """Return the name of the row of data `index` (from 0): rows count from 1, and row 1 of a CSV is line 2."""
    line = f" (line {index + 2})" if path.suffix.lower() == ".csv" else ""
    return f"{path}: row {index + 1}{line}"


@contextlib.contextmanager
def named(place: str) -> Iterator[None]:
    """Put `place` before the message of any error of mjfish raised inside; its type stays."""
    try:
        yield
    except MjfishError as error:
        error.args = (f"{place}: {error}",)
        raise
