"""Refits by any executor, and kept in a folder: the same answer to the last bit."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, Executor, Future
from dataclasses import fields
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

import cloudpickle
import numpy as np
import pytest

from mjfish.data import Dataset, Trial, save
from mjfish.diagnosis import diagnose
from mjfish.diagnosis import refit_result as module
from mjfish.diagnosis.evidence import gather
from mjfish.diagnosis.refit import converged_formula, converged_learned_form, refit_with
from mjfish.diagnosis.refit_result import Refit, extended, followed
from mjfish.effects import Effect, catalogue, find
from mjfish.effects.effect import Values
from mjfish.effects.mechanism import Domain
from mjfish.errors import InputError, WorkerError
from mjfish.estimation import Problem, Settings, identify
from mjfish.estimation.fit import fit
from mjfish.estimation.intervals import profiles
from mjfish.estimation.nominal import nominal_problem
from mjfish.execution import executing
from mjfish.execution.checkpoint import Checkpoint
from mjfish.execution.executors import cluster, processes
from mjfish.noise import Noise
from mjfish.numerics.arrays import FloatArray
from mjfish.numerics.sized_cache import Budget, Recomputable
from mjfish.parameters import Parameter
from mjfish.simulation import generate

QUICK = {name: find(name) for name in ("time_offset", "servo_lag", "ambient_current")}
OWN = Path(__file__).parents[1] / "effects" / "own_effects.py"


class Backwards(Executor):
    """Waits a moment for tasks, then runs the last first."""

    def __init__(self) -> None:
        self.tasks: list[tuple[Future[Any], Callable[[], Any]]] = []
        self.ran = 0

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Take a task."""
        future: Future[Any] = Future()
        self.tasks.append((future, lambda: fn(*args, **kwargs)))
        if len(self.tasks) == 1:
            threading.Timer(0.05, self.run).start()
        return future

    def run(self) -> None:
        """Run what there is."""
        tasks, self.tasks = self.tasks, []
        for future, call in reversed(tasks):
            self.ran += 1
            future.set_result(call())


class Broken(Executor):
    """All of whose workers are gone."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Refuse a task."""
        raise BrokenExecutor("gone")


@pytest.fixture(scope="module")
def dataset() -> Dataset:
    true = {"time_offset.offset": 0.02}
    return generate("pike", ["v1", "v3"], duration=4.0, rate=25.0, values=true, noise=(0.006, 0.006, 0.04))


@pytest.fixture(scope="module")
def answer(dataset: Dataset) -> str:
    return text(diagnose(dataset, effects=QUICK, jobs=1, seed=3))


def text(result: Any) -> str:
    return json.dumps(result.to_dict())


