"""A study of four small pieces, and how its folder is looked at and its command run."""

from __future__ import annotations

import os
import subprocess
import sys
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
    return {path.name: path.read_bytes() for path in (out / "pieces").iterdir()}


def start(*arguments: str | Path) -> subprocess.Popen[str]:
    """Start ``mjfish study``."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), *sys.path])}
    command = [*COMMAND, *map(str, arguments)]
    return subprocess.Popen(command, env=environment, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE)


def finish(*arguments: str | Path) -> tuple[int, str]:
    """Run ``mjfish study``; return its exit code, and what it printed."""
    process = start(*arguments)
    printed = "".join(process.communicate(timeout=500))
    return process.returncode, printed
