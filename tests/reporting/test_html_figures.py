"""Figures: what is drawn is what was computed."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from diagnosed import diagnosis

from mjfish.estimation.intervals import Profile
from mjfish.reporting.html.figures import (
    BINS,
    COLOURS,
    COLUMNS,
    POINTS,
    beat_figure,
    binned,
    compact,
    force_figure,
    profile_figure,
    thinned,
)
from mjfish.reporting.html.pages import themed


def test_a_long_curve_keeps_its_extremes() -> None:
    time = np.linspace(0.0, 100.0, 50_000)
    wave = np.sin(60.0 * time)
    wave[12_345] = 7.0
    wave[40_001] = -9.0
    x, y = thinned(time, wave)
    assert len(x) <= POINTS
    assert np.all(np.diff(x) > 0.0)
    assert (y.max(), y.min()) == (7.0, -9.0)
    assert x[np.argmax(y)] == time[12_345]


def test_a_short_curve_is_shown_as_it_is() -> None:
    time = np.linspace(0.0, 1.0, POINTS)
    assert thinned(time, time)[0] is time
    assert compact(np.array([1.0 / 3.0, np.nan, -2e-9])) == [0.33333, None, -2e-9]


def test_what_repeats_with_the_beat_is_seen_and_what_does_not_averages_out() -> None:
    rng = np.random.default_rng(0)
    phase = rng.uniform(0.0, 40.0, 20_000)
    residual = np.stack([0.1 * np.cos(2.0 * np.pi * phase), np.zeros_like(phase), np.zeros_like(phase)], axis=1)
    residual += rng.normal(size=residual.shape)
    mean, error = binned(phase, residual)
    centre = (np.arange(BINS) + 0.5) / BINS
    assert np.max(np.abs(mean[:, 0] - 0.1 * np.cos(2.0 * np.pi * centre)) / error[:, 0]) < 4.0
    assert np.max(np.abs(mean[:, 1]) / error[:, 1]) < 4.0
    np.testing.assert_allclose(error, 1.0 / np.sqrt(len(phase) / BINS), rtol=0.1)


def test_empty_bins_of_the_beat_and_diverged_samples_are_left_out() -> None:
    phase = np.full(10, 0.5 / BINS)
    residual = np.zeros((10, 3))
    residual[3] = np.nan
    mean, _ = binned(phase, residual)
    assert np.all(mean[0] == 0.0)
    assert np.all(np.isnan(mean[1:]))


def test_the_beat_is_shown_of_held_out_trials_alone_where_there_are_any() -> None:
    found = diagnosis()
    without = replace(found, overlays=found.overlays[1:])
    assert beat_figure(found) == beat_figure(without)
    assert beat_figure(diagnosis(held_out=False)) != beat_figure(found)


def test_the_missing_force_is_that_of_the_densest_trial_with_two_sigma_on_each_side() -> None:
    found = diagnosis()
    figure = force_figure(found)
    assert figure is not None
    band, line = figure.data[0], figure.data[1]
    assert line.y == pytest.approx(found.force[0].force[:, 0], rel=1e-4)
    count = len(line.y)
    wide = np.subtract(band.y[count:][::-1], band.y[:count])
    assert wide == pytest.approx(4.0 * found.force[0].band[:, 0], rel=1e-3)
    assert force_figure(diagnosis("nothing_wrong")) is None


def _profile(name: str = "c_d.head", rise: float = 4.0) -> Profile:
    values = np.linspace(1.0, 2.0, 9)
    return Profile(
        name=name, unit="-", estimate=1.5, sigma=0.25, values=values, rise=rise * (2.0 * values - 3.0) ** 2,
        others=np.zeros((9, 0)), scale=1.0, level=0.95, threshold=3.84, low=1.01, high=1.99, low_side="crossed",
        high_side="crossed", status="ok", better={},
    )  # fmt: skip


def test_every_parameter_has_a_panel_of_its_own() -> None:
    figure = profile_figure([_profile(f"c_d.{k}") for k in range(COLUMNS + 2)])
    assert {trace.xaxis for trace in figure.data} == {"x", "x2", "x3", "x4", "x5"}
    assert [note.text for note in figure.layout.annotations] == [f"c_d.{k}" for k in range(COLUMNS + 2)]


def test_the_threshold_the_interval_and_the_parabola_are_where_they_belong() -> None:
    figure = profile_figure([_profile()])
    parabola, refits = figure.data
    band, threshold, estimate = figure.layout.shapes
    assert (band.x0, band.x1) == (1.01, 1.99)
    assert threshold.y0 == threshold.y1 == 3.84
    assert estimate.x0 == 1.5
    assert max(refits.y) == 4.0
    at = np.array(parabola.x)
    np.testing.assert_allclose(parabola.y, ((at - 1.5) / 0.25) ** 2, atol=1e-3)


def test_a_name_is_text_and_a_figure_without_panels_has_no_data() -> None:
    assert profile_figure([_profile("<b>own</b>.size")]).layout.annotations[0].text.startswith("&lt;b&gt;")
    assert not profile_figure([]).data


def test_a_page_draws_with_its_own_colours() -> None:
    """Every colour of the figure becomes a name that the style of the page defines in the light and in the dark."""
    text = json.dumps(themed(beat_figure(diagnosis())))
    assert '"@nominal"' in text
    assert '"@extended-soft"' in text
    assert not any(colour in text for colour in COLOURS.values())
