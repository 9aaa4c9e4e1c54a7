"""The page of a study: what came of its pieces, and the estimates with their intervals, by dataset and setting."""

from __future__ import annotations

import html
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import plotly.graph_objects as go

from mjfish.reporting.html.figures import COLOURS, panels
from mjfish.reporting.html.pages import Block, Section, write_figures
from mjfish.reporting.words import unit
from mjfish.study import Collected

#: Datasets and settings that are drawn, at most, and parameters whose figure is open at first.
_MOST, _OPEN = 100, 6
#: Outcomes, words for them, and their colours.
_OUTCOMES = {
    "converged": "extended",
    "named": "extended",
    "nothing_wrong": "measured",
    "cannot_tell": "nominal",
    "stopped": "nominal",
    "unexplained": "muted",
    "diverged": "muted",
    "failed": "ink",
}
_RIGHT = {"yes": "extended", "open": "measured", "no": "nominal"}
_ESTIMATES = {
    "extended": "estimate with its 95 % interval",
    "nominal": "interval without the true value",
    "ink": "truth",
}

Row = dict[str, Any]


def write_study(collected: Collected, path: Path) -> None:
    """Write the page, whole or not at all.

    Args:
        collected: what to show.
        path: of the page.

    Raises:
        InputError: the file cannot be written.
    """
    groups: dict[tuple[str, str], list[Row]] = {}
    for row in collected.rows:
        groups.setdefault((row["dataset"], row["setting"]), []).append(row)
    blocks = [Block("Outcomes", "", _counts(groups, "outcome", _OUTCOMES))]
    if any(row["right"] is not None for row in collected.rows):
        blocks.append(Block("Named rightly", "where the truth is known", _counts(groups, "right", _RIGHT)))
    counted = Section("What came of the pieces", "By dataset and setting.", {}, tuple(blocks))
    estimates = tuple(
        Block(name, _inside(collected.rows, name), _estimates(groups, name, symbol), shown=number < _OPEN)
        for number, (name, symbol) in enumerate(collected.units.items())
    )
    sections = [counted, Section("Estimates", "A point a piece.", _ESTIMATES, estimates)] if estimates else [counted]
    write_figures(path, *sections, title="Study", lead=collected.summary.partition("\n")[0] + _left_out(groups))


def _left_out(groups: dict[tuple[str, str], list[Row]]) -> str:
    more = len(groups) - _MOST
    return (
        f" The figures show the first {_MOST} datasets and settings, study.csv all {len(groups)}." if more > 0 else ""
    )


def _by_group(groups: dict[tuple[str, str], list[Row]]) -> tuple[go.Figure, list[Sequence[Row]]]:
    """Return a figure with a line a group, the first on top, and the rows of each."""
    shown = [*groups.items()][:_MOST]
    names = [html.escape(f"{dataset}, {setting}") for (dataset, setting), _ in shown]
    drawn = panels(1, height=90 + 26 * len(shown))
    ticks = {"tickmode": "array", "tickvals": [*range(len(names))], "ticktext": names}
    drawn.update_yaxes(range=[len(names) - 0.5, -0.5], automargin=True, showgrid=False, **ticks)
    return drawn, [rows for _, rows in shown]


def _counts(groups: dict[tuple[str, str], list[Row]], key: str, colours: dict[str, str]) -> go.Figure:
    """Draw how many pieces of each group have each value of a column."""
    drawn, shown = _by_group(groups)
    counts = [Counter(row[key] for row in rows) for rows in shown]
    for value, colour in colours.items():
        own = [count[value] for count in counts]
        if any(own):
            drawn.add_bar(
                x=own, y=[*range(len(own))], name=value.replace("_", " "), orientation="h", marker_color=COLOURS[colour]
            )
    return drawn.update_layout(
        barmode="stack", showlegend=True, legend_traceorder="normal", hovermode="closest"
    ).update_xaxes(title_text="pieces", rangemode="tozero")


def _misses(row: Row, name: str) -> bool | None:
    """Return whether an interval leaves the true value out; None where one of the two is not known."""
    low, high, true = (row.get(f"{name} {end}") for end in ("low", "high", "true"))
    return None if low is None or high is None or true is None else not low <= true <= high


def _inside(rows: Sequence[Row], name: str) -> str:
    known = [missed for row in rows if (missed := _misses(row, name)) is not None]
    return f"the true value is in {known.count(False)} of {len(known)} intervals" if known else ""


def _estimates(groups: dict[tuple[str, str], list[Row]], name: str, symbol: str) -> go.Figure:
    """Draw the estimates of a parameter and their intervals, and true values, seeds beside each other."""
    drawn, shown = _by_group(groups)
    points: dict[bool, list[tuple[float, float, float, float, str]]] = {False: [], True: []}
    truths: list[tuple[float, int]] = []
    for place, rows in enumerate(shown):
        own = [row for row in rows if row.get(name) is not None]
        for row, aside in zip(own, np.linspace(-0.3, 0.3, len(own)) if len(own) > 1 else [0.0], strict=False):
            low, high = (row[name] if row[f"{name} {end}"] is None else row[f"{name} {end}"] for end in ("low", "high"))
            point = (row[name], place + aside, row[name] - low, high - row[name], f"seed {row['seed']}")
            points[bool(_misses(row, name))].append(point)
        truths += [(true, place) for true in dict.fromkeys(row.get(f"{name} true") for row in own) if true is not None]
    for true, place in truths:
        drawn.add_scatter(
            x=[true, true], y=[place - 0.42, place + 0.42], mode="lines", name="truth",
            line={"color": COLOURS["ink"], "width": 1.5}, hoverinfo="x",
        )  # fmt: skip
    for missed, colour in ((False, "extended"), (True, "nominal")):
        if points[missed]:
            x, y, below, above, seeds = (list(values) for values in zip(*points[missed], strict=True))
            drawn.add_scatter(
                x=x, y=y, mode="markers", name="estimate", text=seeds, hoverinfo="x+text",
                marker={"size": 5, "color": COLOURS[colour]},
                error_x={"type": "data", "symmetric": False, "array": above, "arrayminus": below, "width": 0,
                         "thickness": 1.3, "color": COLOURS[colour]},
            )  # fmt: skip
    return drawn.update_layout(hovermode="closest").update_xaxes(title_text=f"[{unit(symbol)}]" if unit(symbol) else "")
