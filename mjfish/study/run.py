"""Run the pieces of work that are not there yet."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, Future
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from threadpoolctl import threadpool_limits

from mjfish.errors import InputError
from mjfish.execution import executing
from mjfish.execution.executors import NoClusterError, cluster, fan_out, processes
from mjfish.study.pieces import Piece, Shard, Store, locked

#: What came of a piece, and how long it took [s].
_Answer = tuple[dict[str, Any], float]


@dataclass(frozen=True)
class Executing:
    """Where pieces run.

    Attributes:
        jobs: processes, or workers of a local cluster; 1 without a cluster: this process.
        cluster: address of a Dask scheduler, ``local`` for one of one's own; None: none.
    """

    jobs: int = 1
    cluster: str | None = None

    def executor(self, jobs: int) -> AbstractContextManager[Executor | None]:
        """Return an executor of so many workers; None where this process does the work."""
        if self.cluster is not None:
            return cluster(self.cluster, jobs)
        return processes(jobs) if self.jobs > 1 else nullcontext()


@dataclass(frozen=True)
class Ran:
    """What a run did.

    Attributes:
        there: pieces that were there before.
        made: pieces that were made.
        failed: of all of these, those that failed.
        damaged: files that were damaged, and are made anew, each with what was wrong.
        unanswered: pieces whose worker ended without an answer, or for which there are no workers any more, with the
            reason; they are still missing.
    """

    there: int = 0
    made: int = 0
    failed: int = 0
    damaged: tuple[str, ...] = ()
    unanswered: tuple[str, ...] = ()


def run(
    pieces: Sequence[Piece],
    out: Path,
    *,
    shard: Shard = Shard(),  # noqa: B008 - frozen
    executing: Executing = Executing(),
    tell: Callable[[str, float], None] = lambda _what, _done: None,
) -> Ran:
    """Run the pieces that are missing in a folder; each is written when it is done.

    Args:
        pieces: all of them.
        out: folder; made where it is not there.
        shard: share of the pieces.
        executing: where they run; the files have the same bytes wherever.
        tell: called with what is being done and the share that is done.

    Raises:
        InputError: another run is at these pieces, the folder cannot be written, or there is no cluster.
    """
    store = Store(out)
    store.make()
    with locked(out, shard):
        return _Run(store, executing, tell).run(shard.of(pieces))


class _Run:
    """A run under way."""

    def __init__(self, store: Store, executing: Executing, tell: Callable[[str, float], None]) -> None:
        self._store, self._executing, self._tell = store, executing, tell
        self._there = self._made = self._failed = 0
        self._begun = False

    def run(self, pieces: Sequence[Piece]) -> Ran:
        missing, damaged = self._missing(pieces)
        self._total = len(missing)
        try:
            unanswered = self._finish(missing)
        except NoClusterError as error:
            if not self._begun:
                raise
            unanswered = [f"{self._total - self._made} pieces: {error}"]
        return Ran(self._there, self._made, self._failed, tuple(damaged), tuple(unanswered))

    def _finish(self, rest: Sequence[Piece]) -> list[str]:
        """Run pieces until each has an answer or ends its worker; return those that do, with the reason."""
        unanswered = []
        while rest:
            lost = self._round(rest, self._executing.jobs)
            if len(lost) < len(rest):  # new workers go on
                rest = [piece for piece, _ in lost]
                continue
            # Those that were running when a worker ended. Each runs alone, to find the one that ends workers.
            suspects, rest = lost[: self._executing.jobs], [piece for piece, _ in lost[self._executing.jobs :]]
            for piece, _ in suspects:
                unanswered += [f"{piece.name}: {reason}" for _, reason in self._round([piece], 1)]
        return unanswered

    def _missing(self, pieces: Sequence[Piece]) -> tuple[list[Piece], list[str]]:
        """Return the pieces that are not there, each once, and what is wrong with damaged files."""
        missing, damaged = [], []
        for piece in {piece.key: piece for piece in pieces}.values():
            try:
                content = self._store.read(piece.key)
            except InputError as error:
                content = None
                damaged.append(str(error).removesuffix("; delete it"))
            if content is None:
                missing.append(piece)
            else:
                self._there += 1
                self._failed += content["outcome"] == "failed"
        return missing, damaged

    def _round(self, pieces: Sequence[Piece], jobs: int) -> list[tuple[Piece, str]]:
        """Run pieces and write what comes of them; return those without an answer, with the reason, in their order."""
        lost = {}
        self._tell(f"{self._made} of {self._total} pieces", self._made / self._total)
        with self._executing.executor(jobs) as executor:
            self._begun = True
            for place, future in _answers(pieces, executor):
                try:
                    outcome, seconds = future.result()
                except Exception as error:
                    said = ": ".join([type(error).__name__, *str(error).splitlines()[:1]])
                    lost[place] = f"its worker gave no answer ({said})"
                    continue
                self._store.write(pieces[place], outcome, seconds)
                self._made += 1
                self._failed += outcome["outcome"] == "failed"
                self._tell(f"{self._made} of {self._total} pieces", self._made / self._total)
        return [(pieces[place], lost[place]) for place in sorted(lost)]


def _answers(pieces: Sequence[Piece], executor: Executor | None) -> Iterator[tuple[int, Future[_Answer]]]:
    """Yield the place of each piece and its answer, in the order of completion."""
    if executor is not None:
        yield from fan_out(answer, pieces, executor)
        return
    for place, piece in enumerate(pieces):
        future: Future[_Answer] = Future()
        future.set_result(answer(piece))
        yield place, future


def answer(piece: Piece) -> _Answer:
    """Return what came of a piece, its error where it failed, and how long it took [s]."""
    begun = time.perf_counter()
    try:
        with threadpool_limits(1, "blas"), executing(1):
            outcome = {"outcome": "done", "result": piece.result()}
    except (Exception, SystemExit) as error:
        outcome = {"outcome": "failed", "reason": f"{type(error).__name__}: {error}"}
    return outcome, time.perf_counter() - begun
