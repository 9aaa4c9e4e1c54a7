"""The same bytes by threads, processes and Dask; after a process was killed, the same command finishes."""

from __future__ import annotations

import importlib.util
import os
import signal
import sys
import time
from collections.abc import Callable
from concurrent.futures import BrokenExecutor, Executor, Future
from pathlib import Path
from typing import Any

import pytest
from small_study import contents, finish, start, write_study

from mjfish.executors import threaded
from mjfish.study import read_cases, run
from mjfish.study.run import Executing

DASK = importlib.util.find_spec("distributed") is not None
PROCESSES = pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="child processes are looked up in /proc")


def _later(seconds: float) -> float:
    time.sleep(seconds)
    return seconds


def test_threads_return_results_in_the_order_of_the_tasks() -> None:
    """Whatever the order of completion, and they do work side by side."""
    tasks = [0.3, 0.0, 0.1]
    assert [*threaded(_later, tasks, 3)] == [*threaded(_later, tasks, 1)] == tasks


def test_an_error_of_a_task_is_raised_in_its_place() -> None:
    results = threaded(lambda task: 1 / task, [1, 2, 0, 4], 2)
    assert [next(results), next(results)] == [1.0, 0.5]
    with pytest.raises(ZeroDivisionError):
        next(results)


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


@pytest.mark.skipif(not DASK, reason="Dask is not installed (pip install 'mjfish[cluster]')")
def test_a_scheduler_that_does_not_answer_is_a_named_error(tmp_path: Path) -> None:
    code, printed = finish(write_study(tmp_path), "--out", tmp_path / "out", "--cluster", "tcp://127.0.0.1:9")
    assert code == 2
    assert "no scheduler answers at tcp://127.0.0.1:9" in printed


def test_without_dask_a_cluster_is_a_named_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(ValueError, match=r"mjfish\[cluster\]"):
        run(read_cases(write_study(tmp_path)), tmp_path / "out", executing=Executing(cluster="local"))


def _workers(pid: int) -> list[int]:
    """Return the workers of a run."""
    children = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    return [int(child) for child in children if b"spawn_main" in Path(f"/proc/{child}/cmdline").read_bytes()]


def _running(pid: int) -> bool:
    stat = Path(f"/proc/{pid}/stat")
    return stat.exists() and stat.read_text().rpartition(")")[2].split()[0] != "Z"


def _await(condition: Callable[[], bool], seconds: float = 300.0) -> None:
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.02)


@PROCESSES
@pytest.mark.slow
def test_a_run_that_is_killed_is_finished_by_the_same_command(tmp_path: Path, made: dict[str, bytes]) -> None:
    """Its workers end with it, its lock is taken over, and what was done stays."""
    arguments = (write_study(tmp_path), "--out", tmp_path / "out", "--jobs", "2")
    process = start(*arguments)
    pieces = tmp_path / "out" / "pieces"
    _await(lambda: pieces.is_dir() and any(pieces.glob("*.json")))
    workers = _workers(process.pid)
    process.kill()
    process.communicate()
    done = {path.name: path.stat().st_mtime_ns for path in pieces.glob("*.json")}
    assert workers
    assert 1 <= len(done) < 4
    assert list((tmp_path / "out").glob("*.lock"))
    _await(lambda: not any(map(_running, workers)), 60.0)
    code, printed = finish(*arguments)
    assert code == 0, printed
    assert f"{len(done)} pieces were there, {4 - len(done)} were made" in printed
    assert contents(tmp_path / "out") == made
    assert all((pieces / name).stat().st_mtime_ns == written for name, written in done.items())
    assert not list((tmp_path / "out").glob("*.lock"))


@PROCESSES
@pytest.mark.slow
def test_a_worker_that_is_killed_costs_nothing_but_time(tmp_path: Path, made: dict[str, bytes]) -> None:
    process = start(write_study(tmp_path), "--out", tmp_path / "out", "--jobs", "2")
    pieces = tmp_path / "out" / "pieces"
    _await(lambda: pieces.is_dir() and any(pieces.glob("*.json")))
    os.kill(_workers(process.pid)[0], signal.SIGKILL)
    printed = "".join(process.communicate(timeout=500))
    assert process.returncode == 0, printed
    assert "4 were made, 0 of all failed" in printed
    assert contents(tmp_path / "out") == made


class _Breaking(Executor):
    """Ends without an answer at one piece, and gives none to those after it."""

    def __init__(self) -> None:
        self._broken = False

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        future: Future[Any] = Future()
        (piece,) = args
        self._broken |= (piece.dataset.name, piece.seed) == ("lag", 2)
        if self._broken:
            future.set_exception(BrokenExecutor())
        else:
            future.set_result(({"outcome": "done", "result": {}}, 0.0))
        return future


@pytest.mark.slow
def test_a_piece_that_always_ends_its_worker_stays_missing_and_the_rest_is_made(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Executing, "executor", lambda *_: _Breaking())
    ran = run(read_cases(write_study(tmp_path)), tmp_path / "out", executing=Executing(jobs=2))
    assert (ran.made, ran.failed) == (3, 0)
    assert ran.unanswered == ("lag, quick, seed 2: its worker ended without an answer (BrokenExecutor)",)
