"""What the commands share: consoles, tables, the progress bar, parsing of numbers, exit codes.

The consoles print text as it is: brackets, as in units, are not markup. Styles are given beside the text.
"""

from __future__ import annotations

import math
import shutil
import sys
import textwrap
import time
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn
from rich.table import Table
from rich.text import Text

from mjfish.errors import InputError
from mjfish.files import check_file, json_text
from mjfish.result import Result

#: Exit codes.
NOT_GOOD = 1
MISUSE = 2

#: Stands for standard output in the place of a file.
STDOUT = Path("-")

#: Characters that a text has beside a word, however narrow the terminal.
_NARROWEST = 40
#: Seconds between lines of progress.
_EVERY = 20.0

out = Console(highlight=False, markup=False, emoji=False)
err = Console(highlight=False, markup=False, emoji=False, stderr=True)


def say(*lines: str | tuple[str, str]) -> None:
    """Print lines whole, however narrow the terminal; a line may be a pair of text and style."""
    for line in lines:
        text, style = line if isinstance(line, tuple) else (line, "")
        out.print(Text(text, style=style), soft_wrap=True)


def item(word: str, text: str, style: str = "") -> None:
    """Print a word and, beside it, a text that is broken into lines between words."""
    lines = textwrap.wrap(text, max(out.width - len(word) - 2, _NARROWEST), break_on_hyphens=False)
    for number, line in enumerate(lines):
        out.print(Text.assemble((word, style) if number == 0 else " " * len(word), "  ", line), soft_wrap=True)


def check_json(path: Path | None) -> None:
    """Refuse a JSON file that cannot be written; ``-`` is standard output."""
    if path is not None and path != STDOUT:
        check_file(path)


def write_json(result: Result, path: Path | None) -> bool:
    """Write a result as JSON, where a path is given; return whether that is standard output, for nothing else then."""
    if path == STDOUT:
        sys.stdout.write(json_text(result.to_dict()))
    elif path is not None:
        result.save(path)
    return path == STDOUT


def complain(what: str, message: str) -> None:
    """Print what is wrong to stderr, its kind in red."""
    err.print(Text.assemble((f"{what}:", "bold red"), " ", message), soft_wrap=True)


def table(title: str, headings: Iterable[str], left: Collection[str] = (), **style: Any) -> Table:
    """Return a table whose columns are flush right but for those named in `left`; `style` goes to rich's ``Table``."""
    shown = Table(title=title, **style)
    for heading in headings:
        shown.add_column(heading, justify="left" if heading in left else "right", no_wrap=heading not in left)
    return shown


def program() -> str:
    """Return how this program was called, so that a printed command can be repeated as it stands."""
    if shutil.which("mjfish"):
        return "mjfish"
    called = Path(sys.argv[0])
    return str(called.relative_to(Path.cwd())) if called.is_relative_to(Path.cwd()) else str(called)


def is_asking() -> bool:
    """Return whether somebody sits at a terminal and can answer questions."""
    return sys.stdin.isatty() and sys.stdout.isatty()


@contextmanager
def progress_bar() -> Iterator[Callable[[str, float], None]]:
    """Show a progress bar on stderr while the block runs, where that is no terminal a line at times."""
    if not err.is_terminal:
        yield _progress_lines()
        return
    text = TextColumn("{task.description}", markup=False)
    with Progress(SpinnerColumn(), text, BarColumn(), TimeElapsedColumn(), console=err, transient=True) as bar:
        task = bar.add_task("starting", total=1.0)
        yield lambda what, done: bar.update(task, description=what, completed=done)


def _progress_lines() -> Callable[[str, float], None]:
    """Return a function that prints a line: the first at once, others every `_EVERY` seconds at most."""
    last = -math.inf

    def tell(what: str, done: float) -> None:
        nonlocal last
        now = time.monotonic()
        if now - last >= _EVERY:
            hint = "; a first run compiles for a minute or two" if math.isinf(last) else ""
            err.print(f"{what} ({done:.0%}{hint})", soft_wrap=True)
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


def names(text: str) -> tuple[str, ...]:
    """Parse comma-separated names."""
    return tuple(name.strip() for name in text.split(",") if name.strip())


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


def effect_settings(texts: Sequence[str]) -> dict[str, dict[str, float]]:
    """Parse ``NAME:PARAM=VALUE[,PARAM=VALUE]`` settings into values by effect and short name, or raise `InputError`."""
    result: dict[str, dict[str, float]] = {}
    for text in texts:
        name, colon, settings = text.partition(":")
        if not colon or not settings:
            raise InputError(f"--effect: found '{text}', expected NAME:PARAM=VALUE, e.g. servo_lag:time_constant=0.02")
        own = result.setdefault(name, {})
        for short, value in assignments(settings.split(","), f"--effect {name}").items():
            if short in own:
                raise InputError(f"--effect: '{name}.{short}' is set twice; set it once")
            own[short] = value
    return result
