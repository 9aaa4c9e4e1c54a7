"""The code blocks of README and docs, and how they are run: in this process, in a folder of their own."""

from __future__ import annotations

import contextlib
import io
import re
import shlex
from pathlib import Path
from types import ModuleType

from typer.testing import CliRunner, Result

from mjfish.cli import application

ROOT = Path(__file__).parents[1]


def blocks(page: Path, language: str) -> list[str]:
    """Return the fenced blocks of one language, in order."""
    return re.findall(rf"^```{language}\n(.*?)^```", page.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)


def commands(page: Path) -> list[str]:
    """Return the command lines of the page's shell blocks that call mjfish, in order."""
    lines = [line for block in blocks(page, "sh") for line in block.splitlines()]
    return [line for line in lines if line.startswith("mjfish ")]


def _expanded(word: str) -> list[str]:
    """Return the files that a pattern is for, as a shell does; else the word."""
    return ("*" in word and sorted(map(str, Path().glob(word)))) or [word]


def run_command(line: str, folder: Path, exit_code: int = 0) -> str:
    """Run a command line of a page in `folder`, patterns of files expanded; return what it printed."""
    with contextlib.chdir(folder):
        words = [found for word in shlex.split(line)[1:] for found in _expanded(word)]
        result: Result = CliRunner().invoke(application(), words)
    assert result.exit_code == exit_code, f"{line}\n{result.output}\n{result.exception!r}"
    return result.stdout


def run_python(block: str, folder: Path) -> str:
    """Run a Python block of a page in `folder`; return what it printed."""
    printed = io.StringIO()
    with contextlib.chdir(folder), contextlib.redirect_stdout(printed):
        exec(compile(block, f"{folder}/block.py", "exec"), {"__name__": "block"})  # noqa: S102 - our own page
    return printed.getvalue()


def module(page: Path, name: str) -> ModuleType:
    """Return the Python block that begins with the comment ``# name.py``, run as a module of that name."""
    (source,) = (block for block in blocks(page, "python") if block.startswith(f"# {name}.py\n"))
    imported = ModuleType(name)
    exec(compile(source, f"{page.name}: {name}.py", "exec"), imported.__dict__)  # noqa: S102 - our own page
    return imported
