"""Agreement: the paper's and MATLAB's numbers, simulated and predicted, whole and in parts."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from residual_draws import coloured
from synthetic_swimming import SIGMA, TRUTH, as_measured, problem, swimming

from mjfish.data import Trial
from mjfish.drive.modes import drive
from mjfish.estimation.residual import Agreement, Residual, agreement, fitted, held_out, noise_at, parts_of_trial
from mjfish.files.plain_data import plain
from mjfish.files.writing import write_json
from mjfish.fish import Fish
from mjfish.numerics.arrays import FloatArray, readonly

TIME = np.arange(521) / 50.0


def _residual(error: FloatArray, *, name: str = "v1", role: str = "fit", mode: str = "v1") -> Residual:
    wave = np.stack([np.sin(TIME), 2.0 * np.cos(3.0 * TIME), TIME], axis=1)
    trial = Trial(name, None, readonly(TIME), readonly(wave), drive(mode))
    every = np.ones(len(TIME), dtype=np.bool_)
    return Residual(trial, role, wave - error, every, every)  # type: ignore[arg-type]


def _one(rows: tuple[Agreement, ...], channel: str, part: str = "whole", horizon: int | None = None) -> Agreement:
    return next(r for r in rows if (r.channel, r.part, r.horizon) == (channel, part, horizon))


def test_the_numbers_are_those_of_their_definitions() -> None:
    """By hand on a known error. Catches a range of the prediction, a mean of the trial in a part, a sum for a mean."""
    residual = _residual(np.tile([0.1, -0.2, 0.5], (521, 1)))
    rows = agreement([residual], horizons=())
    surge = _one(rows, "surge")
    assert (surge.rmse, surge.samples, surge.unit) == (pytest.approx(0.1), 521, "m/s")
    y = residual.trial.velocity[:, 0]
    assert surge.nrmse == pytest.approx(0.1 / (y.max() - y.min()))
    assert surge.fit == pytest.approx(100.0 * (1.0 - np.sqrt(521) * 0.1 / np.linalg.norm(y - y.mean())))
    late = _one(rows, "yaw_rate", "steady")
    inside = parts_of_trial(residual.trial)["steady"]
    assert late.samples == np.count_nonzero(inside)
    assert late.range == pytest.approx(10.4)
    line = TIME[inside]
    assert late.fit == pytest.approx(100.0 * (1.0 - 0.5 * np.sqrt(len(line)) / np.linalg.norm(line - line.mean())))


def test_a_fit_of_zero_percent_is_the_mean_and_of_a_hundred_is_perfect() -> None:
    perfect = _residual(np.zeros((521, 3)))
    assert _one(agreement([perfect], horizons=()), "sway").fit == 100.0
    mean = replace(perfect, predicted=np.tile(perfect.trial.velocity.mean(axis=0), (521, 1)))
    assert _one(agreement([mean], horizons=()), "sway").fit == pytest.approx(0.0, abs=1e-9)


def test_a_prediction_knows_the_innovations_only_and_far_ahead_it_is_the_simulation() -> None:
    """First-order noise, 0.9. Catches a forecast that is subtracted twice, or of the wrong sign."""
    rng = np.random.default_rng(3)
    rows = agreement([_residual(coloured(rng, 521, 0.9), name=f"v1.{k}") for k in range(8)], horizons=(1, 5, 500))
    for channel, sigma in zip(("surge", "sway", "yaw_rate"), SIGMA, strict=True):
        rms = {k: np.sqrt(np.mean([r.rmse**2 for r in rows if (r.channel, r.part, r.horizon) == (channel, "whole", k)]))
               for k in (None, 1, 5, 500)}  # fmt: skip
        assert rms[1] == pytest.approx(sigma, rel=0.05)
        assert rms[5] == pytest.approx(sigma * np.sqrt((1 - 0.9**10) / (1 - 0.81)), rel=0.08)
        assert rms[1] < rms[5] < rms[None]
        assert rms[500] == pytest.approx(rms[None], rel=1e-3)


def test_white_residuals_are_not_forecast() -> None:
    rng = np.random.default_rng(4)
    rows = agreement([_residual(coloured(rng, 521, 0.0), name=f"v1.{k}") for k in range(4)])
    assert all(r.rmse == pytest.approx(_one(rows, r.channel, r.part).rmse, rel=0.2) for r in rows if r.part == "whole")


def test_parts_follow_the_steps_of_the_drive_in_beats() -> None:
    """Ten beats from rest, ten from the change. Catches seconds for beats, the wrong segment's beat, a lost sample."""
    found = parts_of_trial(_residual(np.zeros((521, 3)), mode="v1-v5").trial)
    assert set(found) == {"whole", "start_up", "change", "steady"}
    assert np.all(found["start_up"].astype(int) + found["change"] + found["steady"] == 1)
    assert TIME[found["start_up"]].max() == pytest.approx(10.0 * 2.0 * np.pi / 18.0, abs=0.02)
    assert TIME[found["change"]].min() == pytest.approx(5.2)
    assert TIME[found["change"]].max() == pytest.approx(5.2 + 10.0 * 2.0 * np.pi / 26.0, abs=0.02)
    assert set(parts_of_trial(_residual(np.zeros((521, 3)), mode="v1").trial)) == {"whole", "start_up", "steady"}


