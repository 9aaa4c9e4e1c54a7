"""``identify`` as one call, and what it reports."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pike_coefficients import COEFFICIENTS
from synthetic_swimming import SIGMA, TRUTH, off_truth, swimming

from mjfish.cli import console
from mjfish.cli.identify import _coefficients
from mjfish.data import Dataset, Trial
from mjfish.estimation import Identification, identify
from mjfish.estimation.nominal import first_sigma
from mjfish.estimation.settings import Settings
from mjfish.files.writing import write_json
from mjfish.fish import Fish
from mjfish.numerics.arrays import readonly
from mjfish.numerics.formats import number


@pytest.fixture(scope="module")
def synthetic(pike: Fish) -> Dataset:
    return swimming(pike, ("v1", "v3", "v5"), held_out=["v3"])


@pytest.fixture(scope="module")
def found(synthetic: Dataset) -> Identification:
    return identify(synthetic, Settings(starts=1), jobs=1)


def test_it_fits_the_fit_trials_and_scores_all(found: Identification) -> None:
    assert found.fit.status == "converged"
    assert np.max(np.abs(off_truth(found.fit.values, found.fit.sigma))) < 4.0
    assert len(found.fit.residual) == 2 * 3 * 151
    assert [(score.trial, score.role) for score in found.scores] == [("v1", "fit"), ("v5", "fit"), ("v3", "held_out")]
    np.testing.assert_array_equal(found.noise, SIGMA)
    assert found.remarks == ()


def test_nrmse_is_the_rms_of_the_residual_over_the_range_of_the_measurement(
    synthetic: Dataset, found: Identification
) -> None:
    """At the right coefficients that is the noise over the range."""
    for score in found.scores:
        velocity = next(trial.velocity for trial in synthetic.trials if trial.name == score.trial)
        np.testing.assert_allclose(score.nrmse, SIGMA / np.ptp(velocity, axis=0), rtol=0.25)


def test_noise_that_is_not_stated_is_estimated(synthetic: Dataset) -> None:
    found = identify(replace(synthetic, noise=None), Settings(starts=1), jobs=1)
    np.testing.assert_allclose(found.noise, SIGMA, rtol=0.2)
    assert "none stated" in found.remarks[0]
    assert np.max(np.abs(off_truth(found.fit.values, found.fit.sigma))) < 4.5


def test_a_first_sigma_comes_from_third_differences() -> None:
    """White noise comes out as it is, a smooth motion adds little."""
    rng = np.random.default_rng(1)
    time = np.arange(1000) / 50.0
    smooth = 0.3 * np.sin(6.0 * time[:, None] + np.arange(3))
    velocity = smooth + rng.standard_normal((1000, 3)) * SIGMA
    trial = Trial("smooth", None, readonly(time), readonly(velocity))
    np.testing.assert_allclose(first_sigma((trial,)), SIGMA, rtol=0.1)


def test_the_report_is_plain_data_with_every_estimate(found: Identification) -> None:
    told = json.loads(json.dumps(found.to_dict(), allow_nan=False))
    assert told["schema"] == 3
    assert told["status"] == "converged"
    assert list(told["parameters"]) == list(COEFFICIENTS) == told["correlation"]["names"]
    for name, entry in told["parameters"].items():
        assert entry["low"] < entry["estimate"] < entry["high"]
        assert abs(entry["estimate"] - TRUTH[name]) < 4.0 * entry["standard_error"]
        assert entry["standard_error"] == found.sigma[name]
        assert entry["unit"] == "-"
        assert entry["at_bound"] is False
    assert np.shape(told["correlation"]["matrix"]) == (9, 9)
    assert told["samples"] == 906
    assert told["cost"] == pytest.approx(found.fit.sse)
    assert {score["trial"] for score in told["scores"]} == {"v1", "v3", "v5"}


def test_an_estimate_has_one_interval_wherever_it_is_read(
    found: Identification, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Noise that goes on in time, taken for white, makes the plain intervals too narrow: they differ from these."""
    monkeypatch.setattr(console.out, "_width", 200)
    console.show(_coefficients(found))
    lines = capsys.readouterr().out.splitlines()
    rows = {cells[0]: cells[1:5] for line in lines if len(cells := line.split()) == 5}
    told, summary, record = found.to_dict()["parameters"], found.summary(), found.fish.identified
    assert found.assessment is not None
    assert record is not None
    for name, entry in told.items():
        low, high = found.assessment.intervals.interval(name)
        assert (low, high) == (entry["low"], entry["high"]) != found.fit.interval(name)
        cells = [number(entry[key], 4) for key in ("estimate", "low", "high", "standard_error")]
        assert rows[name] == cells
        if f"{name} " in summary:
            assert f"({low:.4g} to {high:.4g})" in summary
        assert record.intervals[name] == (low, high)


def test_a_start_that_diverges_is_reported_not_raised(pike: Fish, synthetic: Dataset, tmp_path: Path) -> None:
    """With stated noise and without: no weights are made of a run that did not end."""
    wild = pike.with_coefficients(
        {p.name: p.rebound(low=1e7, high=1e9, start=1e8) for p in pike.parameters if p.name == "c_d.tail"}
    )
    for noise in (synthetic.noise, None):
        lost = identify(replace(synthetic, fish=wild, noise=noise), Settings(starts=1), jobs=1)
        assert lost.fit.status == "diverged"
        assert "c_d.tail = 1e+08" in lost.fit.message
        assert all(np.all(np.isnan(score.nrmse)) for score in lost.scores)
        write_json(tmp_path / "lost.json", lost.to_dict())
        assert json.loads((tmp_path / "lost.json").read_text())["scores"][0]["nrmse"] == [None] * 3


def test_threads_do_not_change_the_answer(synthetic: Dataset, found: Identification) -> None:
    threaded = identify(synthetic, Settings(starts=1), jobs=2)
    assert threaded.fit.x.tobytes() == found.fit.x.tobytes()
    assert threaded.scores == found.scores
