"""Forced failures: whatever fails is listed with its reason, the rest is compared, and nothing is claimed."""

from __future__ import annotations

import functools
import json
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np
import pytest
from forced import CALLS, names, spoil
from schema_check import complaints

from mjfish.data import Dataset
from mjfish.diagnosis import Diagnosis, diagnose
from mjfish.diagnosis.assembly import failed_remarks
from mjfish.diagnosis.evidence import gather
from mjfish.diagnosis.failures import PartFailedError, Parts, finite, noting, tried
from mjfish.diagnosis.refit import refit_with
from mjfish.diagnosis.refit_result import Refit, extended
from mjfish.diagnosis.table import Comparison
from mjfish.diagnosis.verdict import Decision, withheld
from mjfish.effects import Effect, find
from mjfish.effects.mechanism import Domain
from mjfish.errors import InputError
from mjfish.estimation import Fit, Noise
from mjfish.estimation import fit as _fit_function
from mjfish.estimation.nominal import nominal_problem
from mjfish.estimation.problem import Problem
from mjfish.execution import PastLimitError, executing, limited, tasks
from mjfish.execution.checkpoint import Checkpoint
from mjfish.fish import load_fish
from mjfish.model import Model
from mjfish.parameters import Parameter
from mjfish.simulation.synthetic import generate

FIT = sys.modules[_fit_function.__module__]
DIAGNOSIS = sys.modules[diagnose.__module__]
CANDIDATES = ("time_offset", "velocity_scale")
HIDDEN = "time_offset"
CLAIMS = ("named", "nothing_wrong")


@functools.cache
def _data(hidden: bool) -> Dataset:
    values = {"time_offset.offset": 0.006} if hidden else {}
    effects = [find(HIDDEN)] if hidden else []
    return generate(
        load_fish("pike"), ["v1", "v3", "v5"], values=values, effects=effects, noise=(0.01, 0.01, 0.05), duration=5.2,
        held_out=["v5"], seed=1,
    )  # fmt: skip


@pytest.fixture(scope="module", autouse=True)
def _made() -> None:
    """Make the data before a test spoils the rollouts that they are made of, whichever test comes first."""
    for hidden in (False, True):
        _data(hidden)


def _diagnosed(hidden: bool, *own: Effect, **options: Any) -> Diagnosis:
    effects = {name: find(name) for name in CANDIDATES} | {effect.name: effect for effect in own}
    return diagnose(_data(hidden), effects=effects, **{"jobs": 1, **options})


def _assert_told(result: Diagnosis, part: str, reason: str) -> None:
    """Want a part listed with its reason everywhere, and nothing claimed."""
    assert result.verdict not in CLAIMS, result.message
    assert reason in result.failures[part]
    assert part in result.message
    assert any(part in remark and reason in remark for remark in result.remarks)
    assert result.status != "ok"
    assert result.causes == ()
    assert complaints("diagnosis-5", json.loads(json.dumps(result.to_dict()))) == []


@pytest.fixture(scope="module")
def found() -> dict[bool, Diagnosis]:
    """What is found where nothing fails."""
    return {hidden: _diagnosed(hidden) for hidden in (False, True)}


def test_without_a_failure_the_effect_is_named_and_nothing_else_is_wrong(found: dict[bool, Diagnosis]) -> None:
    assert [cause.name for cause in found[True].causes] == [HIDDEN]
    assert found[False].verdict == "nothing_wrong"
    assert all(result.failures == {} and result.status == "ok" for result in found.values())


def _of(problem: Problem, name: str) -> bool:
    return any(effect.name == name for effect in problem.model.effects)


def _minimiser(monkeypatch: pytest.MonkeyPatch, name: str | None, ends: Callable[..., Any]) -> None:
    """Let `ends` minimise where the model has the effect; None: always."""
    honest = FIT.minimise

    def minimise(posed: Problem, *given: Any) -> Any:
        if name is None or _of(posed, name):
            return ends(lambda evaluations: honest(posed, *given[:3], evaluations, *given[4:]))
        return honest(posed, *given)

    monkeypatch.setattr(FIT, "minimise", minimise)


