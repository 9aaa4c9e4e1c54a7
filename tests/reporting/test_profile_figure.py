"""The figure of profiles: one panel a parameter, threshold, interval and parabola where they are."""

from __future__ import annotations

import json

import numpy as np
import plotly.graph_objects as go

from mjfish.estimation.uncertainty.profile import Profile
from mjfish.reporting.html.profiles import COLUMNS, profile_figure


def _profile(name: str = "c_d.head", rise: float = 4.0) -> Profile:
    values = np.linspace(1.0, 2.0, 9)
    return Profile(
        name=name, unit="-", estimate=1.5, sigma=0.25, values=values, rise=rise * (2.0 * values - 3.0) ** 2,
        others=np.zeros((9, 0)), scale=1.0, level=0.95, threshold=3.84, low=1.01, high=1.99, low_side="crossed",
        high_side="crossed", status="ok", better={},
    )  # fmt: skip


def test_every_parameter_has_a_panel_of_its_own_inside_the_figure() -> None:
    """Axes are numbered as plotly wants them, panels lie within the paper and do not overlap."""
    spec = profile_figure([_profile(f"c_d.{k}") for k in range(COLUMNS + 2)])
    drawn = go.Figure(_coloured(spec))
    places = {}
    for k in range(COLUMNS + 2):
        number = "" if k == 0 else str(k + 1)
        x, y = (drawn.layout[f"{letter}axis{number}"].domain for letter in "xy")
        assert 0.0 <= x[0] < x[1] <= 1.0
        assert 0.0 <= y[0] < y[1] <= 1.0
        places[(round(x[0], 3), round(y[0], 3))] = k
    assert len(places) == COLUMNS + 2
    assert {trace.xaxis for trace in drawn.data} == {"x", "x2", "x3", "x4", "x5"}


def test_the_threshold_the_interval_and_the_parabola_are_where_they_belong() -> None:
    spec = profile_figure([_profile()])
    parabola, refits = spec["data"]
    band, threshold, estimate = spec["layout"]["shapes"]
    assert (band["x0"], band["x1"]) == (1.01, 1.99)
    assert threshold["y0"] == threshold["y1"] == 3.84
    assert estimate["x0"] == 1.5
    assert max(refits["y"]) == 4.0
    at = np.array(parabola["x"])
    np.testing.assert_allclose(parabola["y"], ((at - 1.5) / 0.25) ** 2, atol=1e-3)
    assert spec["layout"]["annotations"][0]["text"] == "c_d.head"


def test_a_name_is_text_and_a_figure_is_plain_data() -> None:
    spec = profile_figure([_profile("<b>own</b>.size")])
    assert "&lt;b&gt;" in json.dumps(spec)
    assert json.loads(json.dumps(profile_figure([])))["data"] == []


def _coloured(spec: object) -> object:
    """Return a specification with the page's colour names made black, so that plotly checks the rest."""
    if isinstance(spec, dict):
        return {key: _coloured(value) for key, value in spec.items()}
    if isinstance(spec, list):
        return [_coloured(value) for value in spec]
    return "black" if isinstance(spec, str) and spec.startswith("@") else spec
