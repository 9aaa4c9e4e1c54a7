"""Every result has a figure, and a page or a refusal that says why not."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from diagnosed import diagnosis, splits

from mjfish import reporting
from mjfish.comparison import Comparison, TrialComparison
from mjfish.data import Dataset
from mjfish.design import Option, Pair, Plan, Question
from mjfish.errors import InputError
from mjfish.estimation.residual import Agreement
from mjfish.fish.frames import CHANNELS
from mjfish.inspection import Inspection
from mjfish.simulation import CrossCheck, Level


def _comparison(bound: float | None = None) -> Comparison:
    trials = []
    for name, nrmse in (("slow", 0.01), ("fast", 0.03)):
        scores = tuple(
            Agreement(name, "fit", channel, "whole", None, 9, nrmse, 1.0, nrmse + 0.1 * k, 90.0, "m/s")
            for k, channel in enumerate(CHANNELS)
        )
        trials.append(TrialComparison(name, "fit", Path(f"{name}.csv"), "covered", scores))
    return Comparison("pool", tuple(trials), (), bound)


def test_a_diagnosis_shows_a_held_out_trial_with_a_legend() -> None:
    figure = reporting.figure(diagnosis())
    held_out = diagnosis().overlays[1].trial
    (measured, *models) = figure.select_traces(row=3, col=1)
    np.testing.assert_allclose(measured.y, held_out.velocity[:, 2], rtol=1e-4, atol=1e-9)
    assert [model.name for model in models] == ["nominal", "extended"]
    assert [trace.name for trace in figure.data if trace.showlegend] == ["measured", "nominal", "extended"]
    assert figure.layout.showlegend


def test_a_comparison_shows_a_bar_a_channel_and_trial_and_its_bound() -> None:
    figure = reporting.figure(_comparison(bound=0.1))
    assert [bar.name for bar in figure.data] == ["surge", "sway", "yaw rate"]
    assert list(figure.data[2].x) == ["slow", "fast"]
    np.testing.assert_allclose(figure.data[2].y, [0.21, 0.23])
    assert figure.layout.shapes[0].y0 == 0.1


@pytest.mark.parametrize("purpose", ["separate", "see"])
def test_a_plan_shows_what_its_options_do_best_on_top(purpose: str) -> None:
    pair = Pair("servo_lag", "time_offset" if purpose == "separate" else "", 1.0, 0.5, 0.2, 0.9)
    options = tuple(Option("run", f"run {k}", "", 10.0, 1.0 / (k + 1), (pair,)) for k in range(20))
    plan = Plan("pool", "ok", "", Question(purpose, ("servo_lag", "time_offset")), options)  # type: ignore[arg-type]
    now, after = reporting.figure(plan).data
    assert len(now.y) == 12
    assert now.y[-1] == "run 0"
    assert (now.x[0], after.x[0]) == ((0.2, 0.9) if purpose == "separate" else (1.0, 0.5))


def test_a_cross_check_shows_differences_that_fall_with_the_step() -> None:
    ratios = dict.fromkeys(CHANNELS, 1e-4)
    levels = (Level(1e-3, ratios, ratios), Level(5e-4, ratios, dict.fromkeys(CHANNELS, 2.5e-5)))
    found = CrossCheck("pike", "v1", "corrected", ratios, levels, (2.0,), 1e-3, "agrees", "")
    figure = reporting.figure(found)
    assert figure.layout.xaxis.type == figure.layout.yaxis.type == "log"
    assert list(figure.data[0].x) == [1e-3, 5e-4]
    assert list(figure.data[1].y) == [1e-4, 2.5e-5]


def test_findings_are_listed_and_none_are_said_to_be_none() -> None:
    assert "nothing was found" in reporting.figure(Inspection()).data[0].cells["values"][3]


#: What a page or a notebook may not have: an address of a library, or of anything that is loaded.
LOADED = re.compile(r"cdn|<script[^>]*\bsrc=|<link[^>]*\bhref=|@import|import\s*\(?[\"']http", re.IGNORECASE)


@pytest.mark.parametrize("result", [diagnosis, splits, _comparison, lambda: diagnosis().dataset, lambda: Inspection()])
def test_nothing_that_is_shown_or_saved_loads_anything_from_a_network(
    result: Callable[[], Any], tmp_path: Path
) -> None:
    """Plotly's own display in a notebook names the address of another library, and its code those of maps."""
    found = result()
    drawn = found.plot()
    assert drawn._ipython_display_ is None, "plotly's own display would come first"
    shown = [drawn._repr_mimebundle_()["text/html"]]
    if not isinstance(found, Dataset):
        found.report(tmp_path / "page.html")
        shown += [found._repr_html_(), (tmp_path / "page.html").read_text(encoding="utf-8")]
    for text in shown:
        assert not LOADED.search(text), LOADED.search(text)
        assert re.search(r"Plotly\.(newPlot|react)\(", text)
        assert len(text) > 3e6, "the library is not in it"


def test_a_notebook_shows_the_summary_as_text_and_the_figure() -> None:
    shown = reporting.notebook(_comparison())
    assert shown.startswith("<pre>pool: rollouts against measurements, good\nslow: nRMSE 0.21 at worst\n")
    assert "Plotly.newPlot" in shown


@dataclass(frozen=True)
class Bare:
    """A result of a kind that nobody draws."""

    def summary(self) -> str:
        """Return a line."""
        return "nothing <b>to</b> draw"


def test_a_result_without_a_figure_is_shown_as_text_and_refused_elsewhere(tmp_path: Path) -> None:
    assert reporting.notebook(Bare()) == "<pre>nothing &lt;b&gt;to&lt;/b&gt; draw</pre>"
    with pytest.raises(InputError, match="Bare has no figure"):
        reporting.figure(Bare())
    with pytest.raises(InputError, match="Bare has no figure"):
        reporting.write_report(Bare(), tmp_path / "a.html")
    with pytest.raises(InputError, match="Bare has no swimming to log"):
        reporting.write_log(Bare(), tmp_path / "a.rrd")
    assert list(tmp_path.iterdir()) == []


def test_a_result_without_a_page_of_its_own_has_its_summary_and_figure_on_one(tmp_path: Path) -> None:
    _comparison().report(tmp_path / "a.html")
    page = (tmp_path / "a.html").read_text(encoding="utf-8")
    assert "<h1>pool: rollouts against measurements, good</h1>" in page
    assert page.count('<script type="application/json">') == 1


def test_a_comparison_is_a_result(tmp_path: Path) -> None:
    found = _comparison(bound=0.22)
    assert repr(found) == found.summary()
    assert "not good: 1 of 2" in found.summary()
    assert len(found.summary().splitlines()) <= 10
    found.save(tmp_path / "a.json")
    assert found.to_dict()["trials"][1]["shifts"] == {}
    assert found.plot().data[0].name == "surge"
    with pytest.raises(InputError, match="Comparison has no swimming to log"):
        found.log(tmp_path / "a.rrd")
