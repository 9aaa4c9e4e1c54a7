"""What is left over the beat and over the speed: means of the right samples, with their errors."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import plotly.graph_objects as go
import pytest
from diagnosed import diagnosis

from mjfish.diagnosis import Diagnosis
from mjfish.reporting.html.misfit import BINS, SPEEDS, beat_figure, binned, by_phase, by_quantiles, speed_figure


def test_what_repeats_with_the_beat_is_seen_and_what_does_not_averages_out() -> None:
    rng = np.random.default_rng(0)
    phase = rng.uniform(0.0, 40.0, 20_000)
    residual = np.stack([0.1 * np.cos(2.0 * np.pi * phase), np.zeros_like(phase), np.zeros_like(phase)], axis=1)
    residual += rng.normal(size=residual.shape)
    mean, error = binned(by_phase(phase), residual, BINS)
    centre = (np.arange(BINS) + 0.5) / BINS
    assert np.max(np.abs(mean[:, 0] - 0.1 * np.cos(2.0 * np.pi * centre)) / error[:, 0]) < 4.0
    assert np.max(np.abs(mean[:, 1]) / error[:, 1]) < 4.0
    np.testing.assert_allclose(error, 1.0 / np.sqrt(len(phase) / BINS), rtol=0.1)


def test_an_error_that_bends_with_the_speed_is_seen_at_its_speeds() -> None:
    rng = np.random.default_rng(0)
    speed = rng.uniform(0.1, 0.5, 6_000)
    residual = np.stack([speed**2, 0.0 * speed, 0.0 * speed], axis=1)
    index, centre = by_quantiles(speed, SPEEDS)
    counts = np.bincount(index, minlength=SPEEDS)
    assert counts.min() == counts.max() == len(speed) / SPEEDS
    mean, _ = binned(index, residual, SPEEDS)
    width = 0.4 / SPEEDS
    np.testing.assert_allclose(mean[:, 0], centre**2 + width**2 / 12.0, rtol=1e-2)


def test_empty_bins_and_diverged_samples_are_left_out_channel_by_channel() -> None:
    phase = np.full(10, 0.5 / BINS)
    residual = np.zeros((10, 3))
    residual[3] = np.nan
    residual[:, 2] = np.nan  # a channel that was not measured hides no other
    mean, _ = binned(by_phase(phase), residual, BINS)
    assert np.all(mean[0, :2] == 0.0)
    assert np.isnan(mean[0, 2])
    assert np.all(np.isnan(mean[1:]))
    index, centre = by_quantiles(np.array([np.nan, 1.0, 2.0]), 2)
    assert index.tolist() == [-1, 0, 1]
    assert centre.tolist() == [1.0, 2.0]
    assert np.all(by_quantiles(np.full(3, np.nan), 2)[0] == -1)


@pytest.mark.parametrize("drawn", [beat_figure, speed_figure])
def test_held_out_trials_alone_are_shown_where_there_are_any(drawn: Callable[[Diagnosis], go.Figure]) -> None:
    found = diagnosis()
    without = replace(found, overlays=found.overlays[1:])
    assert drawn(found) == drawn(without)
    assert drawn(diagnosis(held_out=False)) != drawn(found)
