"""Processes that are killed, and Ctrl-C: what is done is kept, and the same command makes the rest, byte for byte."""

from __future__ import annotations

import importlib.util
import json
import os
import signal
import subprocess
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path

import pytest
from small_study import (
    SMALL,
    contents,
    finish,
    printed_by,
    running,
    said_by,
    start,
    start_python,
    wait_until,
    workers_of,
    write_study,
)

from mjfish.study import read_cases, run

DASK = pytest.mark.skipif(
    importlib.util.find_spec("distributed") is None, reason="Dask is not installed (pip install 'mjfish[cluster]')"
)
#: Four pieces of seconds each, so that a process that is killed after the first is in the middle of another.
LONG = """
schema = 1
seeds = [1, 2, 3, 4]

[[generate]]
name = "lag"
modes = ["v1", "v3"]
duration = 4.0
effects = { servo_lag = { time_constant = 0.03 } }

[[identify]]
name = "many"
starts = 5
"""
#: Four small pieces, and four that would take hours.
ENDLESS = f'{SMALL}[[identify]]\nname = "endless"\nstarts = 1000000\n'
LOCAL = ("--cluster", "local", "--jobs", "2")
RUNS = pytest.mark.parametrize("by", [("--jobs", "2"), pytest.param(LOCAL, marks=DASK)], ids=["processes", "dask"])

pytestmark = [
    pytest.mark.slow,
    pytest.mark.timeout(900),
    pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="child processes are looked up in /proc"),
]


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """The pieces of the long study, made without a disturbance."""
    folder = tmp_path_factory.mktemp("undisturbed")
    assert run(read_cases(write_study(folder, LONG)), folder / "out").made == 4
    return contents(folder / "out")


def _started(out: Path, *arguments: str | Path) -> subprocess.Popen[str]:
    """Start a run, and return it when a piece is done and others are under way."""
    process = start(*arguments, "--out", out)
    wait_until(lambda: any((out / "pieces").glob("*.json")) or process.poll() is not None)
    assert process.poll() is None, printed_by(process)
    return process


def _check_whole(out: Path, expected: dict[str, bytes]) -> None:
    """Some pieces are missing, all others have the bytes that are expected, and nothing is half written."""
    done = contents(out)
    assert 1 <= len(done) < len(expected)
    assert done.items() <= expected.items()


@RUNS
def test_a_run_that_is_killed_is_finished_by_the_same_command(
    by: tuple[str, ...], tmp_path: Path, undisturbed: dict[str, bytes]
) -> None:
    """Its workers end with it, its lock is taken over, and what was done stays."""
    file, out = write_study(tmp_path, LONG), tmp_path / "out"
    process = _started(out, file, *by)
    workers = workers_of(process.pid)
    process.kill()
    process.communicate()
    _check_whole(out, undisturbed)
    done = {path.name: path.stat().st_mtime_ns for path in (out / "pieces").iterdir()}
    assert workers
    assert list(out.glob("*.lock"))
    wait_until(lambda: not any(map(running, workers)), 60.0)
    code, printed = finish(file, "--out", out, *by)
    assert code == 0, printed
    assert f"{len(done)} pieces were there, {4 - len(done)} were made" in printed
    assert contents(out) == undisturbed
    assert all((out / "pieces" / name).stat().st_mtime_ns == written for name, written in done.items())
    assert not list(out.glob("*.lock"))


@RUNS
def test_a_worker_that_is_killed_costs_nothing_but_time(
    by: tuple[str, ...], tmp_path: Path, undisturbed: dict[str, bytes]
) -> None:
    file, out = write_study(tmp_path, LONG), tmp_path / "out"
    process = _started(out, file, *by)
    os.kill(workers_of(process.pid)[0], signal.SIGKILL)
    printed = printed_by(process)
    assert process.returncode == 0, printed
    assert "4 were made, 0 of all failed" in printed
    assert len(said_by(printed)) == 1, printed
    assert contents(out) == undisturbed


@contextmanager
def _ending(process: subprocess.Popen[str]) -> Iterator[subprocess.Popen[str]]:
    """Kill a process at the end of the block, where it still runs."""
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


@contextmanager
def _scheduler(folder: Path) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """Run a scheduler on the loopback interface; yield it and its address."""
    where = folder / "scheduler.json"
    where.unlink(missing_ok=True)
    module = ("-m", "distributed.cli.dask_scheduler")
    with _ending(
        start_python(
            *module, "--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--no-jupyter", "--scheduler-file", where
        )
    ) as process:
        wait_until(lambda: where.exists() or process.poll() is not None)
        assert process.poll() is None, printed_by(process)
        yield process, json.loads(where.read_text())["address"]


