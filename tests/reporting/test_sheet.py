"""Figures of an identification: what is drawn is what was computed; files are whole, self-contained and escaped."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mjfish.arrays import readonly
from mjfish.errors import InputError
from mjfish.estimation import Noise
from mjfish.estimation.residuals.residual import Residual
from mjfish.estimation.residuals.residual_tests import ResidualTests, examine
from mjfish.fish import Fish
from mjfish.reporting.html.identification import write_identification_figures
from mjfish.reporting.html.residuals import autocorrelation_figure, cross_correlation_figure, simulated_figure
from mjfish.reporting.html.sheet import Block, Sheet, write_sheet
from mjfish.reporting.html.words import chance
from mjfish.simulation.synthetic import generate

SIGMA = readonly([0.01, 0.01, 0.05])
EVIL = "</script><img src=x onerror=alert(1)>"


@pytest.fixture(scope="module")
def residuals(pike: Fish) -> tuple[Residual, ...]:
    rng = np.random.default_rng(1)
    trials = generate(pike, ("v1", "v1-v5"), duration=6.0).trials
    found = []
    for trial in trials:
        counted = np.ones(len(trial.time), dtype=np.bool_)
        counted[259:262] = False
        predicted = trial.velocity - rng.standard_normal(trial.velocity.shape) * SIGMA
        found.append(Residual(trial, "fit", predicted, counted, counted))
    return found[0], replace(found[1], role="held_out")


@pytest.fixture(scope="module")
def tests_(residuals: tuple[Residual, ...], pike: Fish) -> ResidualTests:
    return examine(residuals, Noise.white(SIGMA), pike.cpg)


def _specs(html: str) -> list[dict]:
    return [json.loads(t) for t in re.findall(r'<script type="application/json">(.*?)</script>', html, re.DOTALL)]


def test_velocities_and_residuals_are_drawn_each_in_its_panel(residuals: tuple[Residual, ...]) -> None:
    """Catches channels swapped, a residual of the wrong sign, a curve drawn where samples do not count."""
    spec = simulated_figure(residuals[1])
    one = {(trace["name"], trace["yaxis"]): trace["y"] for trace in spec["data"]}
    velocity, predicted = residuals[1].trial.velocity, residuals[1].predicted
    for k in range(3):
        axis = "y" if k == 0 else f"y{k + 1}"
        np.testing.assert_allclose(one["measured", axis], velocity[:, k], rtol=1e-4)
        assert one["simulated", axis][260] is None
        left = np.array([np.nan if v is None else v for v in one["residual", f"y{k + 4}"]])
        np.testing.assert_allclose(
            left, np.where(residuals[1].counted, velocity[:, k] - predicted[:, k], np.nan), rtol=1e-4
        )
    assert [shape["x0"] for shape in spec["layout"]["shapes"]] == [5.2] * 6


def test_autocorrelations_are_drawn_with_the_band_of_all_trials(tests_: ResidualTests) -> None:
    spec = autocorrelation_figure(tests_.whiteness)
    pooled = [t for t in tests_.whiteness if t.trial == "all"]
    drawn = [trace for trace in spec["data"] if trace.get("name") == "all"]
    for trace, test in zip(drawn, pooled, strict=True):
        np.testing.assert_allclose(trace["y"], test.value, rtol=1e-4)
    bands = {trace["yaxis"]: trace for trace in spec["data"] if trace.get("fill")}
    assert set(bands) == {"y", "y2", "y3"}
    np.testing.assert_allclose(np.max(bands["y2"]["y"]), pooled[1].band.max(), rtol=1e-4)
    assert sum(trace.get("name") == "one trial" for trace in spec["data"]) == 6


@pytest.mark.parametrize("trial", ["all", "v1-v5"])
def test_cross_correlations_have_a_panel_for_each_channel_and_input(tests_: ResidualTests, trial: str) -> None:
    spec = cross_correlation_figure(tests_.independence, trial)
    own = [t for t in tests_.independence if t.trial == trial]
    assert [(t.channel, t.input) for t in own][:3] == [("surge", "beat"), ("surge", "double_beat"), ("sway", "beat")]
    lines = {trace["yaxis"]: trace["y"] for trace in spec["data"] if not trace.get("fill")}
    for k, test in enumerate(own):
        np.testing.assert_allclose(lines["y" if k == 0 else f"y{k + 1}"], test.value, rtol=1e-4)
    texts = [note["text"] for note in spec["layout"]["annotations"]]
    assert texts[5] == f"yaw rate, last joint, squared: p {chance(own[5].p_value)}"


def test_files_are_written_and_named_and_hold_every_trial(
    residuals: tuple[Residual, ...], tests_: ResidualTests, tmp_path: Path
) -> None:
    folder = tmp_path / "new" / "figures"
    files = write_identification_figures(folder, "planted", residuals, tests_)
    assert [f.name for f in files] == ["simulated.html", "autocorrelation.html", "cross_correlation.html"]
    assert sorted(folder.iterdir()) == sorted(files)
    assert [len(_specs(f.read_text())) for f in files] == [2, 1, 3]
    assert "v1-v5 (held out)" in files[0].read_text()


def test_a_file_asks_for_nothing_from_outside_and_what_users_wrote_is_text(
    residuals: tuple[Residual, ...], tests_: ResidualTests, tmp_path: Path
) -> None:
    odd = replace(residuals[0], trial=replace(residuals[0].trial, name=EVIL))
    written = write_identification_figures(tmp_path, EVIL, [odd], tests_)
    for file in written:
        html = file.read_text()
        own = html[: html.index("* plotly.js v")]
        assert EVIL not in own
        assert "&lt;img" in own
        assert not re.search(r"<(script|link|img|iframe)[^>]*\b(src|href)=", own)
        assert "default-src 'none'" in own


def test_rollouts_that_all_diverged_have_gaps_and_no_tests(
    residuals: tuple[Residual, ...], pike: Fish, tmp_path: Path
) -> None:
    gone = [replace(r, predicted=np.full_like(r.predicted, np.nan)) for r in residuals]
    files = write_identification_figures(tmp_path, "planted", gone, examine(gone, Noise.white(SIGMA), pike.cpg))
    assert [f.name for f in files] == ["simulated.html"]
    assert "the rollout diverged" in files[0].read_text()


def test_a_place_that_cannot_be_written_to_is_refused(tmp_path: Path) -> None:
    sheet = Sheet("t", "l", {}, (Block("h", "r", {"data": [], "layout": {}}),))
    with pytest.raises(InputError, match="cannot be written"):
        write_sheet(tmp_path / "nowhere" / "a.html", sheet)
    assert list(tmp_path.iterdir()) == []
