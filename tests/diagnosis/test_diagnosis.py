"""The result of a diagnosis: its layout, its repeatability, and its other verdicts."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np
import pytest
from diagnosed import diagnosis as handmade
from hidden_cases import coefficients, draw
from pike_coefficients import COEFFICIENTS

from mjfish import sample
from mjfish.data import load_dataset, save
from mjfish.diagnosis import Diagnosis, conclusion, diagnose
from mjfish.diagnosis.assembly import remarks
from mjfish.diagnosis.provenance import provenance
from mjfish.diagnosis.where import FIFTHS, fifths
from mjfish.drive.motion import JointMotion
from mjfish.effects import Effect, catalogue, find
from mjfish.effects.effect import Values
from mjfish.effects.mechanism import Domain
from mjfish.errors import InputError
from mjfish.fish import Fish
from mjfish.fish.frames import CHANNELS
from mjfish.numerics.arrays import readonly
from mjfish.numerics.formats import percent
from mjfish.parameters import Parameter
from mjfish.simulation.synthetic import generate

OWN = Path(__file__).parents[1] / "effects" / "own_effects.py"
QUICK = {name: find(name) for name in ("time_offset", "servo_lag", "ambient_current")}


@pytest.fixture(scope="module")
def named(told: list[tuple[str, float]]) -> Diagnosis:
    data = draw("time_offset", "middling", trials=4).dataset
    return diagnose(data, effects=QUICK, jobs=1, seed=3, progress=lambda what, done: told.append((what, done)))


@pytest.fixture(scope="module")
def told() -> list[tuple[str, float]]:
    """What the diagnosis tells of its progress."""
    return []


def test_progress_never_falls_and_moves_with_the_work(named: Diagnosis, told: list[tuple[str, float]]) -> None:
    """It stood at one number for minutes: no stage of this diagnosis is told once."""
    assert named.verdict == "named"
    shares = [done for _, done in told]
    assert shares == sorted(shares)
    assert (shares[0], told[-1]) == (0.0, ("done", 1.0))
    stages = {what: [done for name, done in told if name == what] for what, _ in told[:-1]}
    assert len(stages) > 4
    assert min(len(set(own)) for what, own in stages.items() if what != "testing the data") > 5


def test_draws_come_from_the_extended_model_with_the_errors_of_its_intervals(named: Diagnosis) -> None:
    """Catches the posterior of another fit, and one without the cause."""
    posterior = named.posterior
    assert posterior is not None
    assert posterior.names == tuple(named.extended)
    assert posterior.model.effects == named.extended_model.effects
    assert posterior.runs == len(named.problem.trials)
    np.testing.assert_array_equal(posterior.mean, [value.estimate for value in named.extended.values()])
    at_bound = [value.at_bound for value in named.extended.values()]
    beside = posterior.covariance[:, at_bound]
    given = posterior.covariance - beside @ np.linalg.solve(beside[at_bound], beside.T)
    offset = named.extended["time_offset.offset"]
    place = posterior.names.index("time_offset.offset")
    assert np.sqrt(given[place, place]) == pytest.approx((offset.high - offset.low) / (2.0 * 1.96), rel=0.01)
    assert named.to_dict()["posterior"]["effects"] == ["time_offset"]
    offsets = [draw.values["time_offset.offset"] for draw in sample(named, 50)]
    assert 0.6 < np.std(offsets) / np.sqrt(posterior.covariance[place, place]) < 1.4


class FadingBattery(Effect):
    """Amplitude lost in time: an effect that no list has."""

    name: ClassVar[str] = "fading_battery"
    domain: ClassVar[Domain] = "drive"
    summary: ClassVar[str] = "the amplitude of the joints falls with time"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("fading_battery.loss", "1/s", 0.0, 0.0, 0.1, 0.0, 0.01, about="relative loss of amplitude a second"),
    )
    source: ClassVar[str] = "made for this test"
    signature: ClassVar[str] = "everything gets smaller with time"
    confirm: ClassVar[str] = "charge the battery"

    def drive(self, motion: JointMotion, values: Values) -> JointMotion:
        """Scale the angles by 1 - loss t."""
        middle = 0.5 * (motion.time[:-1] + motion.time[1:])
        time = np.stack([motion.time[:-1], middle, motion.time[1:]], axis=1)[:, :, None]
        kept, lost = 1.0 - values["loss"] * time, values["loss"]
        return JointMotion(
            time=motion.time,
            angle=motion.angle * kept,
            rate=motion.rate * kept - lost * motion.angle,
            acceleration=motion.acceleration * kept - 2.0 * lost * motion.rate,
        )


def _fading(pike: Fish) -> Any:
    truth = coefficients(np.random.default_rng(5)) | {"fading_battery.loss": 0.05}
    modes = ["v1", "v3-t2", "v5-v1", "v7"]
    return generate(
        pike,
        modes,
        values=truth,
        effects=[FadingBattery()],
        noise=np.array([0.01, 0.01, 0.05]),
        held_out=["v7"],
        seed=1,
    )


@pytest.mark.slow
def test_an_effect_off_the_list_is_unexplained(pike: Fish) -> None:
    result = diagnose(_fading(pike), jobs=1)
    assert result.verdict == "unexplained"
    assert result.causes == ()
    assert result.best
    assert result.gain is not None


@pytest.mark.slow
@pytest.mark.parametrize("shown", [False, True])
def test_the_closest_model_is_not_shown_where_it_misleads(
    pike: Fish, monkeypatch: pytest.MonkeyPatch, shown: bool
) -> None:
    """A scale errs more on the held-out run than the nominal model does; errors by run are there all the same."""
    if shown:
        monkeypatch.setattr(conclusion, "_misleading", lambda *_: "")
    result = diagnose(_fading(pike), effects={"velocity_scale": find("velocity_scale")}, jobs=1)
    assert result.verdict == "unexplained"
    assert result.gain is not None
    (run,) = result.gain.by_run
    if shown:
        assert result.best == ("velocity_scale",)
        assert result.gain.extended["pooled"] > result.gain.nominal["pooled"]
    else:
        assert result.best == ()
        assert run.extended == run.nominal
        assert (
            "The nominal model is kept, for with velocity_scale its nRMSE on the held-out trials is" in result.message
        )
        (candidate,) = result.candidates
        assert candidate.row is not None
        assert candidate.row.held_out_error is not None
        ratio = candidate.row.held_out_error / result.gain.nominal["pooled"]
        assert f"is {percent(ratio - 1.0)} larger than without it" in result.message
        if candidate.row.held_out is not None:  # the sentence has the sign that the table has
            assert ("although its log-likelihood is" in result.message) == (candidate.row.held_out.gained > 0.0)


@pytest.mark.slow
def test_the_same_effect_on_the_list_is_named(pike: Fish) -> None:
    result = diagnose(_fading(pike), effects={**QUICK, "fading_battery": FadingBattery()}, jobs=1)
    assert [cause.name for cause in result.causes] == ["fading_battery"]
    value = result.causes[0].parameters["loss"]
    assert value.estimate == pytest.approx(0.05, rel=0.1)


class Twin(type(find("time_offset"))):  # type: ignore[misc]
    """The clock offset under another name, as a mechanism of its own: no data can tell the two apart."""

    name: ClassVar[str] = "twin"
    mechanism: ClassVar[str] = "twin"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("twin.offset", "s", 0.0, -0.25, 0.25, 0.0, 0.005, about="the same offset"),
    )


def test_causes_that_the_data_cannot_tell_apart_are_rivals(named: Diagnosis) -> None:
    """Of data whose noise is not stated: it is estimated, and the cause is found all the same."""
    assert named.dataset.noise is not None
    result = diagnose(replace(named.dataset, noise=None), effects={**QUICK, "twin": Twin()}, jobs=1)
    assert any("noise: estimated" in remark for remark in result.remarks)
    assert result.verdict == "cannot_tell"
    assert set(result.rivals[0]) == {"twin", "time_offset"}
    assert result.causes == ()


def test_the_json_keeps_its_contract(named: Diagnosis, tmp_path: Path) -> None:
    named.save(tmp_path / "diagnosis.json")
    saved = json.loads((tmp_path / "diagnosis.json").read_text())
    assert saved["schema"] == 5
    assert saved["verdict"] == "named"
    cause = saved["causes"][0]
    assert cause["name"] == "time_offset"
    offset = cause["parameters"]["offset"]
    assert offset["low"] < offset["estimate"] < offset["high"]
    assert offset["unit"] == "s"
    assert next(c["name"] for c in saved["candidates"]) == "time_offset"
    assert {c["name"] for c in saved["candidates"]} == set(QUICK)
    assert all({"score", "score_p", "confounded"} <= set(c) for c in saved["candidates"])
    (row,) = (row for row in saved["table"]["rows"] if row["names"] == ["time_offset"])
    assert row["sizes"]["time_offset.offset"] == offset
    assert row["held_out_error"] == pytest.approx(saved["gain"]["held_out"]["extended"]["pooled"])
    assert row["error"] > 0.0
    assert {"channel", "trial", "part"} <= set(saved["where"])
    held = saved["gain"]["held_out"]
    assert set(held["nominal"]) == set(held["extended"]) == {*CHANNELS, "pooled"}
    runs = saved["gain"]["by_run"]
    assert [run["trial"] for run in runs] == [t.name for t in named.dataset.trials if t.role == "held_out"]
    for run in runs:
        assert set(run["nominal"]) == set(run["extended"]) == {*CHANNELS, "pooled"}
        assert run["extended"]["pooled"] < run["nominal"]["pooled"]
    for model in ("nominal", "extended"):
        mean = np.mean([run["mean_speed_error"][model] for run in runs])
        assert mean == pytest.approx(saved["gain"]["mean_speed_error"][model])
    reduction = saved["gain"]["relative_reduction"]
    assert reduction["low"] < reduction["estimate"] < reduction["high"]
    for model in ("nominal", "extended"):
        assert set(COEFFICIENTS) <= set(saved["coefficients"][model])
    assert saved["rivals"] == []
    assert saved["status"] == "ok"
    assert {"versions", "seed", "inputs"} <= set(saved["provenance"])


def test_a_fit_that_has_not_converged_is_said(named: Diagnosis) -> None:
    stopped = replace(named, status="fit_not_converged")
    assert "not converged" in stopped.summary()
    assert "not converged" not in named.summary()
    fit: Any = SimpleNamespace(parameters=(), at_bound=(), values={})
    held = named.dataset.trials
    ended = {"the nominal model": "max_evaluations", "the extended model": "converged"}
    said = list(remarks("", fit, ended, held))
    assert len(said) == 1
    assert said[0].startswith("fit-not-converged: the fit of the nominal model")
    assert list(remarks("", fit, dict.fromkeys(ended, "converged"), held)) == []


def test_shares_of_the_misfit_add_up(named: Diagnosis) -> None:
    where = named.where
    assert where is not None
    for shares in (where.channels, where.trials, where.parts, where.phases, where.speeds, where.turns):
        assert sum(shares.values()) == pytest.approx(1.0)


def test_fifths_are_equal_parts_from_the_lowest_to_the_highest() -> None:
    values = np.random.default_rng(0).permutation(100.0 + np.arange(100.0))
    labels = fifths(values)
    for k, name in enumerate(FIFTHS):
        assert sorted(values[labels == name]) == list(100.0 + 20.0 * k + np.arange(20.0))


@pytest.mark.slow
def test_a_misfit_that_no_candidate_could_show_is_still_unexplained(named: Diagnosis) -> None:
    """The coefficients hide a wrong mass wholly: with it as the only candidate there is nothing to refit."""
    result = diagnose(named.dataset, effects={"mass_error": find("mass_error")}, jobs=1)
    assert result.verdict == "unexplained"
    assert result.causes == ()


def test_provenance_has_the_hash_of_every_input(named: Diagnosis, tmp_path: Path) -> None:
    save(named.dataset, tmp_path / "data")
    read = load_dataset(tmp_path / "data")
    inputs = provenance(read, (), 0)["inputs"]
    assert set(inputs) == {"dataset.toml", *(f"{trial.name}.csv" for trial in read.trials)}
    before = dict(inputs)
    path = tmp_path / "data" / f"{read.trials[0].name}.csv"
    path.write_text(path.read_text().replace("0.02,", "0.020,", 1))
    assert provenance(read, (), 0)["inputs"] != before


def test_provenance_tells_files_of_one_name_in_two_folders_apart(named: Diagnosis, tmp_path: Path) -> None:
    save(named.dataset, tmp_path)
    read = load_dataset(tmp_path)
    (tmp_path / "more").mkdir()
    moved = tmp_path / "more" / f"{read.trials[0].name}.csv"
    moved.write_text("t\n")
    trials = (read.trials[0], replace(read.trials[1], source=moved), *read.trials[2:])
    inputs = provenance(replace(read, trials=trials), (), 0)["inputs"]
    assert inputs[moved.name] != inputs[f"more/{moved.name}"]


def test_provenance_knows_the_fish_and_the_causes_of_ones_own(named: Diagnosis) -> None:
    alone = provenance(named.dataset, tuple(catalogue().values()), 0)
    saved = provenance(named.dataset, tuple(catalogue([OWN]).values()), 0)
    assert set(saved["inputs"]) - set(alone["inputs"]) == {OWN.name}
    made = type("Made", (Effect,), {n: getattr(find("time_offset"), n) for n in ("name", "domain", "parameters")})()
    assert provenance(named.dataset, (made,), 0)["inputs"] == alone["inputs"], "a file of Python's own is no input"
    heavier = replace(named.dataset, fish=named.dataset.fish.model_copy(update={"name": "another"}))
    assert provenance(heavier, (), 0)["fish"] != saved["fish"]


def test_noise_that_is_not_white_raises_no_alarm(pike: Fish) -> None:
    """A slow drift of the camera's velocity estimate is noise, though the dataset states it as white."""
    dataset = generate(pike, ["v1", "v3", "v1-v5"], values=coefficients(np.random.default_rng(2)), seed=1, duration=7.0)
    rng = np.random.default_rng(11)
    sigma = np.array([0.01, 0.01, 0.05])

    def drifting(n: int) -> np.ndarray[Any, Any]:
        noise = np.zeros((n, 3))
        for k in range(1, n):
            noise[k] = 0.8 * noise[k - 1] + rng.standard_normal(3) * sigma * 0.6
        return noise

    trials = [replace(t, velocity=readonly(t.velocity + drifting(len(t.time)))) for t in dataset.trials]
    result = diagnose(replace(dataset, trials=tuple(trials), noise=readonly(sigma)), effects=QUICK, jobs=1)
    assert result.verdict == "nothing_wrong", (result.message, result.remarks)
    assert any("autoregressive" in remark for remark in result.remarks)


