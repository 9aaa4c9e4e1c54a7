"""Which figure and which page a result has, by its type."""

from __future__ import annotations

import functools
import html
import itertools
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import plotly.graph_objects as go

from mjfish.comparison import Comparison
from mjfish.data import Dataset, Trial
from mjfish.data.trial import SMOOTHED, for_looking
from mjfish.design import Plan
from mjfish.diagnosis import DiagnosisData, Splits
from mjfish.errors import InputError
from mjfish.estimation.identification import Identification
from mjfish.fish.frames import CHANNELS, UNITS
from mjfish.inspection import DataReport, Inspection
from mjfish.numerics.formats import CHANNEL_NAMES
from mjfish.reporting.html.diagnosis import write_diagnosis
from mjfish.reporting.html.figures import COLOURS, VELOCITIES, Panel, overlay_figure, panels, residual_figure
from mjfish.reporting.html.identification import sections
from mjfish.reporting.html.pages import Block, Section, write_figures
from mjfish.simulation import CrossCheck, Simulation

#: Colours of trials, in turn.
_TRIALS = ("extended", "nominal", "measured", "ink", "muted")
#: Colours of joints, head to tail from dark to light.
_JOINTS = ("ink", "extended", "muted", "measured")
#: Options of a plan that are drawn, and runs of a dataset whose figure is open at first.
_OPTIONS, _OPEN = 12, 4
#: Bars of a mechanism in the splits: attribute of its share, words, colour.
_LEVELS = (
    ("count", "named", "extended"),
    ("certain", "certain beside rivals", "nominal"),
    ("not_named", "not named, part of the best", "measured"),
)


@functools.singledispatch
def figure(result: Any) -> go.Figure:
    """Return the main figure of a result.

    Raises:
        InputError: this result has none.
    """
    raise InputError(f"{type(result).__name__} has no figure; print it, or read its to_dict()")


@figure.register
def _(result: DiagnosisData) -> go.Figure:
    """Draw a held-out trial, or else the first one, as measured and as the models predict it."""
    return overlay_figure(result, max(result.overlays, key=lambda overlay: overlay.held_out))


@figure.register
def _(result: Splits) -> go.Figure:
    """Draw in how many splits each mechanism is named, certain, or a part of the best."""
    shares, count = result.mechanisms[::-1], len(result.diagnosed)
    bars = {words: ([getattr(share, level) for share in shares], colour) for level, words, colour in _LEVELS}
    drawn = _level_bars([share.name for share in shares], bars).update_layout(barmode="stack")
    return drawn.update_xaxes(title_text=f"splits of {count}", range=[0, max(count, 1)])


def _level_bars(names: Sequence[str], bars: Mapping[str, tuple[Sequence[float], str]]) -> go.Figure:
    """Return level bars, a row a name, with values and colour of each kind of bar by its words."""
    drawn, rows = panels(1, height=120 + 26 * len(names)), [html.escape(name) for name in names]
    for words, (values, colour) in bars.items():
        drawn.add_bar(x=values, y=rows, name=words, orientation="h", marker_color=COLOURS[colour])
    return drawn.update_yaxes(type="category").update_layout(margin_l=160)


@figure.register
def _(result: Identification) -> go.Figure:
    """Draw a held-out trial, or else the first one, as measured and as the fitted model predicts it."""
    if result.assessment is None:
        raise InputError(f"{result.dataset.name}: the fit {result.fit.status} and has no figure; {result.fit.message}")
    return residual_figure(max(result.assessment.residuals, key=lambda residual: residual.role == "held_out"))


@figure.register
def _(result: Dataset) -> go.Figure:
    """Draw the velocities of every trial over time."""
    drawn, of_channels = _velocities()
    for k, panel in enumerate(of_channels):
        for trial, colour in zip(map(for_looking, result.trials), itertools.cycle(_TRIALS), strict=False):
            panel.curve(trial.time, trial.velocity[:, k], colour, html.escape(trial.name))
    return drawn.update_layout(title_text=None if all(trial.measured.any() for trial in result.trials) else SMOOTHED)


@figure.register
def _(result: Simulation) -> go.Figure:
    """Draw the velocities over time."""
    drawn, of_channels = _velocities()
    for k, panel in enumerate(of_channels):
        if (others := result.band) is not None:
            low, _, high = others.velocity[:, :, k]
            panel.band(others.time, low, high, "extended-soft", "simulated")
        panel.curve(result.time, result.velocity[:, k], "extended", "simulated")
    return drawn


def _velocities() -> tuple[go.Figure, list[Panel]]:
    """Return an empty figure of the velocities over time, and its panels, one a channel."""
    drawn = panels(len(VELOCITIES), height=480, headings=VELOCITIES, shared_xaxes=True, vertical_spacing=0.075)
    drawn.update_xaxes(title_text="time [s]", row=len(VELOCITIES))
    return drawn, [Panel(drawn, k + 1) for k in range(len(VELOCITIES))]


@figure.register
def _(result: Comparison) -> go.Figure:
    """Draw the nRMSE of every trial, a bar a channel."""
    drawn = panels(1, height=320)
    for channel, colour in zip(CHANNELS, ("nominal", "extended", "measured"), strict=True):
        scores = {
            html.escape(trial.trial): score.nrmse
            for trial in result.trials
            for score in trial.scores
            if (score.channel, score.part) == (channel, "whole")
        }
        drawn.add_bar(
            x=list(scores), y=list(scores.values()), name=CHANNEL_NAMES[channel], marker_color=COLOURS[colour]
        )
    if result.bound is not None:
        drawn.add_hline(result.bound, line={"color": COLOURS["muted"], "dash": "dot", "width": 1})
    return drawn.update_yaxes(title_text="nRMSE").update_xaxes(type="category")


