"""Figures by plotly, in one style: a template of the package, and panels laid out by `plotly.subplots`.

Colours come from one table, `COLOURS`. A page maps them to its own variables (`mjfish.reporting.html.pages`), so the
same figure is drawn in the light, in the dark and on paper. What a user named is escaped: plotly renders some markup.
"""

from __future__ import annotations

import html
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import plotly.graph_objects as go
import plotly.io
from plotly.subplots import make_subplots

from mjfish.data import Sensor, Trial
from mjfish.diagnosis import DiagnosisData, Overlay, SensorOverlay
from mjfish.diagnosis.missing_force import MissingForce
from mjfish.estimation.intervals import Profile
from mjfish.estimation.residual import Residual
from mjfish.estimation.residual_tests import ALL, Autocorrelation, CrossCorrelation
from mjfish.fish.frames import CHANNELS, UNITS
from mjfish.numerics.arrays import FloatArray
from mjfish.numerics.formats import CHANNEL_NAMES, channel_name, p_value, unit

#: Colours by what they stand for.
COLOURS = {
    "ink": "#1d2126",
    "muted": "#5f6771",
    "grid": "#eceef0",
    "measured": "#8b939d",
    "nominal": "#d9772b",
    "extended": "#13808c",
    "nominal-soft": "rgba(217, 119, 43, 0.18)",
    "extended-soft": "rgba(19, 128, 140, 0.18)",
    "muted-soft": "rgba(95, 103, 113, 0.12)",
}
#: A curve with more points is thinned to the extremes of equal stretches.
POINTS = 2400
#: Inputs that a residual is correlated with.
INPUT_NAMES = {"beat": "last joint", "double_beat": "last joint, squared"}
#: How the velocities read, with their units.
VELOCITIES = tuple(f"{CHANNEL_NAMES[channel]} [{UNITS[channel]}]" for channel in CHANNELS)
#: Profiles side by side, at most, and the highest rise that is drawn, in units of the threshold.
COLUMNS = 3
_TOP = 1.6

_MUTED = {"size": 12, "color": COLOURS["muted"]}
_AXIS = {
    "showgrid": True,
    "gridcolor": COLOURS["grid"],
    "gridwidth": 1,
    "zeroline": False,
    "zerolinecolor": COLOURS["muted"],
    "zerolinewidth": 1,
    "showline": False,
    "ticks": "",
    "tickfont": {"size": 11, "color": COLOURS["muted"]},
    "nticks": 6,
    "title": {"font": _MUTED, "standoff": 6},
}
plotly.io.templates["mjfish"] = go.layout.Template(
    layout={
        "margin": {"l": 44, "r": 12, "t": 22, "b": 40},
        "paper_bgcolor": "rgba(0,0,0,0)",
        "plot_bgcolor": "rgba(0,0,0,0)",
        "font": {"family": "system-ui, sans-serif", "size": 12, "color": COLOURS["ink"]},
        "showlegend": False,
        "legend": {"orientation": "h", "x": 1, "xanchor": "right", "y": 1.02, "yanchor": "bottom"},
        "hovermode": "x",
        "hoverlabel": {"font": {"size": 11}},
        "xaxis": _AXIS,
        "yaxis": _AXIS,
        "colorway": [COLOURS[name] for name in ("nominal", "extended", "measured")],
    }
)


