"""Running commands as a user does, in this process."""

from __future__ import annotations

import re
import shlex
from collections.abc import Callable
from pathlib import Path

import pytest
from command_line import Run
from typer.testing import CliRunner, Result

from mjfish.cli import application, console


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Run:
    """Run one command line in an empty folder; nothing but an exit may leave it, never a traceback."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "200")  # typer reads it at every message, the console once
    monkeypatch.setattr(console.out, "_width", 200)

    def command(line: str, exit_code: int = 0) -> Result:
        result = CliRunner().invoke(application(), shlex.split(line))
        assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
        assert result.exit_code == exit_code, result.output
        assert "Traceback" not in result.output
        return result

    return command


@pytest.fixture
def refuse(run: Run, tmp_path: Path) -> Callable[[str], str]:
    """Run a command line that must be refused: exit code 2, one message, nothing written; return the message."""

    def command(line: str) -> str:
        before = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*")}
        result = run(line, exit_code=2)
        assert {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*")} == before
        assert result.stdout == ""
        said = re.sub(r"\A[a-z ]+ \(0%\)\n", "", result.stderr)  # progress, told at once
        message = " ".join(said.split())
        assert message.startswith(("error: ", "Usage: "))
        return message

    return command
