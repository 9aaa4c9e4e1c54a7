"""Figures of the curves of named mechanisms: one a quantity, a panel a group of links."""

from __future__ import annotations

import html
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import plotly.graph_objects as go

from mjfish.diagnosis.curves import MeasuredCurve
from mjfish.diagnosis.forms import NamedMechanism
from mjfish.numerics.formats import number, unit
from mjfish.reporting.curves import logarithmic, span, stretches
from mjfish.reporting.html.figures import COLUMNS, Panel, panels

#: How the quantities of curves read; others by their name.
QUANTITY_NAMES = {
    "c_d": "Drag coefficient across, c_d",
    "c_f": "Friction coefficient along, c_f",
    "c_n": "Coefficient of the force across the chord, c_n",
    "c_m": "Coefficient of the added mass, c_m",
    "joint_angle": "Angle that the joints reach",
    "moment": "Moment of the spring",
}
#: Pixels of a row of panels.
_HEIGHT = 280


@dataclass(frozen=True)
class FormFigure:
    """A figure of one quantity of a mechanism.

    Attributes:
        title: quantity and groups in words.
        caption: what is shown, and where the runs have been.
        figure: of plotly.
        width: share of the page that it takes, so that panels of all figures are of one size.
    """

    title: str
    caption: str
    figure: go.Figure
    width: float


#: What is said of a mechanism and its forms, and its figures.
FormRow = tuple[str, tuple[FormFigure, ...]]


def form_rows(mechanisms: Iterable[NamedMechanism]) -> list[FormRow]:
    """Return the figures of every mechanism that has curves."""
    return [
        (mechanism.told, tuple(_drawn(mechanism.curves, name) for name in dict.fromkeys(quantities)))
        for mechanism in mechanisms
        if (quantities := [curve.quantity for curve in mechanism.curves])
    ]


def _drawn(every: Iterable[MeasuredCurve], quantity: str) -> FormFigure:
    """Return the figure of the curves of one quantity."""
    curves = [curve for curve in every if curve.quantity == quantity]
    groups, x = [curve.group for curve in curves], curves[0].x
    been = "; ".join(f"{curve.group} {_been(curve)}" for curve in curves)
    named = " and ".join([", ".join(groups[:-1]), groups[-1]] if len(groups) > 1 else groups)
    return FormFigure(
        f"{QUANTITY_NAMES.get(quantity, quantity)}: {named}",
        f"{quantity} over the {x.name.replace('_', ' ')}, with its 95 % band. Where the runs have been: {been}.",
        curve_figure(curves),
        min(len(curves) / COLUMNS, 1.0),
    )


def curve_figure(curves: list[MeasuredCurve]) -> go.Figure:
    """Return curves with their bands, a panel each: solid where the runs have been, dotted and grey beyond.

    The nominal model is dashed. The scale is that of the visited range: beyond it, a band may leave the panel.
    """
    columns = min(COLUMNS, len(curves))
    rows = -(-len(curves) // columns)
    figure = panels(
        rows,
        columns,
        height=_HEIGHT * rows,
        horizontal_spacing=0.08 if columns > 1 else 0.0,
        vertical_spacing=0.3 / rows,
    )
    for k, curve in enumerate(curves):
        panel = Panel(figure, k // columns + 1, k % columns + 1)
        pieces = stretches(curve)
        for piece in pieces:
            panel.band(piece.x, piece.low, piece.high, "extended-soft" if piece.seen else "muted-soft", "fitted form")
        panel.curve(np.array(curve.x.values), np.array(curve.nominal), "nominal", "nominal model", dash="dash")
        for piece in pieces:
            if piece.seen:
                panel.curve(piece.x, piece.y, "extended", "fitted form", width=2.2)
            else:
                panel.curve(piece.x, piece.y, "muted", "where no run has been", dash="dot")
        shown = unit(curve.y.unit)
        panel.heading(html.escape(f"{curve.y.name}, {curve.group}{f' [{shown}]' if shown else ''}"))
        at = {"row": panel.row, "col": panel.column}
        title = html.escape(f"{curve.x.name.replace('_', ' ')} [{curve.x.unit}]")
        figure.update_xaxes(title_text=title, type="log" if logarithmic(curve) else "linear", **at)
        figure.update_yaxes(range=span(curve), **at)
    return figure


def _been(curve: MeasuredCurve) -> str:
    if curve.seen is None or curve.bears == "nothing":
        return "nowhere that says something of it"
    only = " (the runs bear one number, no curve)" if curve.bears == "number" else ""
    return f"{' to '.join(number(x, 2) for x in curve.seen)} {curve.x.unit}{only}"
