"""A study of four small pieces, and how its folder is looked at and its command run."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

ROOT = Path(__file__).parents[2]
COMMAND = [sys.executable, "-c", "from mjfish.cli import main; main()", "study"]
SMALL = """
schema = 1
seeds = [1, 2]

[[generate]]
name = "lag"
modes = ["v1"]
duration = 2.0
effects = { servo_lag = { time_constant = 0.03 } }

[[generate]]
name = "plain"
modes = ["v1"]
duration = 2

[[identify]]
name = "quick"
starts = 1
free = ["c_d.*"]
"""


def write_study(folder: Path, text: str = SMALL) -> Path:
    """Write a study into `folder` and return its file."""
    file = folder / "study.toml"
    file.write_text(text)
    return file


def contents(out: Path) -> dict[str, bytes]:
    """Return the bytes of every piece by its name."""
    return {path.name: path.read_bytes() for path in (out / "pieces").glob("*.json")}


def start(*arguments: str | Path) -> subprocess.Popen[str]:
    """Start ``mjfish study`` in a session of its own."""
    return start_python(*COMMAND[1:], *arguments)


def start_python(*arguments: str | Path) -> subprocess.Popen[str]:
    """Start Python in a session of its own, with the paths of this process.

    Ctrl-C ends it, also where it does not end this process, as in the background of a script.
    """
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), *sys.path])}
    return subprocess.Popen(
        [sys.executable, *map(str, arguments)],
        env=environment, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=True,
        preexec_fn=partial(signal.signal, signal.SIGINT, signal.SIG_DFL),
    )  # fmt: skip


def printed_by(process: subprocess.Popen[str]) -> str:
    """Wait for the end of a process; return what it printed. One that goes on is killed, with its workers."""
    try:
        return "".join(process.communicate(timeout=500))
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        raise


def said_by(printed: str) -> list[str]:
    """Return what was printed but for the lines of progress."""
    return [line for line in printed.splitlines() if not re.search(r"\(\d+%(, about .* left)?\)$", line)]


def finish(*arguments: str | Path) -> tuple[int, str]:
    """Run ``mjfish study``; return its exit code, and what it printed."""
    process = start(*arguments)
    printed = printed_by(process)
    return process.returncode, printed


def wait_until(condition: Callable[[], bool], seconds: float = 300.0) -> None:
    """Wait until a condition holds."""
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.02)


def workers_of(pid: int) -> list[int]:
    """Return the worker processes of a run."""
    tasks = Path(f"/proc/{pid}/task").iterdir()
    children = [child for task in tasks for child in (task / "children").read_text().split()]
    return [int(child) for child in children if b"spawn_main" in Path(f"/proc/{child}/cmdline").read_bytes()]


def running(pid: int) -> bool:
    """Return whether a process runs."""
    stat = Path(f"/proc/{pid}/stat")
    return stat.exists() and stat.read_text().rpartition(")")[2].split()[0] != "Z"
