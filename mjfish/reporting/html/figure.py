"""Figures as plain plotly.js specifications; colours are names that the page looks up in its style.

A string that begins with ``@`` is the name of a CSS variable: the same figure is drawn in the light, in the dark and
on paper. Nothing that a user wrote goes into a figure.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from mjfish.arrays import FloatArray

Trace = dict[str, Any]
#: A curve with more points is thinned to the extremes of equal stretches.
POINTS = 2400


def curve(x: FloatArray, y: FloatArray, colour: str, panel: int, **style: Any) -> Trace:
    """Return a line in a panel (numbered from 1); `style` goes to plotly's ``line``."""
    x, y = thinned(x, y)
    return {
        "type": "scatter",
        "mode": "lines",
        "x": compact(x),
        "y": compact(y),
        "xaxis": _axis("x", panel),
        "yaxis": _axis("y", panel),
        "line": {"color": colour, "width": 1.3, **style},
    }


def band(x: FloatArray, low: FloatArray, high: FloatArray, colour: str, panel: int) -> Trace:
    """Return a filled band between two curves."""
    return {
        **curve(np.concatenate([x, x[::-1]]), np.concatenate([low, high[::-1]]), colour, panel, width=0),
        "fill": "toself",
        "fillcolor": colour,
        "hoverinfo": "skip",
    }


def thinned(x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the curve through the lowest and the highest sample of each of POINTS / 2 stretches, where it has more."""
    if len(x) <= POINTS:
        return x, y
    stretches = np.array_split(np.arange(len(x)), POINTS // 2)
    filled = np.where(np.isfinite(y), y, 0.0)
    kept = np.array([k for s in stretches for k in sorted({s[np.argmin(filled[s])], s[np.argmax(filled[s])]})])
    return x[kept], y[kept]


def compact(values: FloatArray) -> list[float | None]:
    """Return five significant digits of each value; None (a gap in the curve) where it is no number."""
    return [float(f"{v:.5g}") if np.isfinite(v) else None for v in values]


def axis(domain: tuple[float, float], anchor: str, **more: Any) -> dict[str, Any]:
    """Return an axis in the quiet style of the page."""
    return {
        "domain": list(domain),
        "anchor": anchor,
        "showgrid": True,
        "gridcolor": "@grid",
        "gridwidth": 1,
        "zeroline": False,
        "showline": False,
        "ticks": "",
        "tickfont": {"size": 11, "color": "@muted"},
        "nticks": 6,
        **more,
    }


def layout(
    height: int, axes: dict[str, Any], headings: Sequence[dict[str, Any]], shapes: Sequence[dict[str, Any]] = ()
) -> dict[str, Any]:
    """Return the layout of a figure [px high] with these axes, headings of panels, and shapes."""
    return {
        "height": height,
        "margin": {"l": 44, "r": 12, "t": 22, "b": 40},
        "paper_bgcolor": "rgba(0,0,0,0)",
        "plot_bgcolor": "rgba(0,0,0,0)",
        "font": {"family": "system-ui, sans-serif", "size": 12, "color": "@ink"},
        "showlegend": False,
        "hovermode": "x",
        "hoverlabel": {"font": {"size": 11}},
        "annotations": list(headings),
        "shapes": list(shapes),
        **axes,
    }


def named_axis(letter: str, panel: int) -> str:
    """Return the key of an axis in a layout, e.g. ``xaxis3``."""
    return f"{letter}axis{panel if panel > 1 else ''}"


def axis_title(text: str) -> dict[str, Any]:
    """Return the title of an axis."""
    return {"text": text, "font": {"size": 12, "color": "@muted"}, "standoff": 6}


def heading(text: str, panel: int) -> dict[str, Any]:
    """Return the heading of a panel, above its left corner."""
    return {
        "text": text,
        "xref": f"{_axis('x', panel)} domain",
        "yref": f"{_axis('y', panel)} domain",
        "x": 0,
        "y": 1,
        "xanchor": "left",
        "yanchor": "bottom",
        "showarrow": False,
        "font": {"size": 12, "color": "@muted"},
    }


def _axis(letter: str, panel: int) -> str:
    return letter if panel == 1 else f"{letter}{panel}"
