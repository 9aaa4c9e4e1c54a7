"""Profile likelihoods: how much worse the best fit gets as one parameter is held elsewhere, one panel a parameter."""

from __future__ import annotations

import html
from collections.abc import Sequence
from typing import Any

import numpy as np

from mjfish.estimation.uncertainty.profile import Profile
from mjfish.reporting.html import figure
from mjfish.reporting.html.words import unit

#: Panels side by side, at most; height of a row of them [px]; gaps as shares of the figure.
COLUMNS = 3
_ROW = 250
_GAP = 0.08
#: Highest rise that is drawn, in units of the threshold.
_TOP = 1.6


def profile_figure(profiles: Sequence[Profile]) -> dict[str, Any]:
    """Return the rise of -2 log likelihood over each parameter, its threshold and the interval that it gives.

    A parabola through the estimate with the same curvature is drawn behind each: where the two part, an interval of
    estimate and standard error misleads.
    """
    columns = max(min(COLUMNS, len(profiles)), 1)
    rows = max(-(-len(profiles) // columns), 1)
    data: list[figure.Trace] = []
    axes: dict[str, Any] = {}
    headings, shapes = [], []
    for k, one in enumerate(profiles):
        data += _traces(one, k + 1)
        shapes += _shapes(one, k + 1)
        headings.append(figure.heading(html.escape(one.name), k + 1))
        axes.update(_axes(one, k, columns, rows))
    return {"data": data, "layout": figure.layout(_ROW * rows + 20, axes, headings, shapes)}


def _traces(one: Profile, panel: int) -> list[figure.Trace]:
    """Return the parabola of the standard error behind the refits."""
    inner = np.linspace(one.values[0], one.values[-1], 61)
    parabola = ((inner - one.estimate) / max(one.sigma, 1e-300)) ** 2
    shown = parabola <= _TOP * one.threshold
    refits = figure.curve(one.values, one.rise, "@nominal", panel, width=2.0)
    return [
        {**figure.curve(inner[shown], parabola[shown], "@muted", panel, dash="dot"), "name": "parabola"},
        {**refits, "mode": "lines+markers", "marker": {"size": 5, "color": "@nominal"}, "name": "refits"},
    ]


def _shapes(one: Profile, panel: int) -> list[dict[str, Any]]:
    """Return the interval as a band, its threshold and the estimate as lines."""
    number = "" if panel == 1 else str(panel)
    across = {"xref": f"x{number} domain", "yref": f"y{number}"}
    upright = {"xref": f"x{number}", "yref": f"y{number} domain", "y0": 0, "y1": 1}
    band = {"type": "rect", "fillcolor": "@nominal-soft", "line": {"width": 0}, "layer": "below"}
    line = {"type": "line", "layer": "below", "line": {"color": "@muted", "width": 1}}
    return [
        {**band, **upright, "x0": one.low, "x1": one.high},
        {**line, **across, "x0": 0, "x1": 1, "y0": one.threshold, "y1": one.threshold},
        {**line, **upright, "x0": one.estimate, "x1": one.estimate},
    ]


def _axes(one: Profile, k: int, columns: int, rows: int) -> dict[str, Any]:
    """Return both axes of a panel, numbered from 0, by rows from the top."""
    number = "" if k == 0 else str(k + 1)
    row, column = divmod(k, columns)
    width, height = ((1.0 - _GAP * (count - 1)) / count for count in (columns, rows))
    left, top = column * (width + _GAP), 1.0 - row * (height + _GAP)
    title = figure.axis_title(f"[{unit(one.unit)}]" if unit(one.unit) else "")
    across = figure.axis((left, min(left + width, 1.0)), f"y{number}", title=title, nticks=4)
    upwards = figure.axis((max(top - height, 0.0), top), f"x{number}", range=[0.0, _TOP * one.threshold])
    return {figure.named_axis("x", k + 1): across, figure.named_axis("y", k + 1): upwards}