def _singular(_minimise: Any) -> Any:
    raise np.linalg.LinAlgError("SVD did not converge")


def _at_once(minimise: Any) -> Any:
    """End after one evaluation."""
    return minimise(1)


#: Whether anything is hidden; that nothing is, is tried by the slow tests.
HIDDEN_OR_NOT = (pytest.param(False, marks=pytest.mark.slow), True)

SOLVERS = {
    "raises": (_singular, "SVD did not converge"),
    "stops": (_at_once, "stop"),
}
RAISES_OR_STOPS = ("raises", pytest.param("stops", marks=pytest.mark.slow))


@pytest.mark.slow
def test_a_cause_whose_refit_fails_is_listed_and_the_others_are_compared(monkeypatch: pytest.MonkeyPatch) -> None:
    _minimiser(monkeypatch, HIDDEN, _singular)
    result = _diagnosed(hidden=True)
    _assert_told(result, HIDDEN, "SVD did not converge")
    _assert_compared(result, "velocity_scale")


def test_a_refit_that_is_stopped_is_a_row_that_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    """What it explains is a lower bound: it counts, and its numbers are said not to be final."""
    _minimiser(monkeypatch, HIDDEN, _at_once)
    result = _diagnosed(hidden=True)
    (row,) = (row for row in result.table.rows if row.names == (HIDDEN,))
    assert row.status == "stopped"
    assert row.stays()
    assert result.failures == {}
    assert result.status == "fit_not_converged"
    _assert_compared(result, HIDDEN)


def test_a_rival_whose_refit_fails_keeps_the_cause_from_being_named(monkeypatch: pytest.MonkeyPatch) -> None:
    """It might have explained as much; what the others explain is what they explain without it."""
    _minimiser(monkeypatch, "velocity_scale", _singular)
    result = _diagnosed(hidden=True)
    _assert_told(result, "velocity_scale", "SVD did not converge")
    _assert_compared(result, HIDDEN)
    assert result.alternatives == ((HIDDEN,),)
    assert "The cause is time_offset" in result.message
    failed = next(candidate for candidate in result.candidates if candidate.name == "velocity_scale")
    assert (failed.failure, failed.row) == (result.failures["velocity_scale"], None)


@pytest.mark.parametrize("hidden", HIDDEN_OR_NOT)
@pytest.mark.parametrize("how", RAISES_OR_STOPS)
def test_where_every_fit_fails_nothing_is_claimed(monkeypatch: pytest.MonkeyPatch, how: str, hidden: bool) -> None:
    ends, reason = SOLVERS[how]
    _minimiser(monkeypatch, None, ends)
    _assert_told(_diagnosed(hidden), "the fit of the nominal model", reason)


def _assert_compared(result: Diagnosis, name: str) -> None:
    candidate = next(candidate for candidate in result.candidates if candidate.name == name)
    assert candidate.row is not None
    assert candidate.failure == ""
    assert name not in result.failures


@pytest.mark.slow
def test_a_residual_that_is_no_number_is_a_failure(monkeypatch: pytest.MonkeyPatch) -> None:
    honest = Problem.residual

    def residual(self: Problem, x: Any) -> Any:
        return honest(self, x) * (np.nan if _of(self, "velocity_scale") else 1.0)

    monkeypatch.setattr(Problem, "residual", residual)
    result = _diagnosed(hidden=True)
    _assert_told(result, "velocity_scale", "not finite")
    _assert_compared(result, HIDDEN)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["velocity_scale", None])
def test_a_rollout_that_diverges_is_a_failure(monkeypatch: pytest.MonkeyPatch, name: str | None) -> None:
    honest = Model.predict

    def predict(self: Model, *given: Any, **options: Any) -> Any:
        found = honest(self, *given, **options)
        if name is None or any(effect.name == name for effect in self.effects):
            lost = np.full_like(found.velocity, np.nan)
            return replace(found, velocity=lost, status="diverged", message="diverged at 0.1 s")
        return found

    monkeypatch.setattr(Model, "predict", predict)
    result = _diagnosed(hidden=True)
    _assert_told(result, name or "the fit of the nominal model", "diverged at 0.1 s")
    if name is not None:
        _assert_compared(result, HIDDEN)