@figure.register
def _(result: Plan) -> go.Figure:
    """Draw what the best options do: probability of the right verdict, or minimum detectable effect, now and after."""
    options = result.options[:_OPTIONS][::-1]
    separate = result.question.purpose == "separate"
    kind, title = (
        ("probability_", "probability of the right verdict") if separate else ("", "minimum detectable effect")
    )
    bars = {
        when: ([getattr(option.worst, kind + when) for option in options], colour)
        for when, colour in (("now", "measured"), ("after", "extended"))
    }
    return _level_bars([option.name for option in options], bars).update_xaxes(title_text=title)


@figure.register
def _(result: Inspection) -> go.Figure:
    """List the findings, worst first."""
    rows = [(str(f.severity), f.code, f.place, f.found, f.remedy) for f in result.findings]
    rows = rows or [("", "", "", "nothing was found", "")]
    cells = [[html.escape(text) for text in column] for column in zip(*rows, strict=True)]
    table = go.Table(
        header={"values": ["severity", "code", "place", "found", "remedy"], "align": "left"},
        cells={"values": cells, "align": "left"},
        columnwidth=[1, 2, 2, 4, 4],
    )
    return go.Figure(table).update_layout(template="mjfish")


@figure.register
def _(result: CrossCheck) -> go.Figure:
    """Draw the largest differences between the engines over the step, and the bound."""
    drawn = panels(1, height=320)
    steps = np.array([level.step for level in result.levels])
    for channel, colour in zip(CHANNELS, ("nominal", "extended", "measured"), strict=True):
        ratios = np.array([level.ratio[channel] for level in result.levels])
        Panel(drawn, 1).marked(steps, ratios, colour, CHANNEL_NAMES[channel])
    drawn.add_hline(result.bound, line={"color": COLOURS["muted"], "dash": "dot", "width": 1})
    drawn.update_xaxes(type="log", title_text="step [s]")
    return drawn.update_yaxes(type="log", title_text="difference / range")


@functools.singledispatch
def write_report(result: Any, path: Path) -> None:
    """Write a result as one HTML page: its summary and its figure, where it has no page of its own.

    Raises:
        InputError: it has no figure, or the file cannot be written.
    """
    first, _, rest = result.summary().partition("\n")
    write_figures(path, Section(first, rest, {}, (Block(type(result).__name__, "", figure(result)),)))


write_report.register(DiagnosisData, write_diagnosis)


@write_report.register
def _(result: Splits, path: Path) -> None:
    write_diagnosis(result.diagnosis, path, result)


@write_report.register
def _(result: Identification, path: Path) -> None:
    assessment = result.assessment
    if assessment is None:
        raise InputError(f"{result.dataset.name}: the fit {result.fit.status} and has no page; {result.fit.message}")
    name = result.dataset.name
    found = sections(name, assessment.residuals, assessment.residual_tests).values()
    own = [replace(section, title=section.title.removeprefix(f"{name}: ").capitalize()) for section in found]
    write_figures(path, *own, title=f"Identification of {name}", lead=result.summary())


@write_report.register
def _(result: DataReport, path: Path) -> None:
    """Write findings, causes that the runs cannot show, and the channels run by run."""
    first, _, rest = result.summary().partition("\n")
    findings = [f"{finding.severity}: {finding.code}: {finding.message}" for finding in result.inspection.findings]
    cannot = [f"{name}: {reason}." for name, reason in result.undetectable.items()]
    cannot += [f"{', '.join(names)}: not told with the finding {code}." for code, names in result.unclear.items()]
    held_out = {trial.name for trial in result.dataset.split()[1]}
    blocks = tuple(
        Block(
            trial.name,
            f"{'held out' if trial.name in held_out else 'fitted'}, {len(trial.time)} samples at {trial.rate:.4g} Hz, "
            f"driven by {trial.driven_by}",
            _channels(trial),
            shown=number < _OPEN,
        )
        for number, trial in enumerate(result.dataset.trials)
    )
    write_figures(
        path,
        Section("Findings", "\n\n".join([rest.partition("\n")[0], *findings]), {}, ()),
        Section("What the runs cannot show", "\n\n".join(cannot) or "Every cause may show.", {}, ()),
        Section("Channels", "As measured, run by run.", {}, blocks),
        title=first.removesuffix("."),
    )


def _channels(trial: Trial) -> go.Figure:
    """Draw the velocities that were measured, the channels of every sensor, and the joint angles."""
    shown = [
        (trial.time, trial.velocity[:, k], f"{CHANNEL_NAMES[name]} [{UNITS[name]}]")
        for k, name in enumerate(CHANNELS)
        if trial.measured[k]
    ]
    shown += [
        (sensor.time, values, f"{sensor.name}: {channel} [{unit}]")
        for sensor in trial.sensors
        for values, channel, unit in zip(sensor.values.T, sensor.channels, sensor.units, strict=True)
    ]
    rows = max(len(shown) + (trial.joint_angle is not None), 1)
    figure = panels(rows, height=60 + 120 * rows, shared_xaxes=True, vertical_spacing=0.3 / rows)
    for row, (time, values, title) in enumerate(shown, start=1):
        panel = Panel(figure, row)
        panel.curve(time, values, "nominal")
        panel.heading(title)
    if trial.joint_angle is not None:
        panel = Panel(figure, rows)
        for joint, angle in enumerate(trial.joint_angle.T):
            panel.curve(trial.time, angle, _JOINTS[joint * len(_JOINTS) // trial.joint_angle.shape[1]])
        panel.heading("joint angles [rad], head to tail from dark to light")
    return figure.update_xaxes(title_text="time [s]", row=rows)
