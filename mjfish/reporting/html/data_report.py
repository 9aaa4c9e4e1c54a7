"""The page of a dataset before a diagnosis: findings, causes that it cannot show, and its channels run by run."""

from __future__ import annotations

from pathlib import Path

import plotly.graph_objects as go

from mjfish.data import Trial
from mjfish.fish.frames import CHANNELS, UNITS
from mjfish.inspection import DataReport
from mjfish.numerics.formats import CHANNEL_NAMES
from mjfish.reporting.html.figures import Panel, panels
from mjfish.reporting.html.pages import Block, Section, write_figures

#: Runs whose figure is open at first.
_OPEN = 4


def write_data_report(report: DataReport, path: Path) -> None:
    """Write the page, whole or not at all, or raise `InputError`."""
    first, _, rest = report.summary().partition("\n")
    findings = [f"{finding.severity}: {finding.code}: {finding.message}" for finding in report.inspection.findings]
    cannot = [f"{name}: {reason}." for name, reason in report.undetectable.items()]
    cannot += [f"{', '.join(names)}: not told with the finding {code}." for code, names in report.unclear.items()]
    held_out = {trial.name for trial in report.dataset.split()[1]}
    blocks = tuple(
        Block(trial.name, _remark(trial, held_out=trial.name in held_out), _channels(trial), shown=number < _OPEN)
        for number, trial in enumerate(report.dataset.trials)
    )
    write_figures(
        path,
        Section("Findings", "\n\n".join([rest.partition("\n")[0], *findings]), {}, ()),
        Section("What the runs cannot show", "\n\n".join(cannot) or "Every cause may show.", {}, ()),
        Section("Channels", "As measured, run by run.", {}, blocks),
        title=first.removesuffix("."),
    )


def _remark(trial: Trial, *, held_out: bool) -> str:
    role = "held out" if held_out else "fitted"
    return f"{role}, {len(trial.time)} samples at {trial.rate:.4g} Hz, driven by {trial.driven_by}"


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
        for angle, colour in zip(trial.joint_angle.T, _colours(trial.joint_angle.shape[1]), strict=True):
            panel.curve(trial.time, angle, colour)
        panel.heading("joint angles [rad], head to tail from dark to light")
    return figure.update_xaxes(title_text="time [s]", row=rows)


def _colours(joints: int) -> list[str]:
    """Return a colour a joint: the first in ink, the last in the lightest."""
    scale = ("ink", "extended", "muted", "measured")
    return [scale[min(joint * len(scale) // max(joints, 1), len(scale) - 1)] for joint in range(joints)]
