"""Markdown of the pages that studies write: tables, and paragraphs whose lines are broken anew."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Sequence

_WIDTH = 128


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a Markdown table; all but the first column to the right."""
    lines = [head, ["---", *["---:"] * (len(head) - 1)], *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def wrapped(page: str) -> str:
    """Break the lines of paragraphs and list items of a page anew: numbers changed their lengths.

    Headings, tables, pictures, code and numbered lists stay as they are.
    """
    parts = [part.strip("\n") for part in page.split("\n\n") if part.strip("\n")]
    return "\n\n".join(_wrapped(part) for part in parts) + "\n"


def _wrapped(part: str) -> str:
    if part[0] in "#|!`" or part[0].isdigit():
        return part
    items = ["- " + item for item in part[2:].split("\n- ")] if part.startswith("- ") else [part]
    indent = "  " if part.startswith("- ") else ""
    return "\n".join(
        textwrap.fill(
            " ".join(item.split()), _WIDTH, subsequent_indent=indent, break_on_hyphens=False, break_long_words=False
        )
        for item in items
    )
