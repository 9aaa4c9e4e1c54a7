"""The plan: calibrations first, runs by the gain of the hardest pair; a folder that is a dataset once measured."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from synthetic_trials import DURATION, swum, synthetic

from mjfish.data import Dataset, load_dataset, read_table, save, write_table
from mjfish.design import FittedModels, Menu, Plan, plan, planning, write_next_run
from mjfish.design.fitted_models import Question
from mjfish.design.information import Detection, Information
from mjfish.diagnosis.evidence import gather
from mjfish.effects import find
from mjfish.errors import InputError
from mjfish.estimation import fit
from mjfish.simulation import generate

TRUTH = {"ambient_current.y": 0.004}
NAMES = ("ambient_current", "frame_misalignment", "time_offset")


@pytest.fixture(scope="module")
def dataset() -> Dataset:
    return synthetic(NAMES[0], TRUTH)


@pytest.fixture(scope="module")
def best_plan(dataset: Dataset) -> Plan:
    return plan(dataset, rivals=NAMES, menu=Menu(DURATION), jobs=1)


def test_calibrations_come_first_and_runs_by_their_hardest_pair(best_plan: Plan) -> None:
    """Ranked by the best pair instead of the worst, a run that leaves one pair apart would lead."""
    kinds = [option.kind for option in best_plan.options]
    assert kinds == sorted(kinds)
    assert best_plan.status == "ok"
    assert [option.name for option in best_plan.calibrations] == ["sync-flash", "scale-bar", "drift"]
    assert all(any(pair.settled for pair in option.pairs) for option in best_plan.calibrations)
    for option in best_plan.runs:
        assert len(option.pairs) == 3
        assert option.seconds == pytest.approx(DURATION + 30.0)
        assert option.worth == pytest.approx(min(p.after - p.now for p in option.pairs) / option.seconds)
        assert all(p.after >= p.now - 1e-6 for p in option.pairs)
    worths = [option.worth for option in best_plan.runs]
    assert worths == sorted(worths, reverse=True)


def test_a_repeat_is_never_the_advice(best_plan: Plan) -> None:
    """Shown by its own lambda: it adds no more than its trial had, and other runs of the menu do."""
    repeats = [option.worth for option in best_plan.runs if option.run is not None and option.run.repeat]
    assert len(repeats) == 2
    assert best_plan.runs[0].worth > 1.5 * max(repeats)


def test_smallest_visible_sizes_are_those_of_the_score_tests_and_shrink() -> None:
    """A repeat of the one fitted trial shrinks them by sqrt(2), whatever the cause; the best run by more."""
    causes = ("time_offset", "frame_misalignment")
    dataset = synthetic(NAMES[0], TRUTH, ("v1",))
    found = plan(dataset, causes=causes, menu=Menu(DURATION), jobs=1)
    problem = FittedModels.undiagnosed(dataset, {}).problem
    evidence = gather(problem, fit(problem, tolerance=1e-6), [find(name) for name in causes])
    for pair, name in zip(found.runs[0].pairs, causes, strict=True):
        visible = evidence.minimum_detectable(name)
        assert pair.now == pytest.approx(visible[pair.first], rel=0.02)
        assert pair.after < pair.now
    again = next(option for option in found.runs if option.run is not None and option.run.repeat)
    for pair in again.pairs:
        assert pair.after == pytest.approx(pair.now / np.sqrt(2.0), rel=1e-6)
    assert found.runs[0].worth >= again.worth
    assert len(again.isolability) == 2
    for told in again.isolability:
        assert told.after == pytest.approx(told.now / np.sqrt(2.0), rel=1e-6)
    assert again.worth == pytest.approx(np.log(2.0) / again.seconds)


def test_runs_that_tell_mechanisms_apart_come_first_where_nothing_is_named() -> None:
    """A clock and a servo's lag are alike at one frequency; a run like the data shows them, and tells nothing new."""
    dataset = synthetic(NAMES[0], {"ambient_current.y": 0.0}, ("v1",))
    found = plan(dataset, causes=("time_offset", "servo_lag", "velocity_scale"), menu=Menu(DURATION), jobs=1)
    clock = [next(t for t in run.isolability if t.amplitude == "time_offset.offset") for run in found.runs]
    assert {told.beside for told in clock} == {"servo_dynamics"}
    assert clock[0].after < 0.5 * clock[0].now
    assert f"{clock[0].amplitude} is told from servo_dynamics from {clock[0].after:.2g} s on" in found.message
    raw = found.to_dict()["options"][0]["isolability"]
    assert raw[0].keys() == {"amplitude", "beside", "unit", "now", "after"}