@pytest.mark.slow
def test_a_candidate_that_takes_longer_than_it_may_is_a_failure(monkeypatch: pytest.MonkeyPatch) -> None:
    """By a clock that goes on by an hour at every residual of one candidate, and stands still else."""
    now, honest = [0.0], Problem.residual

    def residual(self: Problem, x: Any) -> Any:
        now[0] += 3600.0 if _of(self, "velocity_scale") else 0.0
        return honest(self, x)

    monkeypatch.setattr(tasks, "time", SimpleNamespace(monotonic=lambda: now[0]))
    monkeypatch.setattr(Problem, "residual", residual)
    result = _diagnosed(hidden=True, limit=4000.0)
    _assert_told(result, "velocity_scale", "it took longer than the limit of 4000 s")
    _assert_compared(result, HIDDEN)


def test_where_a_pair_fails_its_members_go_on(monkeypatch: pytest.MonkeyPatch) -> None:
    """Catches the failure of a pair that takes the cause that was added last from all other sets."""
    dataset, (first, second) = _data(True), map(find, CANDIDATES)
    problem = nominal_problem(dataset, dataset.split()[0], Noise.white(np.asarray(dataset.noise)))
    found = _fit_function(problem)
    (base,) = extended(refit_with, [first], gather(problem, found, [first, second]))
    _minimiser(monkeypatch, second.name, _singular)
    with noting(Parts()) as parts:
        assert [*extended(refit_with, [second], gather(base.problem, base.fit, [second]))] == []
        assert "SVD did not converge" in parts.failures["time_offset with velocity_scale"]
        monkeypatch.undo()
        (alone,) = extended(refit_with, [second], gather(problem, found, [first, second]))
        assert alone.names == ("velocity_scale",)


@pytest.mark.parametrize("stage", [pytest.param("converged_formula", marks=pytest.mark.slow), "lowest"])
def test_a_leader_that_fails_where_it_is_followed_stays_a_row(monkeypatch: pytest.MonkeyPatch, stage: str) -> None:
    """Catches a set that failed late and is in the verdict, yet not among the candidates any more."""
    module = sys.modules["mjfish.diagnosis.refit" if stage == "converged_formula" else "mjfish.diagnosis.compared"]
    honest = getattr(module, stage)

    def late(refit: Refit, *given: Any, **more: Any) -> Refit:
        if refit.names == (HIDDEN,):
            raise PastLimitError("it took longer than the limit of 1 s")
        return honest(refit, *given, **more)

    monkeypatch.setattr(module, stage, late)
    monkeypatch.setattr(Comparison, "retained", lambda _self, **_how: [])  # so that lower minima are looked for
    result = _diagnosed(hidden=True)
    _assert_told(result, HIDDEN, "it took longer than the limit of 1 s")
    assert (HIDDEN,) in [row.names for row in result.table.rows]


def test_what_is_the_fault_of_no_candidate_is_blamed_on_none() -> None:
    """The time of whoever asks is up, or a cause of the model that they extend raises."""
    dataset, candidates = _data(True), [find(name) for name in CANDIDATES]
    problem = nominal_problem(dataset, dataset.split()[0], Noise.white(np.asarray(dataset.noise)))
    found = _fit_function(problem)
    with noting(Parts()) as parts:
        assert tried(["servo_lag"], lambda: _gathered_late(problem, found, candidates), "nothing") == "nothing"
        assert [*parts.failures] == ["servo_lag"]
        assert "longer than the limit" in parts.failures["servo_lag"]


def _gathered_late(problem: Problem, found: Fit, candidates: list[Effect]) -> str:
    with limited(-1.0):
        gather(problem, found, candidates)
    return "evidence"


