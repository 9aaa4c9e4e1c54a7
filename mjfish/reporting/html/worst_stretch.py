"""The picture of the first screen: the stretch of a held-out trial on which the nominal model is worst."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import plotly.graph_objects as go
from numpy.lib.stride_tricks import sliding_window_view

from mjfish.diagnosis import DiagnosisData, Overlay
from mjfish.fish.frames import CHANNELS
from mjfish.numerics.formats import CHANNEL_NAMES
from mjfish.reporting.html.figures import VELOCITIES, Panel, panels, scored_predictions

#: Beats that are shown.
_BEATS = 6.0


@dataclass(frozen=True, eq=False)
class WorstStretch:
    """Some beats of one channel of one trial.

    Attributes:
        overlay: the trial with its predictions.
        channel: its name.
        first, last: its samples from and up to, without `last`.
    """

    overlay: Overlay
    channel: str
    first: int
    last: int

    @property
    def title(self) -> str:
        """What is shown, in words."""
        trial, name = self.overlay.trial, CHANNEL_NAMES[self.channel]
        held_out = "held-out " if self.overlay.held_out else ""
        start, end = trial.time[self.first], trial.time[self.last - 1]
        return (
            f"{name[0].upper()}{name[1:]} in {held_out}trial {trial.name}, {start:.1f} to {end:.1f} s: "
            "where the nominal model is worst"
        )


def worst_stretch(diagnosis: DiagnosisData) -> WorstStretch:
    """Return the beats with the largest root mean square of the nominal error, as a share of the channel's range.

    They are of held-out trials, or of any where none is held out.
    """
    overlays = [overlay for overlay in diagnosis.overlays if overlay.held_out] or list(diagnosis.overlays)
    found = [_worst(diagnosis, overlay, k) for overlay in overlays for k in range(len(CHANNELS))]
    return max(found, key=lambda pair: pair[0])[1]


def stretch_figure(diagnosis: DiagnosisData, stretch: WorstStretch) -> go.Figure:
    """Return the stretch as measured and as the models predict it."""
    trial, k = stretch.overlay.trial, CHANNELS.index(stretch.channel)
    window = slice(stretch.first, stretch.last)
    figure = panels(1, height=280, headings=[VELOCITIES[k]])
    panel = Panel(figure, 1)
    panel.curve(trial.time[window], trial.velocity[window, k], "measured", "measured", width=4.0)
    for model, values in scored_predictions(diagnosis, stretch.overlay).items():
        panel.curve(trial.time[window], values[window, k], model, model, width=1.8)
    return figure.update_xaxes(title_text="time [s]")


def _worst(diagnosis: DiagnosisData, overlay: Overlay, k: int) -> tuple[float, WorstStretch]:
    """Return the mean square error, by the range of the channel, of the worst stretch of a channel; and the stretch."""
    measured = overlay.trial.velocity[:, k]
    error = measured - scored_predictions(diagnosis, overlay)["nominal"][:, k]
    length = _samples(overlay)
    seen = measured[np.isfinite(measured)]
    width = max(float(np.ptp(seen)), 1e-12) if len(seen) else np.inf
    squares = np.where(np.isfinite(error), error / width, 0.0) ** 2
    means = sliding_window_view(squares, length).mean(axis=1)
    first = int(np.argmax(means))
    return float(means[first]), WorstStretch(overlay, CHANNELS[k], first, first + length)


def _samples(overlay: Overlay) -> int:
    """Return how many samples `_BEATS` beats of a trial have; all of a shorter one."""
    beats = abs(float(overlay.phase[-1] - overlay.phase[0])) / (2.0 * np.pi)
    count = len(overlay.trial.time)
    return min(count, max(int(np.ceil(count * _BEATS / max(beats, 1e-9))), 2))
