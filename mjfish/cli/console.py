"""What the commands share: console, progress bar, number lists, exit codes."""

from __future__ import annotations

import math
import shutil
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

from mjfish.diagnosis.progress import Progress as Told
from mjfish.errors import InputError

#: Exit codes.
NOT_GOOD = 1
MISUSE = 2

#: Seconds between lines of progress.
_EVERY = 20.0

out = Console(highlight=False)
err = Console(stderr=True, highlight=False)


def program() -> str:
    """Return how this program was called, so that a printed command can be repeated as it stands."""
    if shutil.which("mjfish"):
        return "mjfish"
    called = Path(sys.argv[0])
    return str(called.relative_to(Path.cwd())) if called.is_relative_to(Path.cwd()) else str(called)


@contextmanager
def progress_bar() -> Iterator[Told]:
    """Show a progress bar on stderr while the block runs, where that is no terminal a line at times."""
    if not err.is_terminal:
        yield _lines()
        return
    columns = (SpinnerColumn(), TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    with Progress(*columns, console=err, transient=True) as bar:
        task = bar.add_task("starting", total=1.0)

        def tell(what: str, done: float) -> None:
            bar.update(task, description=what, completed=done)

        yield tell


def _lines() -> Told:
    """Return a teller that prints a line: the first at once, others every `_EVERY` seconds at most."""
    last = -math.inf

    def tell(what: str, done: float) -> None:
        nonlocal last
        now = time.monotonic()
        if now - last >= _EVERY:
            hint = "; a first run compiles for a minute or two" if math.isinf(last) else ""
            err.print(escape(f"{what} ({done:.0%}{hint})"), soft_wrap=True)
            last = now

    return tell


def numbers(text: str, count: int, what: str) -> list[float]:
    """Parse comma-separated numbers, or raise `InputError` that says how many were expected."""
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError:
        values = []
    if len(values) != count or not all(math.isfinite(value) for value in values):
        wanted = "a number" if count == 1 else f"{count} numbers separated by commas"
        raise InputError(f"{what}: found '{text}', expected {wanted}; correct it")
    return values


def assignments(texts: Sequence[str], what: str) -> dict[str, float]:
    """Parse ``NAME=VALUE`` settings, or raise `InputError`."""
    result: dict[str, float] = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not equals or not name.strip():
            raise InputError(f"{what}: found '{text}', expected NAME=VALUE, e.g. c_d.head=2.0")
        if name.strip() in result:
            raise InputError(f"{what}: '{name.strip()}' is set twice; set it once")
        result[name.strip()] = numbers(value, 1, f"{what} {name.strip()}")[0]
    return result