def test_refits_after_a_failure_are_kept_apart_from_those_without_it(tmp_path: Path) -> None:
    """Their steps have the same numbers, but go by other noise and other bests."""
    dataset, effect = _data(True), find(HIDDEN)
    problem = nominal_problem(dataset, dataset.split()[0], Noise.white(np.asarray(dataset.noise)))
    evidence = gather(problem, _fit_function(problem), [effect])
    for failures in ({}, {"velocity_scale": "it took too long"}):
        with noting(Parts(dict(failures))), executing(1, checkpoint=Checkpoint(tmp_path, "a")):
            assert len([*extended(refit_with, [effect], evidence)]) == 1
    assert len([*tmp_path.iterdir()]) == 2


@pytest.mark.parametrize("at", ["reading", *(pytest.param(at, marks=pytest.mark.slow) for at in ("drive", "priors"))])
def test_nothing_begins_anew_where_a_candidate_fails(monkeypatch: pytest.MonkeyPatch, at: str) -> None:
    begun, honest = [], DIAGNOSIS.screen
    monkeypatch.setattr(DIAGNOSIS, "screen", lambda *given, **asked: (begun.append(given), honest(*given, **asked))[1])
    _assert_told(_diagnosed(True, _broken(at, _raises)), "broken", "KeyError: 'no such gear'")
    assert len(begun) == 1


def test_a_limit_that_is_not_reached_and_more_jobs_change_nothing(found: dict[bool, Diagnosis]) -> None:
    limited = _diagnosed(hidden=True, limit=1e6, jobs=2)
    assert limited.to_dict() == found[True].to_dict()


def test_a_limit_of_no_time_is_refused() -> None:
    with pytest.raises(InputError, match="limit: found 0 s, expected more than 0"):
        _diagnosed(hidden=False, limit=0.0)


class Broken(Effect):
    """An effect whose method `at` raises, or gives nonsense."""

    name: ClassVar[str] = "broken"
    domain: ClassVar[Domain] = "drive"
    summary: ClassVar[str] = "something breaks"
    parameters: ClassVar[tuple[Parameter, ...]] = (Parameter("broken.size", "-", 0.0, -1.0, 1.0, 0.0, 0.01),)
    source: ClassVar[str] = "made for this test"
    signature: ClassVar[str] = "none"
    confirm: ClassVar[str] = "no bench needed"
    at: ClassVar[str]


def _raises(*_given: Any, **_options: Any) -> Any:
    raise KeyError("no such gear")


def _nothing(*_given: Any, **_options: Any) -> None:
    return None


def _no_number(_self: Any, given: Any, *_rest: Any) -> Any:
    return np.asarray(given) * np.nan


#: Methods that may raise, and methods with the nonsense that they may give, and how it is told.
METHODS = ("drive", "body", "start", "clock", "reading", "priors", "not_applicable", "for_fish")
NONSENSE = [
    ("reading", _nothing, "TypeError"),
    ("drive", _nothing, "AttributeError"),
    ("reading", _no_number, "not finite"),
    ("start", _no_number, "not finite"),
    ("clock", _no_number, "not finite"),
]


def _broken(at: str, does: Callable[..., Any], name: str = "broken") -> Effect:
    """Return an effect that breaks in one of its methods; a reading that works makes the others be asked."""
    size = (replace(Broken.parameters[0], name=f"{name}.size"),)

    def reading(_self: Any, state: Any, values: Any, _trial: Any) -> Any:
        return state * (1.0 + values["size"])

    return type("Broken", (Broken,), {"name": name, "parameters": size, "reading": reading, at: does})()


def _off_far_away(_self: Any, state: Any, values: Any, _trial: Any) -> Any:
    if abs(values["size"]) > 0.001:
        raise ZeroDivisionError("too large")
    return state * (1.0 + values["size"])


def _off_when_held_out(_self: Any, state: Any, values: Any, trial: Any) -> Any:
    if trial.name == "v5":
        raise ValueError("not in v5")
    return state * (1.0 + values["size"])


def _off_in_one_sample(_self: Any, state: Any, values: Any, trial: Any) -> Any:
    late = (trial.time > 2.01) & (trial.name == "v3")
    gone = np.where(late[:, None] & (np.arange(8) == 1), np.nan, 1.0)
    return state * (gone if values["size"] else 1.0)


