"""A sheet: some figures with a sentence each, as one HTML file without a reference to anything outside."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mjfish.files import write_text
from mjfish.reporting.html.template import render


@dataclass(frozen=True)
class Block:
    """One figure.

    Attributes:
        heading: above it; folds the figure away when clicked.
        remark: beside the heading.
        spec: of plotly (`mjfish.reporting.html.figure`).
        shown: whether it is open at first.
    """

    heading: str
    remark: str
    spec: dict[str, Any]
    shown: bool = True


@dataclass(frozen=True)
class Sheet:
    """What a file shows.

    Attributes:
        title: of the page.
        lead: how to read it.
        legend: names of the colours, by the name of the colour in the style.
        blocks: the figures.
    """

    title: str
    lead: str
    legend: dict[str, str]
    blocks: tuple[Block, ...]


def write_sheet(path: Path, sheet: Sheet) -> None:
    """Write a sheet, whole or not at all.

    Raises:
        InputError: the file cannot be written.
    """
    write_text(path, render("sheet.html.j2", sheet=sheet))
