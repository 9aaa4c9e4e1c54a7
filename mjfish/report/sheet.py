"""A sheet: some figures with a sentence each, as one HTML file without a reference to anything outside."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jinja2
from markupsafe import Markup
from plotly.offline import get_plotlyjs

from mjfish.files import write_text


@dataclass(frozen=True)
class Block:
    """One figure.

    Attributes:
        heading: above it; folds the figure away when clicked.
        remark: beside the heading.
        spec: of plotly (`mjfish.report.figure`).
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
    template = _environment().get_template("sheet.html.j2")
    write_text(path, template.render(sheet=sheet, plotly_js=Markup(get_plotlyjs())))  # noqa: S704


@functools.cache
def _environment() -> jinja2.Environment:
    return jinja2.Environment(
        loader=jinja2.PackageLoader("mjfish.report"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