@dataclass(frozen=True)
class Panel:
    """One panel of a figure, by row and column from 1."""

    figure: go.Figure
    row: int
    column: int = 1

    def curve(self, x: FloatArray, y: FloatArray, colour: str, name: str | None = None, **style: Any) -> None:
        """Draw a line; `style` goes to plotly's ``line``. A name that another line has shares its legend."""
        x, y = thinned(np.asarray(x), np.asarray(y))
        known = {trace.name for trace in self.figure.data}
        line = {"color": COLOURS[colour], "width": 1.3, **style}
        self.figure.add_scatter(
            x=compact(x), y=compact(y), mode="lines", line=line, name=name, legendgroup=name,
            showlegend=name is not None and name not in known, row=self.row, col=self.column,
        )  # fmt: skip

    def marked(self, x: FloatArray, y: FloatArray, colour: str, name: str | None = None, **style: Any) -> None:
        """Draw a line with a marker at every point."""
        self.curve(x, y, colour, name, **style)
        self.figure.data[-1].update(mode="lines+markers", marker={"size": 5, "color": COLOURS[colour]})

    def band(self, x: FloatArray, low: FloatArray, high: FloatArray, colour: str, name: str = "") -> None:
        """Fill the band between two curves; `name` says whose it is, where the data of the figure are written."""
        self.curve(np.concatenate([x, x[::-1]]), np.concatenate([low, high[::-1]]), colour, width=0)
        self.figure.data[-1].update(fill="toself", fillcolor=COLOURS[colour], hoverinfo="skip", meta=f"{name} band")

    def heading(self, text: str) -> None:
        """Write above the left corner."""
        self.figure.add_annotation(
            text=text, xref="x domain", yref="y domain", x=0, y=1, xanchor="left", yanchor="bottom", showarrow=False,
            font=_MUTED, row=self.row, col=self.column,
        )  # fmt: skip


