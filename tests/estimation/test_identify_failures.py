"""Forced failures of an identification: its status says so, and what can still be told is told."""

from __future__ import annotations

import functools
import json
import sys
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from forced import CALLS, names, spoil
from schema_check import complaints

from mjfish.data import Dataset
from mjfish.estimation import Identification, Settings, identify
from mjfish.estimation import fit as _fit_function
from mjfish.estimation.problem import Problem
from mjfish.fish import load_fish
from mjfish.model import Model
from mjfish.simulation.synthetic import generate

FIT = sys.modules[_fit_function.__module__]


@functools.cache
def _data() -> Dataset:
    noise = (0.01, 0.01, 0.05)
    return generate(load_fish("pike"), ["v1", "v3", "v5"], noise=noise, duration=5.2, held_out=["v5"], seed=1)


@pytest.fixture(scope="module", autouse=True)
def _made() -> None:
    """Make the data before a test spoils the rollouts that they are made of, whichever test comes first."""
    _data()


def _identified(starts: int = 1) -> Identification:
    return identify(_data(), Settings(starts=starts), jobs=1)


def _assert_told(result: Identification, status: str, reason: str) -> None:
    assert result.fit.status == status
    assert reason in result.fit.message
    assert f": {status} after" in result.summary()
    assert complaints("identification-3", json.loads(json.dumps(result.to_dict()))) == []


def _raises(*_given: Any, **_options: Any) -> Any:
    raise np.linalg.LinAlgError("SVD did not converge")


@pytest.mark.parametrize("starts", [1, 3])
def test_a_fit_whose_steps_cannot_be_solved_has_failed(monkeypatch: pytest.MonkeyPatch, starts: int) -> None:
    spoil(monkeypatch, ("mjfish.estimation.fit", "scipy.optimize", "lsq_linear"), "raises")
    result = _identified(starts)
    _assert_told(result, "failed", "forced")
    assert result.assessment is None
    assert result.reached == 0.0


def test_one_start_that_fails_leaves_the_others(monkeypatch: pytest.MonkeyPatch) -> None:
    honest, calls = FIT.minimise, list[int]()

    def minimise(*given: Any) -> Any:
        calls.append(1)
        return _raises() if len(calls) == 1 else honest(*given)

    monkeypatch.setattr(FIT, "minimise", minimise)
    result = _identified(starts=3)
    assert result.fit.status == "converged"
    assert 0.0 < result.reached < 1.0


def test_a_residual_that_is_no_number_is_a_failure(monkeypatch: pytest.MonkeyPatch) -> None:
    honest = Problem.residual
    monkeypatch.setattr(Problem, "residual", lambda self, x: honest(self, x) * np.nan)
    _assert_told(_identified(), "failed", "the residual is not finite")


@pytest.mark.parametrize("starts", [1, 3])
def test_where_every_start_diverges_the_status_says_so(monkeypatch: pytest.MonkeyPatch, starts: int) -> None:
    honest = Model.predict

    def predict(self: Model, *given: Any, **options: Any) -> Any:
        found = honest(self, *given, **options)
        lost = np.full_like(found.velocity, np.nan)
        return replace(found, velocity=lost, status="diverged", message="diverged at 0.1 s")

    monkeypatch.setattr(Model, "predict", predict)
    result = _identified(starts)
    _assert_told(result, "diverged", "v1 diverged at 0.1 s")
    assert result.reached == 0.0


def test_a_prediction_without_numbers_and_without_a_word_is_told_as_one(monkeypatch: pytest.MonkeyPatch) -> None:
    honest = Model.predict

    def predict(self: Model, *given: Any, **options: Any) -> Any:
        found = honest(self, *given, **options)
        return replace(found, velocity=np.full_like(found.velocity, np.nan))

    monkeypatch.setattr(Model, "predict", predict)
    _assert_told(_identified(), "diverged", "surge of trial v1 at 0 s is no number")


#: Those that every identification has, for the fast tests.
_MODULES = ("mjfish.estimation.fit", "mjfish.numerics.block_angular", "mjfish.estimation.stability")
FEW = [call for call in CALLS if call[0] in _MODULES]


def _assert_no_claim(patch: pytest.MonkeyPatch, call: tuple[str, str, str], how: str) -> list[int]:
    calls = spoil(patch, call, how)
    result = _identified()
    assert not calls or result.fit.status != "converged" or any("not scored" in remark for remark in result.remarks)
    return calls


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize("how", ["raises", "no number"])
@pytest.mark.parametrize("call", FEW, ids=names(FEW))
def test_where_a_solver_fails_the_fit_is_not_called_converged(
    monkeypatch: pytest.MonkeyPatch, call: tuple[str, str, str], how: str
) -> None:
    assert _assert_no_claim(monkeypatch, call, how)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("call", CALLS, ids=names(CALLS))
def test_whichever_solver_fails_the_fit_is_not_called_converged(
    monkeypatch: pytest.MonkeyPatch, call: tuple[str, str, str]
) -> None:
    _assert_no_claim(monkeypatch, call, "raises")
