"""Figures of the misfit of a diagnosis: where the nominal model is worst, and the mean residual over beat and speed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import plotly.graph_objects as go
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from mjfish.diagnosis import DiagnosisData, Overlay
from mjfish.fish.frames import CHANNELS
from mjfish.numerics.arrays import FloatArray
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
    found = (_worst(diagnosis, overlay, k) for overlay in _shown(diagnosis) for k in range(len(CHANNELS)))
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
    means = sliding_window_view(np.where(np.isfinite(error), error / width, 0.0) ** 2, length).mean(axis=1)
    first = int(np.argmax(means))
    return float(means[first]), WorstStretch(overlay, CHANNELS[k], first, first + length)


def _samples(overlay: Overlay) -> int:
    """Return how many samples `_BEATS` beats of a trial have; all of a shorter one."""
    count = len(overlay.trial.time)
    beats = abs(float(overlay.phase[-1] - overlay.phase[0])) / (2.0 * np.pi)
    return min(count, max(int(np.ceil(count * _BEATS / max(beats, 1e-9))), 2))


#: Bins of one beat, and of the speeds.
BINS = 24
SPEEDS = 12


def beat_figure(diagnosis: DiagnosisData) -> go.Figure:
    """Return the mean residual of the models over the beat of the last joint, one panel a channel.

    Of the held-out trials, or of all where none is held out; bands are two standard errors of the mean wide on each
    side.
    """
    phase = np.concatenate([overlay.phase for overlay in _shown(diagnosis)]) / (2.0 * np.pi)
    figure = _mean_figure(diagnosis, by_phase(phase), (np.arange(BINS) + 0.5) / BINS)
    return figure.update_xaxes(title_text="phase [beats]", range=[0, 1])


def speed_figure(diagnosis: DiagnosisData) -> go.Figure:
    """Return the mean residual of the models over the surge that the nominal model has, as `beat_figure` does.

    Each of `SPEEDS` bins has as many samples. The measured surge is no axis: its noise is in the residual, too.
    """
    index, centre = by_quantiles(np.concatenate([overlay.nominal[:, 0] for overlay in _shown(diagnosis)]), SPEEDS)
    return _mean_figure(diagnosis, index, centre).update_xaxes(title_text="surge of the nominal model [m/s]")


def by_phase(phase: FloatArray) -> NDArray[np.int_]:
    """Return the bin of each phase (n,) in beats."""
    return np.asarray(np.floor(np.mod(phase, 1.0) * BINS).astype(int) % BINS)


def by_quantiles(values: FloatArray, bins: int) -> tuple[NDArray[np.int_], FloatArray]:
    """Return the bin of each value (n,), -1 where it is not finite, and the mean of the values in each (bins,).

    The bins have equally many values; the mean of an empty one is NaN.
    """
    finite = np.isfinite(values)
    if not np.any(finite):
        return np.full(len(values), -1), np.full(bins, np.nan)
    edges = np.quantile(values[finite], np.arange(1, bins) / bins)
    index = np.where(finite, np.searchsorted(edges, np.where(finite, values, 0.0), side="right"), -1)
    return index, np.array([values[index == k].mean() if np.any(index == k) else np.nan for k in range(bins)])


def binned(index: NDArray[np.int_], residual: FloatArray, bins: int) -> tuple[FloatArray, FloatArray]:
    """Return mean and its standard error (bins, 3) of residuals (n, 3) by bin (n,); NaN in empty bins."""
    mean, error = np.full((2, bins, 3), np.nan)
    for k, channel in np.ndindex(bins, 3):
        inside = residual[np.isfinite(residual[:, channel]) & (index == k), channel]
        if len(inside) > 1:
            mean[k, channel], error[k, channel] = inside.mean(), inside.std(ddof=1) / np.sqrt(len(inside))
    return mean, error


def _shown(diagnosis: DiagnosisData) -> list[Overlay]:
    return [overlay for overlay in diagnosis.overlays if overlay.held_out] or list(diagnosis.overlays)


def _mean_figure(diagnosis: DiagnosisData, index: NDArray[np.int_], centre: FloatArray) -> go.Figure:
    overlays = _shown(diagnosis)
    predicted = [scored_predictions(diagnosis, overlay) for overlay in overlays]
    figure = panels(1, len(VELOCITIES), height=270, headings=VELOCITIES, horizontal_spacing=0.08)
    for model in predicted[0]:
        residual = [o.trial.velocity - models[model] for o, models in zip(overlays, predicted, strict=True)]
        mean, error = binned(index, np.concatenate(residual), len(centre))
        for k in range(len(VELOCITIES)):
            panel = Panel(figure, 1, k + 1)
            low, high = mean[:, k] - 2.0 * error[:, k], mean[:, k] + 2.0 * error[:, k]
            filled = np.isfinite(low)
            panel.band(centre[filled], low[filled], high[filled], f"{model}-soft", model)
            panel.curve(centre, mean[:, k], model, model, width=2.0)
    return figure.update_yaxes(zeroline=True)
