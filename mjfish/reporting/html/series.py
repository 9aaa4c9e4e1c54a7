"""Measured against simulated over time, and the residuals beside them: one figure a trial."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from mjfish.diagnosis import Diagnosis, Overlay
from mjfish.frames import CHANNELS, UNITS
from mjfish.reporting.html import figure
from mjfish.reporting.html.counted import counted
from mjfish.reporting.html.words import CHANNEL_NAMES

#: Panels in columns: velocities on the left, residuals on the right; rows are channels.
_COLUMNS = ((0.0, 0.57), (0.635, 1.0))
_GAP = 0.075


@dataclass(frozen=True)
class TrialFigure:
    """The figure of one trial, with what is said about it."""

    name: str
    held_out: bool
    duration: float
    changes: tuple[float, ...]
    spec: dict[str, Any]


def trial_figures(diagnosis: Diagnosis) -> list[TrialFigure]:
    """Return the figures of all trials, held-out ones first."""
    overlays = sorted(diagnosis.overlays, key=lambda overlay: not overlay.held_out)
    return [_of(diagnosis, overlay) for overlay in overlays]


def _of(diagnosis: Diagnosis, overlay: Overlay) -> TrialFigure:
    trial = overlay.trial
    changes = tuple(segment.start for segment in trial.drive[1:])
    return TrialFigure(
        name=trial.name,
        held_out=overlay.held_out,
        duration=float(trial.time[-1] - trial.time[0]),
        changes=changes,
        spec={"data": _curves(diagnosis, overlay), "layout": panels(changes)},
    )


def _curves(diagnosis: Diagnosis, overlay: Overlay) -> list[figure.Trace]:
    time, measured = overlay.trial.time, overlay.trial.velocity
    models = {"@nominal": counted(diagnosis, overlay, overlay.nominal)}
    if diagnosis.best:
        models["@extended"] = counted(diagnosis, overlay, overlay.extended)
    data = []
    for k in range(len(CHANNELS)):
        data.append({**figure.curve(time, measured[:, k], "@measured", k + 1, width=3.2), "name": "measured"})
        for colour, predicted in models.items():
            name = colour[1:]
            data.append({**figure.curve(time, predicted[:, k], colour, k + 1), "name": name})
            left = measured[:, k] - predicted[:, k]
            data.append({**figure.curve(time, left, colour, k + 1 + len(CHANNELS), width=1.0), "name": name})
    return data


def panels(changes: tuple[float, ...]) -> dict[str, Any]:
    """Return the layout: velocities on the left, residuals on the right, a line at each change of the drive [s]."""
    count = len(CHANNELS)
    height = (1.0 - _GAP * (count - 1)) / count
    axes: dict[str, Any] = {}
    shapes, headings = [], []
    for column, domain in enumerate(_COLUMNS):
        for row, channel in enumerate(CHANNELS):
            panel = column * count + row + 1
            key = str(panel) if panel > 1 else ""
            top = 1.0 - row * (height + _GAP)
            what = CHANNEL_NAMES[channel] + (", measured − simulated" if column else "")
            headings.append(figure.heading(f"{what} [{UNITS[channel]}]", panel))
            last = row == count - 1
            x = figure.axis(domain, f"y{key}", showticklabels=last, matches="x" if panel > 1 else None)
            x |= {"title": figure.axis_title("time [s]")} if last else {}
            axes[figure.named_axis("x", panel)] = {k: v for k, v in x.items() if v is not None}
            axes[figure.named_axis("y", panel)] = figure.axis((max(top - height, 0.0), top), f"x{key}")
            shapes += [_mark(f"x{key}", f"y{key} domain", time) for time in changes]
    return figure.layout(540, axes, headings, shapes)


def _mark(x: str, y: str, time: float) -> dict[str, Any]:
    """Return a dotted line where the drive changes."""
    line = {"color": "@muted", "width": 1, "dash": "dot"}
    return {"type": "line", "xref": x, "yref": y, "x0": time, "x1": time, "y0": 0, "y1": 1, "line": line}
