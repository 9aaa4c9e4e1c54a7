"""Figures of what the models of a diagnosis leave: the mean residual over the beat, and over the speed."""

from __future__ import annotations

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray

from mjfish.diagnosis import DiagnosisData, Overlay
from mjfish.numerics.arrays import FloatArray
from mjfish.reporting.html.figures import VELOCITIES, Panel, panels, scored_predictions

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
    surge = np.concatenate([overlay.nominal[:, 0] for overlay in _shown(diagnosis)])
    index, centre = by_quantiles(surge, SPEEDS)
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
    means = [values[index == k].mean() if np.any(index == k) else np.nan for k in range(bins)]
    return index, np.array(means)


def binned(index: NDArray[np.int_], residual: FloatArray, bins: int) -> tuple[FloatArray, FloatArray]:
    """Return mean and its standard error (bins, 3) of residuals (n, 3) by bin (n,); NaN in empty bins."""
    mean, error = np.full((bins, 3), np.nan), np.full((bins, 3), np.nan)
    for k in range(bins):
        for channel in range(3):
            inside = residual[np.isfinite(residual[:, channel]) & (index == k), channel]
            if len(inside) > 1:
                mean[k, channel] = inside.mean()
                error[k, channel] = inside.std(ddof=1) / np.sqrt(len(inside))
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