def panels(rows: int, columns: int = 1, *, height: int, headings: Sequence[str] = (), **layout: Any) -> go.Figure:
    """Return a figure of empty panels, `height` pixels high, with headings, row by row.

    `layout` goes to `plotly.subplots.make_subplots`.
    """
    figure = make_subplots(rows, columns, **layout).update_layout(template="mjfish", height=height)
    for k, text in enumerate(headings):
        Panel(figure, k // columns + 1, k % columns + 1).heading(text)
    return figure


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


#: A sensor, and what each model predicts it to read (m, c).
Read = tuple[Sensor, Mapping[str, FloatArray]]


def trial_figure(trial: Trial, predicted: Mapping[str, FloatArray], read: Sequence[Read] = ()) -> go.Figure:
    """Return measured and predicted velocities over time and the residuals beside them.

    Dotted lines: the drive steps.

    Args:
        trial: as measured.
        predicted: velocities (n, 3) by model, ``nominal`` or ``extended``; NaN leaves a gap.
        read: what sensors read, which is drawn in place of the velocities where there is some.
    """
    if read:
        return series_figure(
            [
                Series(f"{sensor.name} {channel} [{unit}]", sensor.time, sensor.values[:, k], _column(values, k))
                for sensor, values in read
                for k, (channel, unit) in enumerate(zip(sensor.channels, sensor.units, strict=True))
            ]
        )
    figure = series_figure(
        [Series(title, trial.time, trial.velocity[:, k], _column(predicted, k)) for k, title in enumerate(VELOCITIES)]
    )
    for segment in trial.drive[1:]:
        figure.add_vline(
            segment.start, row="all", col="all", line={"color": COLOURS["muted"], "width": 1, "dash": "dot"}
        )
    return figure


def _column(predicted: Mapping[str, FloatArray], k: int) -> dict[str, FloatArray]:
    return {model: values[:, k] for model, values in predicted.items()}


@dataclass(frozen=True, eq=False)
class Series:
    """One measured channel: title with unit, times and values (n,), and those of each model."""

    title: str
    time: FloatArray
    measured: FloatArray
    predicted: Mapping[str, FloatArray]


def series_figure(series: Sequence[Series]) -> go.Figure:
    """Return measured and predicted series over time, one a row, and the residuals beside them."""
    figure = panels(
        len(series), 2, height=180 * len(series), shared_xaxes="all", column_widths=[0.57, 0.365],
        horizontal_spacing=0.065, vertical_spacing=0.225 / len(series),
    )  # fmt: skip
    for k, own in enumerate(series):
        shown, residual = Panel(figure, k + 1), Panel(figure, k + 1, 2)
        shown.curve(own.time, own.measured, "measured", "measured", width=3.2)
        for model, values in own.predicted.items():
            shown.curve(own.time, values, model, model)
            residual.curve(own.time, own.measured - values, model, model, width=1.0)
        name, _, unit = own.title.rpartition(" [")
        shown.heading(own.title)
        residual.heading(f"{name}, measured − simulated [{unit}")
    return figure.update_xaxes(title_text="time [s]", row=len(series))


def predictions(diagnosis: DiagnosisData, of: Overlay | SensorOverlay) -> dict[str, FloatArray]:
    """Return what the models of a diagnosis predict of a trial or of a sensor."""
    models = ("nominal", "extended") if diagnosis.best else ("nominal",)
    return {model: getattr(of, model) for model in models}


def scored_predictions(diagnosis: DiagnosisData, overlay: Overlay) -> dict[str, FloatArray]:
    """Return what the models of a diagnosis predict where it counts (`Overlay.counted`), NaN elsewhere."""
    counted = overlay.counted[:, None]
    return {model: np.where(counted, values, np.nan) for model, values in predictions(diagnosis, overlay).items()}


def overlay_figure(diagnosis: DiagnosisData, overlay: Overlay) -> go.Figure:
    """Return one trial of a diagnosis as measured and as its models predict it, drawn where it is scored.

    Where no velocity was measured, what sensors read.
    """
    read = [] if diagnosis.setup.velocities else [(own.sensor, predictions(diagnosis, own)) for own in overlay.sensors]
    return trial_figure(overlay.trial, scored_predictions(diagnosis, overlay), read)


def worst_path(diagnosis: DiagnosisData) -> tuple[Overlay, SensorOverlay] | None:
    """Return the run, held out if any is, whose places the nominal model misses most; None where none was measured."""
    places = [(one, [own for own in one.sensors if own.sensor.kind == "position"]) for one in diagnosis.overlays]
    every = [(overlay, own[0]) for overlay, own in places if own]
    shown = [pair for pair in every if pair[0].held_out] or every
    return max(shown, key=lambda pair: np.nanmean((pair[1].sensor.values - pair[1].nominal) ** 2), default=None)


def path_figure(diagnosis: DiagnosisData, places: SensorOverlay) -> go.Figure:
    """Return the places of one run in the plane, as measured and as the models predict them; metres are alike."""
    figure = panels(1, height=380, headings=["y [m] over x [m]"])
    panel, measured = Panel(figure, 1), places.sensor.values
    panel.curve(measured[:, 0], measured[:, 1], "measured", "measured", width=4.0)
    for model, values in predictions(diagnosis, places).items():
        panel.curve(values[:, 0], values[:, 1], model, model, width=1.8)
    return figure.update_yaxes(scaleanchor="x", scaleratio=1).update_layout(hovermode="closest")


def residual_figure(residual: Residual) -> go.Figure:
    """Return one trial of an identification as measured and as the fitted model predicts it, where it counts."""
    read = [(own.sensor, {"nominal": own.predicted}) for own in residual.sensors]
    counted = np.where(residual.counted[:, None], residual.predicted, np.nan)
    return trial_figure(residual.trial, {"nominal": counted}, () if residual.trial.measured.any() else read)


def force_figure(missing: MissingForce) -> go.Figure:
    """Return the missing force of a trial, one panel a component, bands two standard deviations wide on each side."""
    headings = ("surge [N]", "sway [N]", "yaw moment at the nose [N m]")
    figure = panels(len(headings), height=380, headings=headings, shared_xaxes=True, vertical_spacing=0.07)
    for k in range(len(headings)):
        panel, force, half = Panel(figure, k + 1), missing.force[:, k], 2.0 * missing.band[:, k]
        panel.band(missing.time, force - half, force + half, "nominal-soft", "missing force")
        panel.curve(missing.time, force, "nominal", "missing force")
    figure.update_xaxes(range=[float(missing.time[0]), float(missing.time[-1])])
    return figure.update_xaxes(title_text="time [s]", row=len(headings)).update_yaxes(zeroline=True, nticks=4)


def profile_figure(profiles: Sequence[Profile]) -> go.Figure:
    """Return the rise of -2 log likelihood over each parameter, its threshold and the interval that it gives.

    A parabola through the estimate with the same curvature is drawn behind each: where the two part, an interval of
    estimate and standard error misleads.
    """
    columns = max(min(COLUMNS, len(profiles)), 1)
    rows = max(-(-len(profiles) // columns), 1)
    figure = panels(rows, columns, height=250 * rows + 20, horizontal_spacing=0.08, vertical_spacing=0.25 / rows)
    line = {"color": COLOURS["muted"], "width": 1}
    for k, profile in enumerate(profiles):
        panel = Panel(figure, k // columns + 1, k % columns + 1)
        at = {"row": panel.row, "col": panel.column}
        inner = np.linspace(profile.values[0], profile.values[-1], 61)
        parabola = ((inner - profile.estimate) / max(profile.sigma, 1e-300)) ** 2
        drawn = parabola <= _TOP * profile.threshold
        panel.curve(inner[drawn], parabola[drawn], "muted", "parabola", dash="dot")
        panel.marked(profile.values, profile.rise, "nominal", "refits", width=2.0)
        panel.heading(html.escape(profile.name))
        figure.add_vrect(
            profile.low, profile.high, layer="below", fillcolor=COLOURS["nominal-soft"], line_width=0, **at
        )
        figure.add_hline(profile.threshold, line=line, layer="below", **at)
        figure.add_vline(profile.estimate, line=line, layer="below", **at)
        figure.update_xaxes(title_text=f"[{unit(profile.unit)}]" if unit(profile.unit) else "", nticks=4, **at)
        figure.update_yaxes(range=[0.0, _TOP * profile.threshold], **at)
    return figure


def autocorrelation_figure(tests: Sequence[Autocorrelation]) -> go.Figure:
    """Return the autocorrelation of the residual of every channel over all trials, thin lines the trials alone."""
    channels = list(dict.fromkeys(test.channel for test in tests))
    figure = panels(len(channels), height=165 * len(channels) + 60, shared_xaxes=True, vertical_spacing=_gap(channels))
    for k, channel in enumerate(channels):
        panel = Panel(figure, k + 1)
        panel.heading(html.escape(channel_name(channel)))
        for test in sorted((own for own in tests if own.channel == channel), key=lambda own: own.trial == ALL):
            if test.trial == ALL:
                panel.band(test.lag, -test.band, test.band, "nominal-soft", "white residual")
                panel.marked(test.lag, test.value, "nominal", "all trials")
            else:
                panel.curve(test.lag, test.value, "measured", "one trial", width=0.8)
    return _with_zero(figure).update_xaxes(title_text="lag [samples]", row=len(channels))


def cross_correlation_figure(tests: Sequence[CrossCorrelation], trial: str = ALL) -> go.Figure:
    """Return the cross-correlation of the residual with every input, a row a channel, of one trial or over all."""
    own = {(test.channel, test.input): test for test in tests if test.trial == trial}
    channels = list(dict.fromkeys(channel for channel, _ in own))
    rows, columns = len(channels), len(INPUT_NAMES)
    figure = panels(
        rows,
        columns,
        height=165 * rows + 60,
        shared_xaxes=True,
        horizontal_spacing=0.08,
        vertical_spacing=_gap(channels),
    )
    for row, channel in enumerate(channels):
        for column, (name, reads) in enumerate(INPUT_NAMES.items()):
            panel, test = Panel(figure, row + 1, column + 1), own[channel, name]
            panel.band(test.lag, -test.band, test.band, "nominal-soft", "independent residual")
            panel.curve(test.lag, test.value, "nominal", "residual", width=1.8)
            panel.heading(html.escape(f"{channel_name(channel)}, {reads}: p {p_value(test.p_value)}"))
    return _with_zero(figure).update_xaxes(title_text="residual behind the input [s]", row=rows)


def _gap(channels: Sequence[str]) -> float:
    """Return the space between rows of panels, of the height of the figure: less between many rows."""
    return min(0.08, 0.5 / len(channels))


def _with_zero(figure: go.Figure) -> go.Figure:
    """Draw a line at zero in every panel, below the curves."""
    figure.add_hline(0.0, row="all", col="all", layer="below", line={"color": COLOURS["muted"], "width": 1})
    return figure.update_yaxes(nticks=4)