def _worker(address: str) -> subprocess.Popen[str]:
    module = ("-m", "distributed.cli.dask_worker")
    return start_python(
        *module, address, "--host", "127.0.0.1", "--nthreads", "1", "--no-nanny", "--no-dashboard",
        "--death-timeout", "60",
    )  # fmt: skip


@contextmanager
def _cluster(folder: Path) -> Iterator[str]:
    """Run a scheduler and two workers; yield the address."""
    with _scheduler(folder) as (_, address), _ending(_worker(address)), _ending(_worker(address)):
        yield address


@DASK
def test_a_killed_worker_of_a_dask_cluster_costs_nothing_but_time(
    tmp_path: Path, undisturbed: dict[str, bytes]
) -> None:
    file, out = write_study(tmp_path, LONG), tmp_path / "out"
    with _scheduler(tmp_path) as (_, address), _ending(_worker(address)) as first, _ending(_worker(address)):
        process = _started(out, file, "--cluster", address)
        first.kill()
        printed = printed_by(process)
    assert process.returncode == 0, printed
    assert "4 were made, 0 of all failed" in printed
    assert contents(out) == undisturbed


@DASK
def test_without_the_last_worker_a_run_waits_for_another_and_says_so(
    tmp_path: Path, undisturbed: dict[str, bytes]
) -> None:
    file, out = write_study(tmp_path, LONG), tmp_path / "out"
    with _scheduler(tmp_path) as (_, address):
        with _ending(_worker(address)):
            process = _started(out, file, "--cluster", address)
        assert process.stderr is not None
        said = ""
        while "no workers" not in said:
            said = process.stderr.readline()
            assert said, "it ended"
        with _ending(_worker(address)):
            printed = printed_by(process)
    assert said == f"warning: --cluster: {address} has no workers; the work waits for one\n"
    assert process.returncode == 0, printed
    assert contents(out) == undisturbed


@DASK
def test_a_killed_scheduler_is_a_named_error_and_the_same_command_finishes(
    tmp_path: Path, undisturbed: dict[str, bytes]
) -> None:
    file, out = write_study(tmp_path, LONG), tmp_path / "out"
    with _scheduler(tmp_path) as (scheduler, address), _ending(_worker(address)), _ending(_worker(address)):
        process = _started(out, file, "--cluster", address)
        scheduler.kill()
        printed = printed_by(process)
    assert process.returncode == 1, printed
    assert f"no scheduler answers at {address}" in printed
    assert "Traceback" not in printed
    assert "distributed." not in printed
    _check_whole(out, undisturbed)
    assert f"missing: {4 - len(contents(out))} pieces" in printed
    assert not list(out.glob("*.lock"))
    with _cluster(tmp_path) as address:
        code, printed = finish(file, "--out", out, "--cluster", address)
    assert code == 0, printed
    assert contents(out) == undisturbed


@pytest.mark.parametrize("sign", [signal.SIGINT, signal.SIGTERM], ids=["ctrl-c", "terminated"])
@pytest.mark.parametrize(
    "by",
    [(), ("--jobs", "2"), pytest.param(LOCAL, marks=DASK), pytest.param(None, marks=DASK)],
    ids=["here", "processes", "local", "cluster"],
)
def test_a_run_stops_at_once_where_it_is_asked_to(
    by: tuple[str, ...] | None, sign: signal.Signals, tmp_path: Path, made: dict[str, bytes]
) -> None:
    """In the middle of pieces that would take hours. Ctrl-C in a terminal is for all its processes."""
    file, out = write_study(tmp_path, ENDLESS), tmp_path / "out"
    send: Callable[[int, signal.Signals], None] = os.killpg if sign == signal.SIGINT else os.kill
    with _cluster(tmp_path) if by is None else nullcontext() as address:
        process = _started(out, file, *(("--cluster", address) if by is None else by))
        wait_until(lambda: len(contents(out)) == 2)
        workers = workers_of(process.pid)
        send(process.pid, sign)
        printed = printed_by(process)
    assert process.returncode == 130, printed
    assert said_by(printed) == [f"stopped: the pieces that are done are kept in {out}; the same command goes on"]
    assert contents(out).items() <= made.items()
    assert {path.name for path in out.iterdir()} == {"pieces", "seconds"}
    assert not any(map(running, workers))


def test_a_second_run_is_refused_while_the_first_is_at_work(tmp_path: Path) -> None:
    file, out = write_study(tmp_path, ENDLESS), tmp_path / "out"
    with _ending(_started(out, file)) as first:
        code, printed = finish(file, "--out", out)
        assert code == 2, printed
        (said,) = said_by(printed)
        assert said.endswith("another run is at work on these pieces; wait for it")
        assert first.poll() is None
    code, printed = finish(file, "--out", out, "--shard", "1/8")
    assert code == 0, printed
