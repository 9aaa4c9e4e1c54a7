"""What is said of a rollout is what it is."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from measured_and_simulated import SIGMA, clean, constant, measured, write, write_all

from mjfish.comparison import Comparison, compare
from mjfish.data import Dataset
from mjfish.errors import InputError
from mjfish.estimation.residual import Agreement
from mjfish.files.writing import write_json
from mjfish.fish.frames import CHANNELS


@pytest.fixture(scope="module")
def pool(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    return measured(tmp_path_factory.mktemp("measured") / "pool")


def _whole(found: Comparison, trial: int = 0) -> dict[str, Agreement]:
    return {score.channel: score for score in found.trials[trial].scores if score.part == "whole"}


def test_numbers_are_those_on_paper(pool: Dataset, tmp_path: Path) -> None:
    """RMSE, over the range, and the fit in percent, of a rollout that is off by a known part of the speed."""
    for name, (time, velocity) in clean(50.0).items():
        write(tmp_path / f"{name}.parquet", time, 1.1 * velocity)
    found = compare(pool, [tmp_path])
    assert found.failures == ()
    assert [one.status for one in found.trials] == ["covered", "covered"]
    for index, trial in enumerate(pool.trials):
        error = trial.velocity - 1.1 * clean(50.0)[trial.name][1]
        for k, channel in enumerate(CHANNELS):
            y, score = trial.velocity[:, k], _whole(found, index)[channel]
            rmse = np.sqrt(np.mean(error[:, k] ** 2))
            assert score.samples == len(trial.time) == 211
            assert score.rmse == pytest.approx(rmse, rel=1e-9)
            assert score.nrmse == pytest.approx(rmse / np.ptp(y), rel=1e-9)
            fit = 100.0 * (1.0 - np.linalg.norm(error[:, k]) / np.linalg.norm(y - y.mean()))
            assert score.fit == pytest.approx(fit, rel=1e-9)
    assert found.trials[0].worst == max(score.nrmse for score in _whole(found).values())


@pytest.mark.parametrize("rate", [60.0, 100.0, 500.0])
def test_any_rate_finds_the_noise_of_the_measurement(pool: Dataset, tmp_path: Path, rate: float) -> None:
    """The right simulation leaves the noise; catches times that are taken for row numbers, linear interpolation."""
    found = compare(pool, [write_all(tmp_path, rate, duration=4.4)])
    for index in range(2):
        rmse = [_whole(found, index)[channel].rmse for channel in CHANNELS]
        np.testing.assert_allclose(rmse, SIGMA, rtol=0.15)
        assert found.trials[index].remarks == ()


def test_parts_add_up_to_the_whole(pool: Dataset, tmp_path: Path) -> None:
    """And a rollout that is wrong at the start alone is seen to be."""
    for name, (time, velocity) in clean(100.0).items():
        write(tmp_path / f"{name}.csv", time, velocity + 0.2 * (time < 1.0)[:, None])
    one = compare(pool, [tmp_path]).trials[0]
    for channel in CHANNELS:
        scores = {score.part: score for score in one.scores if score.channel == channel}
        parts = [scores["start_up"], scores["steady"]]
        assert sum(part.samples for part in parts) == scores["whole"].samples
        total = sum(part.samples * part.rmse**2 for part in parts) / scores["whole"].samples
        assert scores["whole"].rmse == pytest.approx(np.sqrt(total), rel=1e-9)
        sigma = SIGMA[CHANNELS.index(channel)]
        assert scores["steady"].rmse == pytest.approx(sigma, rel=0.4)
        assert scores["start_up"].rmse > 2.0 * sigma
        assert {part.range for part in parts} == {scores["whole"].range}


@pytest.mark.parametrize("lead", [0.012, -0.0133])
def test_a_shifted_clock_is_found_with_its_sign(pool: Dataset, tmp_path: Path, lead: float) -> None:
    """A rollout whose clock is ahead by `lead` shows at t + lead what was measured at t."""
    found = compare(pool, [write_all(tmp_path, 200.0, lead=lead, duration=4.4)])
    for trial in found.trials:
        shifts = trial.shifts
        assert list(shifts) == [*CHANNELS, "all"]
        assert shifts["all"].time == pytest.approx(lead, abs=5e-4)
        assert shifts["yaw_rate"].time == pytest.approx(lead, abs=5e-4)
        assert not shifts["all"].at_limit
        np.testing.assert_allclose([shifts[channel].rmse for channel in CHANNELS], SIGMA, rtol=0.15)
        scores = {score.channel: score for score in trial.scores if score.part == "whole"}
        assert scores["yaw_rate"].rmse > 3.0 * shifts["yaw_rate"].rmse
        ranges = np.array([scores[channel].range for channel in CHANNELS])
        assert shifts["all"].nrmse == pytest.approx(np.sqrt(np.mean((SIGMA / ranges) ** 2)), rel=0.15)


def test_a_rollout_that_ends_early_is_scored_where_it_is_and_fails(pool: Dataset, tmp_path: Path) -> None:
    for name, (time, velocity) in clean(100.0).items():
        kept = time <= (3.0 if name == "v1" else 9.0)
        write(tmp_path / f"{name}.csv", time[kept], velocity[kept])
    found = compare(pool, [tmp_path])
    assert [trial.status for trial in found.trials] == ["partly", "covered"]
    assert {score.samples for score in _whole(found).values()} == {151}
    np.testing.assert_allclose([_whole(found)[channel].rmse for channel in CHANNELS], SIGMA, rtol=0.2)
    (failure,) = found.failures
    assert failure.startswith("v1: ")
    assert "runs from 0 to 3 s and does not cover 60 of 211 measured samples from 0 to 4.2 s; simulate" in failure


def test_a_trial_without_rollout_fails_by_name(pool: Dataset, tmp_path: Path) -> None:
    write_all(tmp_path)
    (tmp_path / "v3.csv").rename(tmp_path / "other.csv")
    found = compare(pool, [tmp_path])
    assert [trial.status for trial in found.trials] == ["covered", "absent"]
    assert found.failures == ("v3: no rollout; expected a file v3.csv",)
    assert found.unused == (tmp_path / "other.csv",)
    assert np.isnan(found.trials[1].worst)


def test_a_missing_channel_is_said_and_the_others_are_scored(pool: Dataset, tmp_path: Path) -> None:
    for name, (time, velocity) in clean(100.0).items():
        write(tmp_path / f"{name}.csv", time, velocity, ("yaw_rate", "surge"))
    found = compare(pool, [tmp_path], bound=0.05)
    one = found.trials[0]
    assert one.channels == ("surge", "yaw_rate")
    assert one.remarks == (f"v1: {tmp_path / 'v1.csv'} has no sway; not compared",)
    assert list(one.shifts) == ["surge", "yaw_rate", "all"]
    assert found.failures == ()
    np.testing.assert_allclose([_whole(found)["yaw_rate"].rmse], SIGMA[2], rtol=0.15)


def test_the_bound_is_on_the_worst_channel(pool: Dataset, tmp_path: Path) -> None:
    write_all(tmp_path)
    worst = max(trial.worst for trial in compare(pool, [tmp_path]).trials)
    assert compare(pool, [tmp_path], bound=1.001 * worst).failures == ()
    assert len(compare(pool, [tmp_path], bound=0.999 * worst).failures) == 1
    for bound in (0.0, -1.0, np.nan, np.inf):
        with pytest.raises(InputError, match="expected a finite nRMSE above 0"):
            compare(pool, [tmp_path], bound=bound)


def test_a_channel_that_does_not_vary_has_no_nrmse_and_passes_no_bound(pool: Dataset, tmp_path: Path) -> None:
    found = compare(constant(pool, 1), [write_all(tmp_path)], bound=1.0)
    assert np.isnan(_whole(found)["sway"].nrmse)
    assert list(found.trials[0].shifts) == ["surge", "yaw_rate"]
    assert "nRMSE nan is beyond the bound 1" in found.failures[0]


def test_steps_too_long_for_the_beat_are_said(pool: Dataset, tmp_path: Path) -> None:
    found = compare(pool, [write_all(tmp_path, 10.0)])
    assert (
        "are up to 0.1 s and a beat lasts 0.349 s; what is between is guessed: write it every 0.029 s"
        in (found.trials[0].remarks[0])
    )


def test_roles_are_those_of_the_dataset(pool: Dataset, tmp_path: Path) -> None:
    trials = tuple(replace(trial, role=role) for trial, role in zip(pool.trials, ("held_out", "fit"), strict=True))
    found = compare(replace(pool, trials=trials), [write_all(tmp_path)])
    assert [trial.role for trial in found.trials] == ["held_out", "fit"]
    assert {score.role for score in found.trials[0].scores} == {"held_out"}


def test_result_is_plain_data(pool: Dataset, tmp_path: Path) -> None:
    write_all(tmp_path)
    (tmp_path / "v3.csv").unlink()
    found = compare(pool, [tmp_path])
    write_json(tmp_path / "out.json", found.to_dict())
    told = json.loads((tmp_path / "out.json").read_text(encoding="utf-8"))
    assert (told["schema"], told["dataset"], told["passed"], told["bound"]) == (1, "pool", False, None)
    v1, v3 = told["trials"]
    assert (v1["status"], v3["status"], v3["rollout"], v3["scores"]) == ("covered", "absent", None, [])
    assert set(v1["shifts"]) == {*CHANNELS, "all"}
    assert {row["part"] for row in found.rows()} == {"whole", "start_up", "steady"}
    for row in found.rows():
        assert (row["shift [s]"] is None) == (row["part"] != "whole")