def test_a_rival_is_told_from_the_hardest_other_one_from_a_share_of_its_fitted_size_on(best_plan: Plan) -> None:
    """The size that lambda makes 18; lambda of a pair is the smaller one of its two directions."""
    for option in best_plan.runs:
        assert [told.amplitude.partition(".")[0] for told in option.isolability] == list(NAMES)
        current = option.isolability[0]
        assert (current.amplitude, current.unit, current.beside) == ("ambient_current.y", "m/s", "frame_misalignment")
        after = {name: p.after for p in option.pairs for name in (p.first, p.second) if NAMES[0] in (p.first, p.second)}
        assert 18.0 * (TRUTH[current.amplitude] / current.after) ** 2 >= 0.99 * after[current.beside]
        assert all(told.after <= told.now * (1.0 + 1e-6) for told in option.isolability)
    assert all(option.isolability == () for option in best_plan.calibrations)


def test_a_signature_that_a_refit_absorbs_has_no_detectable_size() -> None:
    """A gauge: rounding alone would give it a huge, meaningless one."""
    rng = np.random.default_rng(5)
    columns = rng.standard_normal((50, 2))
    signatures = np.hstack([columns @ [[1.0], [2.0]], rng.standard_normal((50, 1))])
    hidden, seen = (find(name).parameters[0] for name in ("mass_error", "time_offset"))
    sums = Information.of(("c_d.head", "c_d.tail", hidden.name, seen.name), np.hstack([columns, signatures]))
    found = Detection(sums, (), {"mass_error": (hidden,), "time_offset": (seen,)})
    assert found.sizes("mass_error") == {hidden.name: np.inf}
    left = signatures[:, 1] - columns @ np.linalg.lstsq(columns, signatures[:, 1], rcond=None)[0]
    assert found.sizes("time_offset")[seen.name] == pytest.approx(np.sqrt(18.0 / (left @ left)) * seen.scale)


def test_the_folder_is_a_dataset_once_its_run_is_measured(dataset: Dataset, best_plan: Plan, tmp_path: Path) -> None:
    """Old trials are copied, roles as they were; the new one with its drive, to be fitted."""
    noted = load_dataset(save(dataset, tmp_path / "old").parent)
    file = write_next_run(noted, best_plan, tmp_path / "deep" / "next")
    best = best_plan.runs[0].run
    assert best is not None
    with pytest.raises(InputError, match="no such file"):
        load_dataset(file)
    new = swum(best.trial, NAMES[0], TRUTH)
    columns = dict(zip(("surge [m/s]", "sway [m/s]", "yaw_rate [rad/s]"), new.velocity.T, strict=True))
    write_table(file.parent / f"{best.name}.csv", {"time [s]": new.time, **columns})
    for recording in (tmp_path / "old").glob("*.csv"):
        recording.unlink()
    whole = load_dataset(file)
    assert [trial.name for trial in whole.trials] == ["v1", "v3", best.name]
    assert [trial.role for trial in whole.trials] == ["fit", "fit", "fit"]
    assert whole.trials[2].drive == best.trial.drive
    np.testing.assert_array_equal(whole.trials[0].velocity, dataset.trials[0].velocity)
    command = read_table(file.parent / f"{best.name}.command.csv")
    assert command["time"][-1] == pytest.approx(DURATION)
    told = (file.parent / "RECORD.md").read_text()
    assert "surge [m/s]" in told
    assert "sync-flash" in told
    with pytest.raises(InputError, match="is not empty"):
        write_next_run(noted, best_plan, file.parent)
    assert not list(tmp_path.rglob("*.partial"))


def test_a_dataset_without_files_has_nothing_to_add_to(dataset: Dataset, best_plan: Plan, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="save it first"):
        write_next_run(dataset, best_plan, tmp_path / "next")


def test_a_plan_is_plain_data(best_plan: Plan, tmp_path: Path) -> None:
    best_plan.save(tmp_path / "plan.json")
    raw = json.loads((tmp_path / "plan.json").read_text())
    assert raw["question"]["names"] == list(NAMES)
    assert len(raw["options"]) == len(best_plan.options)
    assert raw["options"][0]["pairs"][0].keys() >= {"first", "second", "now", "after"}
    assert raw["options"][-1]["drive"][0]["omega"] > 0.0


def test_a_cause_that_the_data_cannot_show_is_refused(dataset: Dataset) -> None:
    free = replace(dataset, clock="free")
    with pytest.raises(InputError, match="time_offset: cannot be asked"):
        plan(free, rivals=("time_offset", "servo_lag"), jobs=1)
    with pytest.raises(InputError, match="pause"):
        plan(dataset, rivals=("time_offset", "servo_lag"), menu=Menu(pause=-1.0), jobs=1)


def test_a_plan_of_places_is_refused_before_anything_is_fitted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(planning, "diagnose", None)
    posed = generate("pike", ["v1"], observe="pose", duration=1.0)
    with pytest.raises(InputError, match=r"trial 'v1' has no surge .* a plan rests on surge, sway and yaw rate"):
        plan(posed)


def test_a_cause_of_the_nominal_model_is_not_asked_for(dataset: Dataset) -> None:
    known = FittedModels.undiagnosed(dataset, {name: find(name) for name in NAMES})
    for nominal, expected in (((), NAMES), (NAMES[:1], NAMES[1:])):
        here = replace(known, problem=replace(known.problem, nominal=nominal))
        assert tuple(effect.name for effect in planning._causes(here, Question("see", ()))) == expected
