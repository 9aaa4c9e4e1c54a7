"""Figures of an identification: what is drawn is what was computed; files are whole, self-contained and escaped."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mjfish.errors import InputError
from mjfish.estimation import Noise, fit
from mjfish.estimation.identification import pose
from mjfish.estimation.residual import Residual
from mjfish.estimation.residual_tests import ResidualTests, residual_tests
from mjfish.fish import Fish
from mjfish.numerics.arrays import readonly
from mjfish.numerics.formats import p_value
from mjfish.reporting.html.figures import autocorrelation_figure, cross_correlation_figure, residual_figure
from mjfish.reporting.html.identification import write_identification_figures
from mjfish.reporting.html.pages import Section, write_figures
from mjfish.simulation.synthetic import generate

SIGMA = readonly([0.01, 0.01, 0.05])
UNTESTED = ResidualTests((), (), np.nan, np.nan, "untested")
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
def tests_(pike: Fish) -> ResidualTests:
    drawn = generate(pike, ("v1", "v1-v5"), duration=6.0, noise=SIGMA)
    dataset = replace(drawn, trials=tuple(replace(trial, role="fit") for trial in drawn.trials))
    posed = replace(pose(dataset), noise=Noise.white(SIGMA))
    return residual_tests(posed, fit(posed, posed.start()))


def _specs(html: str) -> list[dict]:
    return [json.loads(t) for t in re.findall(r'<script type="application/json">(.*?)</script>', html, re.DOTALL)]


def test_velocities_and_residuals_are_drawn_each_in_its_panel(residuals: tuple[Residual, ...]) -> None:
    """Catches channels swapped, a residual of the wrong sign, a curve drawn where samples do not count."""
    figure = residual_figure(residuals[1])
    velocity, predicted = residuals[1].trial.velocity, residuals[1].predicted
    for k in range(3):
        measured, simulated = figure.select_traces(row=k + 1, col=1)
        np.testing.assert_allclose(measured.y, velocity[:, k], rtol=1e-4)
        assert simulated.y[260] is None
        (residual,) = figure.select_traces(row=k + 1, col=2)
        np.testing.assert_allclose(
            np.array(residual.y, dtype=float),
            np.where(residuals[1].counted, velocity[:, k] - predicted[:, k], np.nan),
            rtol=1e-4,
        )
    assert [shape.x0 for shape in figure.layout.shapes] == [5.2] * 6


def test_autocorrelations_are_drawn_with_the_band_of_all_trials(tests_: ResidualTests) -> None:
    figure = autocorrelation_figure(tests_.whiteness)
    pooled = [test for test in tests_.whiteness if test.trial == "all"]
    for trace, test in zip(figure.select_traces({"name": "all trials"}), pooled, strict=True):
        np.testing.assert_allclose(trace.y, test.value, rtol=1e-4)
    bands = {trace.yaxis: trace for trace in figure.data if trace.fill}
    assert set(bands) == {"y", "y2", "y3"}
    np.testing.assert_allclose(np.max(bands["y2"].y), pooled[1].band.max(), rtol=1e-4)
    assert len(list(figure.select_traces({"name": "one trial"}))) == 6


@pytest.mark.parametrize("trial", ["all", "v1-v5"])
def test_cross_correlations_have_a_panel_for_each_channel_and_input(tests_: ResidualTests, trial: str) -> None:
    figure = cross_correlation_figure(tests_.independence, trial)
    own = [test for test in tests_.independence if test.trial == trial]
    assert [(test.channel, test.input) for test in own][:3] == [
        ("surge", "beat"),
        ("surge", "double_beat"),
        ("sway", "beat"),
    ]
    for k, test in enumerate(own):
        (line,) = figure.select_traces({"name": "residual"}, row=k // 2 + 1, col=k % 2 + 1)
        np.testing.assert_allclose(line.y, test.value, rtol=1e-4)
    assert figure.layout.annotations[5].text == f"yaw rate, last joint, squared: p {p_value(own[5].p_value)}"


def test_files_are_written_and_named_and_hold_every_trial(
    residuals: tuple[Residual, ...], tests_: ResidualTests, tmp_path: Path
) -> None:
    folder = tmp_path / "new" / "figures"
    files = write_identification_figures(folder, "pool", residuals, tests_)
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


def test_rollouts_that_all_diverged_have_gaps_and_no_tests(residuals: tuple[Residual, ...], tmp_path: Path) -> None:
    gone = [replace(r, predicted=np.full_like(r.predicted, np.nan)) for r in residuals]
    files = write_identification_figures(tmp_path, "pool", gone, UNTESTED)
    assert [f.name for f in files] == ["simulated.html"]
    assert "the rollout diverged" in files[0].read_text()


def test_a_place_that_cannot_be_written_to_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be written"):
        write_figures(tmp_path / "nowhere" / "a.html", Section("t", "l", {}, ()))
    assert list(tmp_path.iterdir()) == []