LOST_SAMPLE = (
    "the derivative by its sizes is not finite: sway of trial v3 at 2.02 s; see what it makes of the run there"
)


def test_parts_that_fail_each_in_its_own_way_are_listed_and_the_others_compared(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """All in one diagnosis; the slow tests have each of them alone.

    A candidate whose fit raises, one whose residual is no number, one whose rollout diverges, one that takes too long
    by a clock that goes on by an hour at each of its residuals, and effects that raise or give nonsense.
    """
    now, residual_of, prediction_of = [0.0], Problem.residual, Model.predict

    def residual(self: Problem, x: Any) -> Any:
        now[0] += 3600.0 if _of(self, "com_offset") else 0.0
        return residual_of(self, x) * (np.nan if _of(self, "velocity_scale") else 1.0)

    def predict(self: Model, *given: Any, **options: Any) -> Any:
        found = prediction_of(self, *given, **options)
        if not any(effect.name == "inertia_error" for effect in self.effects):
            return found
        lost = np.full_like(found.velocity, np.nan)
        return replace(found, velocity=lost, status="diverged", message="diverged at 0.1 s")

    def raising(at: str) -> Callable[..., Any]:
        def raises(*_given: Any, **_options: Any) -> Any:
            raise KeyError(f"no such {at}")

        return raises

    monkeypatch.setattr(Problem, "residual", residual)
    monkeypatch.setattr(Model, "predict", predict)
    monkeypatch.setattr(tasks, "time", SimpleNamespace(monotonic=lambda: now[0]))
    _minimiser(monkeypatch, "servo_lag", _singular)
    reasons = {
        "servo_lag": "SVD did not converge",
        "velocity_scale": "not finite",
        "inertia_error": "diverged at 0.1 s",
        "com_offset": "it took longer than the limit of 4000 s",
        "far": "ZeroDivisionError: too large",
        "held_out": "ValueError: not in v5",
        "sample": LOST_SAMPLE,
    }
    own = [find(name) for name in ("servo_lag", "inertia_error", "com_offset")]
    own += [_broken("reading", _off_far_away, "far"), _broken("reading", _off_when_held_out, "held_out")]
    own += [_broken("reading", _off_in_one_sample, "sample")]
    for at in METHODS:
        own.append(_broken(at, raising(at), f"raising_{at}"))
        reasons[f"raising_{at}"] = f"KeyError: 'no such {at}'"
    for k, (at, does, reason) in enumerate(NONSENSE):
        own.append(_broken(at, does, f"nonsense_{k}"))
        reasons[f"nonsense_{k}"] = reason
    result = _diagnosed(True, *own, limit=4000.0)
    assert result.verdict not in CLAIMS
    assert result.status != "ok"
    assert result.failures.keys() == reasons.keys()
    for name, reason in reasons.items():
        assert reason in result.failures[name], name
        assert any(name in remark and reason in remark for remark in result.remarks) or reason == "not finite", name
    _assert_compared(result, HIDDEN)
    assert complaints("diagnosis-5", json.loads(json.dumps(result.to_dict()))) == []


@pytest.mark.slow
@pytest.mark.parametrize("hidden", [False, True])
@pytest.mark.parametrize("at", METHODS)
def test_an_effect_that_raises_is_a_failure(at: str, hidden: bool) -> None:
    result = _diagnosed(hidden, _broken(at, _raises))
    _assert_told(result, "broken", "KeyError: 'no such gear'")
    for name in CANDIDATES if hidden else ():
        _assert_compared(result, name)


@pytest.mark.slow
@pytest.mark.parametrize("hidden", [False, True])
@pytest.mark.parametrize(("at", "does", "reason"), NONSENSE)
def test_an_effect_that_gives_nonsense_is_a_failure(
    at: str, does: Callable[..., Any], reason: str, hidden: bool
) -> None:
    _assert_told(_diagnosed(hidden, _broken(at, does)), "broken", reason)


@pytest.mark.slow
def test_the_first_derivative_that_is_no_number_is_named_with_trial_and_time() -> None:
    _assert_told(_diagnosed(True, _broken("reading", _off_in_one_sample)), "broken", LOST_SAMPLE)


def test_the_first_residual_that_is_no_number_is_named_with_trial_and_time() -> None:
    dataset = _data(True)
    problem = nominal_problem(dataset, dataset.split()[0], Noise.white(np.asarray(dataset.noise)))
    residual = problem.residual(problem.start())
    second = problem.rows_by_trial()[1]
    residual[second.start + 3 * 10 + 2 :] = np.nan
    time = dataset.trials[1].time[problem.mask(1)][10]
    assert problem.lost_row(residual) == f"yaw_rate of trial v3 at {time:.4g} s"
    velocity = np.zeros((len(dataset.trials[0].time), 3))
    velocity[7:, 0] = np.nan
    lost = replace(problem.prediction(dataset.trials[0], problem.named(problem.start())), velocity=velocity)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Problem, "prediction", lambda *_: lost)
        assert problem.divergence(problem.start()).startswith("surge of trial v1 at 0.14 s is no number")