def test_neither_the_order_of_completion_nor_what_is_dropped_changes_the_answer(
    dataset: Dataset, answer: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An executor that runs the last task first; and residuals, derivatives, covariances, signatures are made again."""
    asked: list[Recomputable[Any]] = []

    def forgotten(_: Budget, one: Recomputable[Any], size: int) -> None:
        asked.append(one)
        one.value = None

    monkeypatch.setattr(Budget, "hold", forgotten)
    executor = Backwards()
    assert text(diagnose(dataset, effects=QUICK, executor=executor, seed=3)) == answer
    assert executor.ran >= len(QUICK)
    assert len(asked) > 100


def test_a_worker_that_is_gone_is_an_error_that_says_so(dataset: Dataset) -> None:
    with pytest.raises(WorkerError, match=r"ended without an answer \(BrokenExecutor\).*run the same command again"):
        diagnose(dataset, effects=QUICK, executor=Broken(), seed=3)


def test_starts_and_profiles_go_to_the_executor(dataset: Dataset) -> None:
    executor = Backwards()
    settings = Settings(free=("c_d.*",), starts=3)
    by_threads = identify(dataset, settings, jobs=1)
    by_executor = identify(dataset, settings, executor=executor)
    assert executor.ran == 3
    assert text(by_executor) == text(by_threads)
    names = ("c_d.head", "c_d.tail")
    assert by_executor.problem is not None
    assert by_threads.problem is not None
    with executing(executor=executor):
        found = [*profiles(by_executor.problem, by_executor.fit, names)]
    assert executor.ran == 5
    for mine, theirs in zip(found, profiles(by_threads.problem, by_threads.fit, names), strict=True):
        assert mine.values.tobytes() == theirs.values.tobytes()
        assert mine.rise.tobytes() == theirs.rise.tobytes()


def refitted(tmp_path: Path, cause: str, dataset: Dataset, follow: Callable[[Refit], Refit]) -> Iterator[list[Refit]]:
    """Yield a coarse refit and the one that is followed: as they are, as they are kept, and as they are read again."""
    whole = nominal_problem(dataset, dataset.split()[0], Noise.white(np.asarray(dataset.noise)))
    found = fit(whole)
    effect = catalogue()[cause]
    for kept in (None, Checkpoint(tmp_path, "a"), Checkpoint(tmp_path, "a")):
        with executing(1, checkpoint=kept):
            (coarse,) = extended(refit_with, [effect], gather(whole, found, [effect]))
            (fine,) = followed(follow, [coarse])
        yield [coarse, fine]


def vars_of(problem: Problem) -> dict[str, Any]:
    return {entry.name: getattr(problem, entry.name) for entry in fields(problem)}


@pytest.mark.parametrize(
    ("cause", "follow"),
    [
        ("servo_lag", partial(converged_formula, best=np.inf)),
        ("servo_backlash", partial(converged_formula, best=np.inf)),
        pytest.param("drag_law", converged_learned_form, marks=pytest.mark.slow),
    ],
)
def test_a_kept_refit_is_the_same_to_the_last_bit(
    cause: str, follow: Callable[[Refit], Refit], tmp_path: Path, dataset: Dataset
) -> None:
    """With everything that follows from it: residual, derivatives, errors, priors, bounds, integration step."""
    plain, kept, read = refitted(tmp_path, cause, dataset, follow)
    for mine, others in zip(plain, zip(kept, read, strict=True), strict=True):
        for other in others:
            assert other.names == mine.names
            assert other.gain == mine.gain
            for name in ("x", "residual", "covariance", "reach", "at_bound", "ended"):
                assert getattr(other.fit, name).tobytes() == getattr(mine.fit, name).tobytes(), name
            assert other.fit.jacobian.dense().tobytes() == mine.fit.jacobian.dense().tobytes()
            for name in ("sse", "penalty", "status", "message", "evaluations", "cost"):
                assert getattr(other.fit, name) == getattr(mine.fit, name), name
            own = {k: v for k, v in vars_of(other.problem).items() if k != "model"}
            assert own == {k: v for k, v in vars_of(mine.problem).items() if k in own}
            assert other.problem.model.step == mine.problem.model.step
            assert [e.name for e in other.problem.model.effects] == [e.name for e in mine.problem.model.effects]


@pytest.mark.slow
def test_finished_refits_are_not_made_again(
    dataset: Dataset, answer: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What was stopped half way goes on from there, a damaged file is made again, and the answer is the same."""
    made: list[str] = []
    recorded = module._recorded

    def counted(*arguments: Any) -> dict[str, Any]:
        made.append(arguments[-1][0])
        if len(made) == stop:
            raise KeyboardInterrupt
        return recorded(*arguments)

    stop = 3
    monkeypatch.setattr(module, "_recorded", counted)
    with pytest.raises(KeyboardInterrupt):
        diagnose(dataset, effects=QUICK, jobs=1, seed=3, resume=tmp_path)
    assert len([*tmp_path.iterdir()]) == 2
    stop = 0
    assert text(diagnose(dataset, effects=QUICK, jobs=1, seed=3, resume=tmp_path)) == answer
    files = sorted(tmp_path.iterdir())
    assert len(files) == len(made) - 1
    before = len(made)
    files[0].write_text(files[0].read_text().replace("gain", "gaim"))
    with pytest.warns(UserWarning, match=f"{files[0].name}: its content does not fit its hash; it is made again"):
        assert text(diagnose(dataset, effects=QUICK, jobs=1, seed=3, resume=tmp_path)) == answer
    assert len(made) == before + 1
    diagnose(dataset, effects=QUICK, jobs=1, seed=4, resume=tmp_path)
    assert len(made) >= 2 * before - 1, "another seed found the refits of this one"


def test_a_folder_that_cannot_be_made_is_refused_before_anything_is_fitted(dataset: Dataset, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot be made"):
        diagnose(dataset, effects=QUICK, resume=tmp_path / "file" / "kept")


@pytest.mark.slow
def test_causes_of_a_user_can_be_sent_to_other_processes(dataset: Dataset) -> None:
    """With their compiled loads, and without their file."""
    sent = cloudpickle.dumps(catalogue((OWN,))["linear_damping"])
    code = (
        "import sys, cloudpickle; effect = cloudpickle.loads(sys.stdin.buffer.read());"
        "print(effect.name, effect.load.address != 0, effect.parameters[0].unit)"
    )
    done = subprocess.run([sys.executable, "-c", code], input=sent, capture_output=True, check=True)
    assert done.stdout.decode().split() == ["linear_damping", "True", "N", "s/m"]
    assert cloudpickle.loads(sent).load is cloudpickle.loads(sent).load, "compiled once for each task"


@pytest.mark.slow
def test_processes_and_dask_give_the_same_answer(dataset: Dataset, answer: str) -> None:
    with processes(2) as executor:
        assert text(diagnose(dataset, effects=QUICK, executor=executor, seed=3)) == answer
    with cluster("local", 2) as executor:
        assert text(diagnose(dataset, effects=QUICK, executor=executor, seed=3)) == answer


def command(dataset: Path, out: Path, *more: str) -> list[str]:
    code = "from mjfish.cli import main; main()"
    return [sys.executable, "-c", code, "diagnose", str(dataset), "--json", str(out), "--jobs", "1", *more]


@pytest.mark.slow
@pytest.mark.parametrize("more", [(), ("--cluster", "local")], ids=["alone", "dask"])
def test_a_diagnosis_that_is_killed_goes_on(dataset: Dataset, tmp_path: Path, more: tuple[str, ...]) -> None:
    folder = save(dataset, tmp_path / "data")
    subprocess.run(command(folder, tmp_path / "whole.json"), check=True, capture_output=True)
    kept = tmp_path / "kept"
    again = command(folder, tmp_path / "resumed.json", "--resume", str(kept), *more)
    process = subprocess.Popen(again, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    end = time.monotonic() + 300.0
    while len([*kept.glob("*.json")] if kept.is_dir() else []) < 4:
        assert process.poll() is None
        assert time.monotonic() < end
        time.sleep(0.02)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    assert not (tmp_path / "resumed.json").exists()
    done = {file.name: file.stat().st_mtime_ns for file in kept.glob("*.json")}
    subprocess.run(again, check=True, capture_output=True)
    assert (tmp_path / "resumed.json").read_bytes() == (tmp_path / "whole.json").read_bytes()
    assert {name: (kept / name).stat().st_mtime_ns for name in done} == done


class Spoilt(Effect):
    """A wrong scale of the camera, that only a refit finds to be impossible."""

    name: ClassVar[str] = "spoilt"
    domain: ClassVar[Domain] = "data"
    summary: ClassVar[str] = "something breaks"
    parameters: ClassVar[tuple[Parameter, ...]] = (Parameter("spoilt.error", "-", 0.0, -0.5, 0.5, 0.0, 0.01),)
    source: ClassVar[str] = "made for this test"
    signature: ClassVar[str] = "none"
    confirm: ClassVar[str] = "no bench needed"

    def reading(self, state: FloatArray, values: Values, trial: Trial) -> FloatArray:
        """Raise far from the null."""
        del trial
        if abs(values["error"]) > 0.005:
            raise ZeroDivisionError("no such scale")
        return np.asarray(state * (1.0 + values["error"]))


@pytest.mark.slow
def test_a_candidate_that_fails_on_a_worker_is_listed_as_by_threads(dataset: Dataset, tmp_path: Path) -> None:
    """And the diagnosis without it keeps refits of its own: those with it have other steps."""
    effects = {**QUICK, "spoilt": Spoilt()}
    by_threads = diagnose(dataset, effects=effects, jobs=1, seed=3)
    assert "no such scale" in by_threads.failures["spoilt"]
    expected = text(by_threads)
    assert text(diagnose(dataset, effects=effects, executor=Backwards(), seed=3)) == expected
    for _ in range(2):
        assert text(diagnose(dataset, effects=effects, jobs=1, seed=3, resume=tmp_path)) == expected
