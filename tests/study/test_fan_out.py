"""The same bytes by threads, processes and Dask."""

from __future__ import annotations

import importlib.util
import sys
import time
from collections.abc import Callable
from concurrent.futures import BrokenExecutor, Executor, Future
from pathlib import Path
from typing import Any

import pytest
from small_study import contents, finish, write_study

from mjfish.execution import executing, mapped
from mjfish.study import read_cases, run
from mjfish.study.run import Executing

DASK = importlib.util.find_spec("distributed") is not None


def _later(seconds: float) -> float:
    time.sleep(seconds)
    return seconds


def test_threads_return_results_in_the_order_of_the_tasks() -> None:
    """Whatever the order of completion, and they do work side by side."""
    tasks = [0.3, 0.0, 0.1]
    for jobs in (3, 1):
        with executing(jobs):
            assert [*mapped(_later, tasks)] == tasks


def test_an_error_of_a_task_is_raised_in_its_place() -> None:
    with executing(2):
        results = mapped(lambda task: 1 / task, [1, 2, 0, 4])
        assert [next(results), next(results)] == [1.0, 0.5]
        with pytest.raises(ZeroDivisionError):
            next(results)


@pytest.mark.slow
@pytest.mark.parametrize(
    "by",
    [
        ("--jobs", "2"),
        pytest.param(
            ("--cluster", "local", "--jobs", "2"),
            marks=pytest.mark.skipif(not DASK, reason="Dask is not installed (pip install 'mjfish[cluster]')"),
        ),
    ],
    ids=["processes", "dask"],
)
def test_the_bytes_are_those_of_one_process(by: tuple[str, ...], tmp_path: Path, made: dict[str, bytes]) -> None:
    code, printed = finish(write_study(tmp_path), "--out", tmp_path / "out", *by)
    assert code == 0, printed
    assert "4 were made, 0 of all failed" in printed
    assert contents(tmp_path / "out") == made


@pytest.mark.slow
@pytest.mark.skipif(not DASK, reason="Dask is not installed (pip install 'mjfish[cluster]')")
def test_a_scheduler_that_does_not_answer_is_a_named_error(tmp_path: Path) -> None:
    code, printed = finish(write_study(tmp_path), "--out", tmp_path / "out", "--cluster", "tcp://127.0.0.1:9")
    assert code == 2
    assert "no scheduler answers at tcp://127.0.0.1:9" in printed


def test_without_dask_a_cluster_is_a_named_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(ValueError, match=r"mjfish\[cluster\]"):
        run(read_cases(write_study(tmp_path)), tmp_path / "out", executing=Executing(cluster="local"))


class _Breaking(Executor):
    """Ends without an answer at one piece, and gives none to those after it."""

    def __init__(self) -> None:
        self._broken = False

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        future: Future[Any] = Future()
        (piece,) = args
        self._broken |= (piece.dataset.name, piece.seed) == ("lag", 2)
        if self._broken:
            future.set_exception(BrokenExecutor("it ended"))
        else:
            future.set_result(({"outcome": "done", "result": {}}, 0.0))
        return future


def test_a_piece_that_always_ends_its_worker_stays_missing_and_the_rest_is_made(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Executing, "executor", lambda *_: _Breaking())
    ran = run(read_cases(write_study(tmp_path)), tmp_path / "out", executing=Executing(jobs=2))
    assert (ran.made, ran.failed) == (3, 0)
    assert ran.unanswered == ("lag, quick, seed 2: its worker gave no answer (BrokenExecutor: it ended)",)
