"""What the commands share: consoles, tables, the progress bar, parsing of numbers, exit codes.

The consoles print text as it is: brackets, as in units, are not markup. Styles are given beside the text.
"""

from __future__ import annotations

import math
import os
import shutil
import sys
import textwrap
import time
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from concurrent.futures import Executor
from contextlib import AbstractContextManager, contextmanager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer
from rich import box
from rich.console import Console
from rich.progress import (
    BarColumn,
    Progress,
    SpinnerColumn,
    TaskProgressColumn,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.table import Table
from rich.text import Text

from mjfish.errors import InputError
from mjfish.files.writing import check_file, check_folder, check_suffix, json_text

if TYPE_CHECKING:
    from mjfish.effects import Effect
    from mjfish.files.result import Result

#: Exit codes.
NOT_GOOD = 1
MISUSE = 2
STOPPED = 130

#: Stands for standard output in the place of a file.
STDOUT = Path("-")

#: Characters that a text has beside a word, however narrow the terminal.
_NARROWEST = 40
#: Width at which every table fits, and characters of a name that stay on one line of it.
_ENDLESS, _SHORTEST = 10_000, 14
#: Seconds between lines of progress, and the least share of the work that is shown; the time left is told from the
#: speed of the last minutes.
_EVERY, _SHOWN, _MINUTES = 20.0, 0.001, 300.0

#: Option of commands whose work may go to other machines.
Cluster = Annotated[
    str | None,
    typer.Option(help="Address of a Dask scheduler whose workers take the work; 'local' starts one with --jobs."),
]

#: Option of commands that take causes of the user's own.
Own = Annotated[list[Path] | None, typer.Option(help="Python file with causes of your own; repeatable.")]

out = Console(highlight=False, markup=False, emoji=False)
err = Console(highlight=False, markup=False, emoji=False, stderr=True)


def say(*lines: str | tuple[str, str]) -> None:
    """Print lines whole, however narrow the terminal; a line may be a pair of text and style."""
    for line in lines:
        text, style = line if isinstance(line, tuple) else (line, "")
        out.print(Text(text, style=style), soft_wrap=True)


def width_beside(word: str) -> int:
    """Return how many characters of a text stand beside a word."""
    return max(out.width - len(word) - 2, _NARROWEST)


def wrapped(word: str, text: str) -> list[str]:
    """Return a text in lines that stand beside a word, broken between words."""
    return textwrap.wrap(text, width_beside(word), break_on_hyphens=False, break_long_words=False)


def item(word: str, text: str, style: str = "") -> None:
    """Print a word and, beside it, a text that is broken into lines between words."""
    for number, line in enumerate(wrapped(word, text)):
        out.print(Text.assemble((word, style) if number == 0 else " " * len(word), "  ", line), soft_wrap=True)


def show(shown: Table) -> None:
    """Print a table with all of its letters: names are broken into lines where there is no room, then numbers, too."""
    for column in shown.columns:
        column.max_width = None if column.no_wrap else _SHORTEST
    narrowest = out.measure(shown, options=out.options.update(width=_ENDLESS)).maximum
    for column in shown.columns:
        column.max_width = None
        column.no_wrap = column.no_wrap and narrowest <= out.width
    out.print(shown)


def listed(paths: Sequence[Path]) -> str:
    """Return paths as text, those of one folder together."""
    folders = {path.parent: [own.name for own in paths if own.parent == path.parent] for path in paths}
    return "; ".join(
        str(folder / names[0]) if len(names) == 1 else f"{folder}: {', '.join(names)}"
        for folder, names in folders.items()
    )


@contextmanager
def stoppable(told: Callable[[], str]) -> Iterator[None]:
    """Say on Ctrl-C what is `told` then."""
    try:
        yield
    except KeyboardInterrupt:
        complain("stopped", told())
        raise typer.Exit(STOPPED) from None


def workers(cluster: str | None, jobs: int | None) -> AbstractContextManager[Executor | None]:
    """Return the executor of a Dask cluster, None where none is asked for, for a block.

    Args:
        cluster: address of its scheduler; ``local`` starts one.
        jobs: workers of a local one; None: one a processor.
    """
    if cluster is None:
        return nullcontext()
    from mjfish.execution import executors

    return executors.cluster(cluster, jobs or os.cpu_count() or 1)


def check_outputs(
    *files: Path | None,
    folders: Sequence[Path | None] = (),
    suffixes: Sequence[tuple[Path | None, tuple[str, ...]]] = (),
) -> None:
    """Refuse files and folders that cannot be written; None stands for none, ``-`` for standard output.

    Args:
        files: to be written.
        folders: to be written to.
        suffixes: files, each with those that its name may end in.
    """
    for check, paths in ((check_file, files), (check_folder, folders)):
        for path in paths:
            if path is not None and path != STDOUT:
                check(path)
    for path, known in suffixes:
        if path is not None:
            check_suffix(path, *known)


def write_json(result: Result, path: Path | None) -> bool:
    """Write a result as JSON, where a path is given; return whether that is standard output, for nothing else then."""
    if path == STDOUT:
        sys.stdout.write(json_text(result.to_dict()))
    elif path is not None:
        result.save(path)
    return path == STDOUT


def write(written: list[Path], *wanted: tuple[Path | None, Callable[[Path], object]]) -> None:
    """Let each file that is wanted be written, and add it to `written` once it is there."""
    for path, writer in wanted:
        if path is not None:
            writer(path)
            written.append(path)


def complain(what: str, message: str) -> None:
    """Print what is wrong to stderr, its kind in red."""
    err.print(Text.assemble((f"{what}:", "bold red"), " ", message), soft_wrap=True)


def table(title: str, headings: Iterable[str], left: Collection[str] = ()) -> Table:
    """Return a table whose columns are flush right but for those named in `left`."""
    shown = Table(
        title=f"\n{title}" if title else None, title_justify="left", caption_justify="left",
        box=box.SIMPLE, collapse_padding=True, pad_edge=False, show_edge=False,
    )  # fmt: skip
    for heading in headings:
        justify: Literal["left", "right"] = "left" if heading in left else "right"
        shown.add_column(heading, justify=justify, no_wrap=heading not in left, overflow="fold")
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
def progress_bar(first: str = "starting", *, quiet: bool = False) -> Iterator[Callable[[str, float], None]]:
    """Show a progress bar on stderr while the block runs, where that is no terminal a line at times.

    While numba compiles, the stage says so.

    Args:
        first: stage till another one is told.
        quiet: show nothing.
    """
    if quiet:
        yield lambda _what, _done: None
        return
    with Progress(
        SpinnerColumn(),
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        TaskProgressColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
        console=err,
        transient=True,
        disable=not err.is_terminal,
        speed_estimate_period=_MINUTES,
    ) as bar:
        stage = _Stage(first, bar)
        with _watching(stage):
            yield stage.tell


class _Stage:
    """What is being done, and whether it waits for the compiler; functions may be compiled in other threads.

    Where the bar is not shown, a line is printed: at once, when something is compiled, and every `_EVERY` seconds.
    """

    def __init__(self, what: str, bar: Progress) -> None:
        self._bar, self._what, self._done, self._compiling = bar, what, 0.0, 0
        bar.add_task(what, total=1.0)
        self._task, self._due, self._compiled = bar.tasks[-1], -math.inf, False
        self._shown()

    def tell(self, what: str, done: float) -> None:
        """Show what is being done and the share that is done."""
        if what != self._what or done >= min(self._done + _SHOWN, 1.0):
            self._what, self._done = what, done
            self._shown()

    def compile(self, more: int) -> None:
        """Count functions that are being compiled."""
        self._compiling += more
        self._shown()

    def _shown(self) -> None:
        what = f"{self._what}: compiling, once" if self._compiling else self._what
        self._bar.update(self._task.id, description=what, completed=self._done)
        first = self._compiling > 0 and not self._compiled
        if self._bar.disable and (first or time.monotonic() >= self._due):
            rest = self._task.time_remaining
            left = "" if rest is None else f", about {rest:.0f} s left"
            err.print(f"{what} ({self._done:.0%}{left})", soft_wrap=True)
            self._due, self._compiled = time.monotonic() + _EVERY, self._compiled or first


@contextmanager
def _watching(stage: _Stage) -> Iterator[None]:
    """Tell the stage when numba begins to compile a function that is not on disk, and when it is done."""
    from numba.core import event

    class Listener(event.Listener):  # type: ignore[misc]  # numba has no types
        def on_start(self, event: object) -> None:
            stage.compile(1)

        def on_end(self, event: object) -> None:
            stage.compile(-1)

    with event.install_listener("numba:compile", Listener()):
        yield


def numbers(text: str, count: int, what: str) -> list[float]:
    """Parse comma-separated numbers, or raise `InputError` that says how many were expected."""
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError:
        values = []
    if len(values) != count or not all(map(math.isfinite, values)):
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
        name, equals, value = (part.strip() for part in text.partition("="))
        if not equals or not name:
            raise InputError(f"{what}: found '{text}', expected NAME=VALUE, e.g. c_d.head=2.0")
        if name in result:
            raise InputError(f"{what}: '{name}' is set twice; set it once")
        result[name] = numbers(value, 1, f"{what} {name}")[0]
    return result


def effect_settings(texts: Sequence[str], known: dict[str, Effect]) -> dict[str, float]:
    """Parse ``NAME:PARAM=VALUE[,PARAM=VALUE]`` settings into values by full name.

    Raises:
        InputError: a text that is none, or a parameter that is set twice.
        UnknownNameError: no such effect, or no such parameter of it.
    """
    from mjfish.effects import find

    result: dict[str, float] = {}
    for text in texts:
        name, colon, settings = text.partition(":")
        if not colon or not settings:
            raise InputError(f"--effect: found '{text}', expected NAME:PARAM=VALUE, e.g. servo_lag:time_constant=0.02")
        for short, value in assignments(settings.split(","), f"--effect {name}").items():
            full = find(name, known).declaration(short).name
            if full in result:
                raise InputError(f"--effect: '{full}' is set twice; set it once")
            result[full] = value
    return result