def test_held_out_trials_do_not_touch_the_fit_and_rubbish_in_them_is_found(named: Diagnosis) -> None:
    """Leakage: held-out measurements replaced by rubbish may change no fit and no score; the checks see them."""
    rng = np.random.default_rng(0)
    spoilt = [
        replace(t, velocity=readonly(rng.standard_normal(t.velocity.shape))) if t.role == "held_out" else t
        for t in named.dataset.trials
    ]
    result = diagnose(replace(named.dataset, trials=tuple(spoilt)), effects=QUICK, jobs=1, seed=3)
    assert result.nominal == named.nominal
    assert [c.evidence for c in result.candidates] == [c.evidence for c in named.candidates]
    assert (result.verdict, result.causes, result.rivals) == ("cannot_tell", (), ())
    assert result.message.startswith("These data allow no verdict: trial ")


def test_no_candidate_left_is_refused(named: Diagnosis) -> None:
    free = replace(named.dataset, clock="free")
    with pytest.raises(InputError, match="none of the 1 effects applies"):
        diagnose(free, effects={"time_offset": find("time_offset")})


@pytest.mark.parametrize("effect", [pytest.param(None, marks=pytest.mark.slow), "munk_moment"])
def test_data_without_noise_are_judged_by_the_effect_not_by_rounding(pike: Fish, effect: str | None) -> None:
    hidden = [] if effect is None else [find(effect)]
    truth = coefficients(np.random.default_rng(3)) | ({} if effect is None else {"munk_moment.kappa": 0.5})
    dataset = generate(pike, ["v1", "v3", "v1-t2"], values=truth, effects=hidden, duration=5.6, held_out=["v3"])
    result = diagnose(dataset, effects={**QUICK, "munk_moment": find("munk_moment")}, jobs=1)
    if effect is None:
        assert result.verdict == "nothing_wrong", result.message
    else:
        assert [cause.name for cause in result.causes] == [effect], result.message
        assert result.causes[0].parameters["kappa"].estimate == pytest.approx(0.5, abs=0.02)


def test_a_learned_cause_goes_by_its_mechanism_in_the_json_alone() -> None:
    """Its own name is that of its effect: how to confirm it is looked up there."""
    roll = handmade(cause="roll_law", parameters={}, mechanisms=())
    assert [cause.name for cause in roll.causes] == ["roll_law"]
    assert [cause["name"] for cause in roll.to_dict()["causes"]] == ["roll"]
    formula = handmade()
    assert [cause["name"] for cause in formula.to_dict()["causes"]] == [cause.name for cause in formula.causes]
