"""The residual over the phase of the beat: what repeats with every beat is no noise."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from mjfish.arrays import FloatArray
from mjfish.diagnosis import Diagnosis, Overlay
from mjfish.estimation.basis import beat_phase
from mjfish.fish import Cpg
from mjfish.frames import CHANNELS, UNITS
from mjfish.reporting.html import figure
from mjfish.reporting.html.counted import counted
from mjfish.reporting.html.words import CHANNEL_NAMES

#: Bins of one beat.
BINS = 24
_GAP = 0.08


def beat_figure(diagnosis: Diagnosis) -> dict[str, Any]:
    """Return the mean residual of both models over the beat of the last joint, one panel a channel.

    Of the held-out trials, or of all where none is held out; bands are two standard errors of the mean wide on each
    side.
    """
    held = [overlay for overlay in diagnosis.overlays if overlay.held_out]
    overlays = held or list(diagnosis.overlays)
    phase = _phases(diagnosis.nominal_model.fish.cpg, overlays)
    models = ["nominal"] if not diagnosis.best else ["nominal", "extended"]
    centre = (np.arange(BINS) + 0.5) / BINS
    data = []
    for model in models:
        left = np.concatenate(
            [overlay.trial.velocity - counted(diagnosis, overlay, getattr(overlay, model)) for overlay in overlays]
        )
        mean, error = binned(phase, left)
        for k in range(len(CHANNELS)):
            low, high = mean[:, k] - 2.0 * error[:, k], mean[:, k] + 2.0 * error[:, k]
            data.append(figure.band(centre, low, high, f"@{model}-soft", k + 1))
            data.append({**figure.curve(centre, mean[:, k], f"@{model}", k + 1, width=2.0), "name": model})
    return {"data": data, "layout": _layout()}


def binned(phase: FloatArray, residual: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return mean and its standard error (BINS, 3) of residuals (n, 3) by phase (n,) in beats; NaN in empty bins."""
    index = np.floor(np.mod(phase, 1.0) * BINS).astype(int) % BINS
    mean, error = np.full((BINS, 3), np.nan), np.full((BINS, 3), np.nan)
    reached = np.isfinite(residual).all(axis=1)
    for k in range(BINS):
        inside = residual[reached & (index == k)]
        if len(inside) > 1:
            mean[k] = inside.mean(axis=0)
            error[k] = inside.std(axis=0, ddof=1) / np.sqrt(len(inside))
    return mean, error


def _phases(cpg: Cpg | None, overlays: Sequence[Overlay]) -> FloatArray:
    return np.concatenate([beat_phase(cpg, overlay.trial) for overlay in overlays]) / (2.0 * np.pi)


def _layout() -> dict[str, Any]:
    count = len(CHANNELS)
    width = (1.0 - _GAP * (count - 1)) / count
    axes: dict[str, Any] = {}
    headings = []
    for k, channel in enumerate(CHANNELS):
        key = str(k + 1) if k else ""
        left = k * (width + _GAP)
        axes[figure.named_axis("x", k + 1)] = figure.axis(
            (left, min(left + width, 1.0)), f"y{key}", title=figure.axis_title("phase [beats]"), range=[0, 1]
        )
        axes[figure.named_axis("y", k + 1)] = figure.axis(
            (0.0, 1.0), f"x{key}", zeroline=True, zerolinecolor="@muted", zerolinewidth=1
        )
        headings.append(figure.heading(f"{CHANNEL_NAMES[channel]} [{UNITS[channel]}]", k + 1))
    return figure.layout(270, axes, headings)