def test_parts_that_fail_for_the_same_reason_are_one_line_with_their_count() -> None:
    alike = dict.fromkeys([f"cause_{k}" for k in range(32)], "it diverged") | {"other": "SVD did not converge"}
    lines = [*failed_remarks(alike)]
    assert lines == [
        "failed: cause_0, cause_1, cause_2 and others (32 in all): it diverged",
        "failed: other: SVD did not converge",
    ]
    said = withheld(Decision("named", (), "The cause is a."), alike).message
    assert "cause_0, cause_1, cause_2 and others (32 in all) failed (it diverged); other failed (SVD" in said
    several = {f"cause_{k}": f"reason {k}" for k in range(5)}
    assert "reason 2); others failed (5 in all); mend" in withheld(Decision("named", (), "x"), several).message


def test_a_statistic_that_is_no_number_is_named() -> None:
    with pytest.raises(PartFailedError) as caught:
        finite("the test", directed=0.1, omnibus=np.nan)
    assert caught.value.args == ("the test", "its statistic 'omnibus' is no number")


@pytest.mark.slow
def test_an_effect_that_raises_at_some_sizes_alone_is_a_failure() -> None:
    """Its score is fine: it fails in its refit."""
    _assert_told(_diagnosed(True, _broken("reading", _off_far_away)), "broken", "ZeroDivisionError: too large")


@pytest.mark.slow
def test_an_effect_that_raises_on_held_out_trials_alone_is_a_failure() -> None:
    _assert_told(_diagnosed(True, _broken("reading", _off_when_held_out)), "broken", "ValueError: not in v5")


WAYS = ("raises", "no number")
#: A few that every run has, for the fast tests, each in one of the ways.
FEW = [
    ("mjfish.numerics.block_angular", "numpy.linalg", "svd"),
    ("mjfish.diagnosis.evidence", "numpy.linalg", "eigh"),
    ("mjfish.estimation.stability", "scipy.optimize", "minimize"),
]


@pytest.mark.parametrize(("call", "how"), [*zip(FEW, ("raises", "no number", "raises"), strict=True)], ids=names(FEW))
def test_where_a_solver_fails_nothing_is_claimed(
    monkeypatch: pytest.MonkeyPatch, call: tuple[str, str, str], how: str
) -> None:
    calls = spoil(monkeypatch, call, how)
    result = _diagnosed(hidden=False)
    assert calls
    assert result.verdict not in CLAIMS
    assert result.failures
    assert complaints("diagnosis-5", json.loads(json.dumps(result.to_dict()))) == []


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("how", WAYS)
@pytest.mark.parametrize("call", CALLS, ids=names(CALLS))
def test_whichever_solver_fails_nothing_is_claimed(
    monkeypatch: pytest.MonkeyPatch, call: tuple[str, str, str], how: str, found: dict[bool, Diagnosis]
) -> None:
    """Where something is hidden: more is computed there."""
    calls = spoil(monkeypatch, call, how)
    result = _diagnosed(hidden=True)
    if calls:
        assert result.verdict not in CLAIMS
        assert result.failures
    else:
        assert result.to_dict() == found[True].to_dict()
