"""What planning takes from a diagnosis: its question and its fits, from the object and from its JSON."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from diagnosed import diagnosis

from mjfish.design import Menu, Question, fitted_models, load_fitted_models, plan
from mjfish.design.fitted_models import FittedModels
from mjfish.diagnosis import Diagnosis
from mjfish.diagnosis.result import Verdict
from mjfish.diagnosis.table import Comparison, Table
from mjfish.errors import InputError, UnknownNameError


@pytest.mark.parametrize(
    ("verdict", "purpose", "names"),
    [
        ("cannot_tell", "separate", ("servo_lag", "time_offset")),
        ("named", "separate", ("servo_lag", "time_offset")),
        ("unexplained", "separate", ("servo_lag", "time_offset")),
        ("nothing_wrong", "see", ()),
    ],
)
def test_the_question_is_what_the_verdict_leaves_open(
    verdict: Verdict, purpose: str, names: tuple[str, ...], tmp_path: Path
) -> None:
    found = diagnosis(verdict)
    found.save(tmp_path / "diagnosis.json")
    of_file = load_fitted_models(tmp_path / "diagnosis.json", found.dataset)
    for question in (FittedModels.of(found).question, of_file.question):
        assert question is not None
        assert (question.purpose, question.names) == (purpose, names)


def test_the_runner_up_is_the_one_that_explains_most_beside_the_named_cause() -> None:
    found = diagnosis("named")
    rows = {row.names: row for row in found.table.rows}
    third = {("tail_compliance",): replace(rows["tail_compliance",], gain=700.0)}
    question = FittedModels.of(replace(found, table=Table(0.0, Comparison({**rows, **third})))).question
    assert question is not None
    assert question.names == ("servo_lag", "tail_compliance")


@pytest.fixture
def no_fit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fitted_models, "fit", lambda *_, **__: pytest.fail("a model was fitted"))


@pytest.fixture(scope="module")
def found() -> Diagnosis:
    return diagnosis("cannot_tell")


@pytest.mark.usefixtures("no_fit")
def test_nothing_is_fitted_that_the_diagnosis_fitted_and_its_json_says_the_same(
    found: Diagnosis, tmp_path: Path
) -> None:
    """Held-out trials count too, without a fit to them."""
    found.save(tmp_path / "diagnosis.json")
    menu = Menu(duration=2.0)
    of_object = plan(found, menu=menu)
    of_file = plan(load_fitted_models(tmp_path / "diagnosis.json", found.dataset), menu=menu)
    assert of_object.question.names == ("servo_lag", "time_offset")
    assert of_object.status == "ok"
    assert len(of_object.runs) > 10
    assert of_file.to_dict() == of_object.to_dict()
    fitted_only = replace(found, dataset=replace(found.dataset, trials=found.problem.trials))
    assert of_object.runs[0].worst.now > 1.05 * plan(fitted_only, menu=menu).runs[0].worst.now


@pytest.mark.usefixtures("no_fit")
def test_where_nothing_is_wrong_the_nominal_model_is_as_it_was_fitted() -> None:
    chosen = plan(diagnosis("nothing_wrong"), causes=("munk_moment",), menu=Menu(duration=2.0))
    assert chosen.question.names == ("munk_moment",)
    assert np.isfinite(chosen.runs[0].worst.now)


def test_a_file_of_another_dataset_or_of_other_runs_is_refused(found: Diagnosis, tmp_path: Path) -> None:
    path, dataset = tmp_path / "diagnosis.json", found.dataset
    with pytest.raises(InputError, match="no such file; write it by 'mjfish diagnose"):
        load_fitted_models(path, dataset)
    found.save(path)
    with pytest.raises(InputError, match="of 'pool week 12', expected that of 'other'"):
        load_fitted_models(path, replace(dataset, name="other"))


def test_rivals_are_two_at_least_each_once_and_known(found: Diagnosis) -> None:
    with pytest.raises(InputError, match="two or more"):
        Question("separate", ("a",))
    with pytest.raises(InputError, match="there twice"):
        Question("separate", ("a", "a"))
    with pytest.raises(InputError, match="found with causes"):
        plan(found, rivals=("a", "b"), causes=("c",))
    with pytest.raises(UnknownNameError, match="no_such"):
        plan(found, rivals=("servo_lag", "no_such"))
