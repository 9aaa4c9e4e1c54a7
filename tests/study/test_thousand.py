"""A study of a thousand small cases on a local Dask cluster, interrupted three times."""

from __future__ import annotations

import importlib.util
import os
import signal
from pathlib import Path

import pytest
from small_study import contents, finish, printed_by, running, said_by, start, wait_until, workers_of, write_study

from mjfish.study import read_cases, run

SEEDS = 250
STUDY = f"""
schema = 1
seeds = {[*range(SEEDS)]}

[[generate]]
name = "slow"
modes = ["v1"]
duration = 1.0

[[generate]]
name = "fast"
modes = ["v7"]
duration = 1.0

[[identify]]
name = "one"
free = ["c_d.tail"]
starts = 1

[[identify]]
name = "two"
free = ["c_d.tail", "c_d.body"]
starts = 1
"""
#: Pieces that are made once more, without a disturbance, to compare.
EVERY = 40


@pytest.mark.slow
@pytest.mark.timeout(3600)
@pytest.mark.skipif(importlib.util.find_spec("distributed") is None, reason="Dask is not installed")
@pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="child processes are looked up in /proc")
def test_a_thousand_cases_survive_three_interruptions(tmp_path: Path) -> None:
    """Kill -9 of a worker and of the main process, then Ctrl-C; the rest is made, and some are made again alone."""
    out = tmp_path / "out"
    arguments = (write_study(tmp_path, STUDY), "--out", out, "--cluster", "local", "--jobs", "2")

    def until(count: int) -> None:
        wait_until(lambda: (out / "pieces").is_dir() and len([*(out / "pieces").glob("*.json")]) >= count, 1800.0)

    process = start(*arguments)
    until(100)
    os.kill(workers_of(process.pid)[0], signal.SIGKILL)
    until(300)
    workers = workers_of(process.pid)
    process.kill()
    process.communicate()
    wait_until(lambda: not any(map(running, workers)))
    process = start(*arguments)
    until(600)
    os.killpg(process.pid, signal.SIGINT)
    printed = printed_by(process)
    assert process.returncode == 130, printed
    assert len(said_by(printed)) == 1, printed
    kept = len(contents(out))
    assert 600 <= kept < 4 * SEEDS
    code, printed = finish(*arguments)
    assert code == 0, printed
    assert f"{kept} pieces were there, {4 * SEEDS - kept} were made, 0 of all failed" in printed
    some = read_cases(arguments[0])[::EVERY]
    run(some, tmp_path / "plain")
    assert len(contents(out)) == 4 * SEEDS
    assert contents(tmp_path / "plain").items() <= contents(out).items()
    assert not list(out.glob(".*")) + list(out.glob("*.lock"))
    code, printed = finish(*arguments[:3], "--collect")
    assert code == 0, printed
    assert "1000 of 1000 pieces are done, 0 of them failed" in printed
