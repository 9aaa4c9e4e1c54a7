"""What is left of a fit: measured against simulated, and the residual's correlations with their bands."""

from __future__ import annotations

import html
from collections.abc import Sequence
from typing import Any

import numpy as np

from mjfish.estimation.residuals.independence import CrossCorrelation
from mjfish.estimation.residuals.inputs import INPUTS
from mjfish.estimation.residuals.residual import Residual
from mjfish.estimation.residuals.whiteness import ALL, Autocorrelation
from mjfish.frames import CHANNELS
from mjfish.reporting.html import figure, series
from mjfish.reporting.html.words import CHANNEL_NAMES, chance

#: What the inputs are, for headings.
INPUT_NAMES = {"beat": "last joint", "double_beat": "last joint, squared"}
_GAP = 0.08
_ROW = 165


def simulated_figure(residual: Residual) -> dict[str, Any]:
    """Return measured and simulated velocities of one trial, and the residual beside them where it counts."""
    trial = residual.trial
    counted = np.where(residual.counted[:, None], residual.predicted, np.nan)
    data = []
    for k in range(len(CHANNELS)):
        measured = figure.curve(trial.time, trial.velocity[:, k], "@measured", k + 1, width=3.2)
        simulated = figure.curve(trial.time, counted[:, k], "@nominal", k + 1)
        left = figure.curve(trial.time, residual.values[:, k], "@nominal", k + 1 + len(CHANNELS), width=1.0)
        data += [{**measured, "name": "measured"}, {**simulated, "name": "simulated"}, {**left, "name": "residual"}]
    return {"data": data, "layout": series.panels(tuple(segment.start for segment in trial.drive[1:]))}


def autocorrelation_figure(tests: Sequence[Autocorrelation]) -> dict[str, Any]:
    """Return the autocorrelation of the residual of every channel over all trials, thin lines the trials alone."""
    data: list[figure.Trace] = []
    for panel, channel in enumerate(CHANNELS, start=1):
        own = [test for test in tests if test.channel == channel]
        for test in own:
            if test.trial == ALL:
                continue
            line = figure.curve(test.lag, test.value, "@measured", panel, width=0.8)
            data.append({**line, "name": "one trial", "hoverinfo": "skip"})
        for test in own:
            if test.trial == ALL:
                data.insert(0, figure.band(test.lag, -test.band, test.band, "@nominal-soft", panel))
                line = figure.curve(test.lag, test.value, "@nominal", panel)
                data.append({**line, "mode": "lines+markers", "marker": {"size": 5, "color": "@nominal"}, "name": ALL})
    headings = [[CHANNEL_NAMES[channel]] for channel in CHANNELS]
    return {"data": data, "layout": _grid(headings, "lag [samples]")}


def cross_correlation_figure(tests: Sequence[CrossCorrelation], trial: str = ALL) -> dict[str, Any]:
    """Return the cross-correlation of the residual with every input, a row a channel, of one trial or over all."""
    data = []
    headings = [[f"{CHANNEL_NAMES[channel]}, {INPUT_NAMES[name]}" for name in INPUTS] for channel in CHANNELS]
    for row, channel in enumerate(CHANNELS):
        for column, name in enumerate(INPUTS):
            panel = row * len(INPUTS) + column + 1
            for test in tests:
                if (test.trial, test.channel, test.input) == (trial, channel, name):
                    headings[row][column] += f": p {html.escape(chance(test.p_value))}"
                    data.append(figure.band(test.lag, -test.band, test.band, "@nominal-soft", panel))
                    data.append(
                        {**figure.curve(test.lag, test.value, "@nominal", panel, width=1.8), "name": "residual"}
                    )
    return {"data": data, "layout": _grid(headings, "residual behind the input [s]")}


def _grid(headings: Sequence[Sequence[str]], title: str) -> dict[str, Any]:
    """Return the layout of panels in rows from the top, numbered along the rows, with a line at zero in each."""
    rows, columns = len(headings), len(headings[0])
    width, height = ((1.0 - _GAP * (count - 1)) / count for count in (columns, rows))
    axes: dict[str, Any] = {}
    texts, shapes = [], []
    for k in range(rows * columns):
        row, column = divmod(k, columns)
        number = str(k + 1) if k else ""
        left, top = column * (width + _GAP), 1.0 - row * (height + _GAP)
        last = {"title": figure.axis_title(title)} if row == rows - 1 else {}
        across = figure.axis((left, min(left + width, 1.0)), f"y{number}", showticklabels=row == rows - 1, **last)
        axes[figure.named_axis("x", k + 1)] = across
        axes[figure.named_axis("y", k + 1)] = figure.axis((max(top - height, 0.0), top), f"x{number}", nticks=4)
        texts.append(figure.heading(headings[row][column], k + 1))
        shapes.append(
            {
                "type": "line", "layer": "below", "line": {"color": "@muted", "width": 1}, "xref": f"x{number} domain",
                "yref": f"y{number}", "x0": 0, "x1": 1, "y0": 0, "y1": 0,
            }
        )  # fmt: skip
    return figure.layout(_ROW * rows + 60, axes, texts, shapes)
