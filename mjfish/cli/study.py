"""``mjfish study``: many datasets, settings and seeds, that can be stopped, divided and gone on with."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mjfish.cli import console
from mjfish.errors import InputError

if TYPE_CHECKING:
    from mjfish.study import Shard


def study(
    file: Annotated[Path, typer.Argument(metavar="STUDY.TOML", help="The study.")],
    out: Annotated[Path, typer.Option(help="Folder of the pieces.")],
    shard: Annotated[str, typer.Option(help="I/N: only the I-th of N shares of the pieces.")] = "1/1",
    jobs: Annotated[int, typer.Option(min=1, help="Processes.")] = 1,
    cluster: console.Cluster = None,
    collect: Annotated[bool, typer.Option("--collect", help="Run nothing: write a table and a summary.")] = False,
) -> bool:
    """Run the pieces of a study that are missing in a folder; the same command goes on where it was stopped."""
    from mjfish import study as studies

    cases = studies.read_cases(file)
    if collect:
        collected = studies.collect(cases, out)
        console.say(*collected.summary.splitlines(), f"wrote {console.listed(collected.files)}")
        return not collected.missing
    executing = studies.Executing(jobs, cluster)
    kept = f"the pieces that are done are kept in {out}; the same command goes on"
    with console.stoppable(lambda: kept), _stopped_by_sigterm(), console.progress_bar() as tell:
        ran = studies.run(cases, out, shard=_shard(shard), executing=executing, tell=tell)
    for damaged in ran.damaged:
        console.complain("damaged, made anew", damaged)
    for reason in ran.unanswered:
        console.complain("missing", reason)
    console.say(f"{ran.there} pieces were there, {ran.made} were made, {ran.failed} of all failed, in {out}")
    return not ran.unanswered


@contextmanager
def _stopped_by_sigterm() -> Iterator[None]:
    """Take SIGTERM, which schedulers of jobs send at a time limit, as Ctrl-C: the lock is released."""
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def _shard(text: str) -> Shard:
    from mjfish.study import Shard

    try:
        index, count = map(int, text.split("/"))
    except ValueError:
        raise InputError(f"--shard: found '{text}', expected I/N, e.g. 1/4; correct it") from None
    return Shard(index, count)
