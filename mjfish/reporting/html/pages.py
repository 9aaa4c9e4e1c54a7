"""Pages from templates, and the page of figures: one HTML file each, without a reference to anything outside."""

from __future__ import annotations

import functools
import json
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jinja2
import plotly.graph_objects as go
from markupsafe import Markup
from plotly.offline import get_plotlyjs

from mjfish.files.writing import write_text
from mjfish.numerics import formats
from mjfish.reporting.html.figures import COLOURS
from mjfish.reporting.html.readings import Reading


@dataclass(frozen=True)
class Block:
    """One figure.

    Attributes:
        heading: above it; folds the figure away when clicked.
        remark: beside the heading.
        figure: of plotly.
        shown: whether it is open at first.
    """

    heading: str
    remark: str
    figure: go.Figure
    shown: bool = True


@dataclass(frozen=True)
class Section:
    """Figures under one heading.

    Attributes:
        title: the heading.
        lead: how to read the figures.
        legend: names of the colours, by the name of the colour in `COLOURS`.
        blocks: the figures.
        reading: how to read each of them, where that is not said elsewhere.
    """

    title: str
    lead: str
    legend: dict[str, str]
    blocks: tuple[Block, ...]
    reading: Reading | None = None


def write_figures(path: Path, *sections: Section, title: str = "", lead: str = "") -> None:
    """Write a page of figures, whole or not at all.

    Args:
        path: to write to.
        sections: in order.
        title: heading of the page; else that of the first section.
        lead: below it, line by line.

    Raises:
        InputError: the file cannot be written.
    """
    write_text(path, render("figures.html.j2", sections=sections, title=title, lead=lead))


def render(template: str, **view: Any) -> str:
    """Return a page as HTML: plotly is in it, and everything that came from a user is escaped.

    Args:
        template: name of the file in ``templates``.
        view: what the template may use. It also has the formats of `mjfish.numerics.formats` as filters, and
            ``themed``, which turns a figure into data for plotly.js.
    """
    return _environment().get_template(template).render(view, plotly_js=Markup(plotly_js()), colours=COLOURS)  # noqa: S704


@functools.cache
def plotly_js() -> str:
    """Return plotly.js without the addresses from which it would load maps, of which no figure here has one."""
    return re.sub(r"https://[\w.]*(cdn|tiles)\b[^\"'`)]*|https://[\w.]*cdn\.com[^\"'`)]*", "", str(get_plotlyjs()))


class Shown(go.Figure):  # type: ignore[misc]  # plotly has no types
    """A figure that a notebook shows without a network: plotly's own way asks for another library there."""

    _ipython_display_ = None  # it would come first

    def _repr_mimebundle_(self, *_: Any, **__: Any) -> dict[str, Any]:
        drawn = self.to_html(full_html=False, include_plotlyjs=False)
        return {"text/html": f"<script>{plotly_js()}</script>{drawn}"}


def themed(figure: go.Figure) -> Any:
    """Return a figure as plain data in which ``@nominal`` stands for the page's variable ``--nominal``, and so on."""
    text = str(figure.to_json())
    for name, colour in COLOURS.items():
        text = text.replace(f'"{colour}"', f'"@{name}"')
    return json.loads(text)


@functools.cache
def _environment() -> jinja2.Environment:
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("mjfish.reporting.html"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    shown = (formats.number, formats.percent, formats.p_value, formats.unit, formats.counted, themed)
    environment.filters.update({function.__name__: function for function in shown})
    return environment