def test_where_joints_were_measured_the_drive_tells_no_parts(pike: Fish) -> None:
    trial = as_measured(swimming(pike, ("v1",), duration=3.0).trials[0], pike)
    assert set(parts_of_trial(trial)) == {"whole"}


def test_a_held_out_trial_has_no_say_in_the_noise_that_predicts_it() -> None:
    rng = np.random.default_rng(5)
    fit = [_residual(coloured(rng, 521, 0.5), name=f"v1.{k}") for k in range(3)]
    held = _residual(coloured(rng, 521, 0.95), name="v3", role="held_out")
    assert noise_at([*fit, held], 0.02).phi.tobytes() == noise_at(fit, 0.02).phi.tobytes()


def test_a_rollout_that_diverged_has_no_score_and_spoils_no_other() -> None:
    rng = np.random.default_rng(6)
    good, bad = _residual(coloured(rng, 521, 0.5)), _residual(coloured(rng, 521, 0.5), name="v3")
    lost = bad.predicted.copy()
    lost[300:] = np.nan
    rows = agreement([good, replace(bad, predicted=lost)])
    assert all(np.isnan(r.rmse) and np.isnan(r.fit) for r in rows if r.trial == "v3" and r.part == "whole")
    assert all(np.isfinite(r.rmse) for r in rows if r.trial == "v1")


def test_fitted_and_held_out_trials_are_scored_where_they_count(pike: Fish) -> None:
    """The score's own residuals come out again, prefix left out. Catches a mask that is off by a sample."""
    dataset = swimming(pike, ("v1", "v3"), duration=3.0)
    fit = problem(dataset, free_clock=True)
    x = fit.start(TRUTH)
    for residual, raw in zip(fitted(fit, x), fit.raw(x), strict=True):
        np.testing.assert_array_equal(residual.values[residual.scored], raw)
    one = held_out(fit, TRUTH, (dataset.trials[1],))[0]
    assert (one.role, np.count_nonzero(one.counted), np.count_nonzero(one.scored)) == ("held_out", 151, 113)
    assert one.trial.time[one.scored].min() > 0.75
    rows = agreement([one])
    assert _one(rows, "surge").samples == 113
    assert _one(rows, "surge").rmse == pytest.approx(SIGMA[0], rel=0.3)


def test_rows_become_plain_data(tmp_path: object) -> None:
    rows = agreement([_residual(np.zeros((521, 3)))])
    path = tmp_path / "rows.json"  # type: ignore[operator]
    write_json(path, plain(rows))
    assert json.loads(path.read_text())[0]["channel"] == "surge"
