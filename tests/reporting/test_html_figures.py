"""Figures: what is drawn is what was computed."""

from __future__ import annotations

import json

import numpy as np
import pytest
from diagnosed import diagnosis

from mjfish.estimation.intervals import Profile
from mjfish.reporting.html.figures import (
    COLOURS,
    COLUMNS,
    POINTS,
    compact,
    force_figure,
    profile_figure,
    thinned,
)
from mjfish.reporting.html.misfit import beat_figure
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


def test_the_missing_force_is_drawn_with_two_sigma_on_each_side() -> None:
    missing = diagnosis().force[1]
    figure = force_figure(missing)
    band, line = figure.data[0], figure.data[1]
    assert line.y == pytest.approx(missing.force[:, 0], rel=1e-4)
    count = len(line.y)
    wide = np.subtract(band.y[count:][::-1], band.y[:count])
    assert wide == pytest.approx(4.0 * missing.band[:, 0], rel=1e-3)


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
