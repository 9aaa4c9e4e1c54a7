"""How work is done side by side: threads, an executor, a folder of finished refits, and a limit on their time.

All that is done in the block of `executing` goes by it. Compiled rollouts leave Python's lock to others, so that
threads serve within a fit or a diagnosis. An executor serves whole fits, which are sent to it by cloudpickle.
"""

from __future__ import annotations

import contextvars
import math
import os
import threading
import time
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from contextlib import closing, contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, TypeVar

import cloudpickle
from threadpoolctl import threadpool_limits

from mjfish.errors import WorkerError
from mjfish.execution.checkpoint import Checkpoint
from mjfish.execution.executors import fan_out
from mjfish.execution.progress import Meter

T = TypeVar("T")
R = TypeVar("R")

#: Idents of the threads of this process that work on a task, of any call; who waits for tasks of its own counts, too.
_AT_WORK: set[int] = set()
#: Of work that nobody asked to be told of.
_UNHEARD = Meter()


@dataclass(frozen=True)
class Execution:
    """How work is done; no result depends on it.

    Attributes:
        jobs: threads.
        executor: takes whole fits in place of the threads; None: they do those as well.
        checkpoint: where finished refits of a diagnosis are kept; None: nowhere.
        limit: seconds that one try of a candidate may take.
        meter: of the work that is done.
    """

    jobs: int = field(default_factory=lambda: os.cpu_count() or 1)
    executor: Executor | None = None
    checkpoint: Checkpoint | None = None
    limit: float = math.inf
    meter: Meter = _UNHEARD


_CURRENT: ContextVar[Execution] = ContextVar("execution")


def execution() -> Execution:
    """Return how work is done here: as the innermost `executing` says, else by one thread a processor."""
    return _CURRENT.get(None) or Execution()


@contextmanager
def executing(
    jobs: int | None = None,
    executor: Executor | None = None,
    checkpoint: Checkpoint | None = None,
    limit: float | None = None,
    meter: Meter | None = None,
) -> Iterator[None]:
    """Do the work of the block as these attributes of `Execution` say; one that is None stays as it is outside.

    Example:
        >>> from mjfish.execution import executing, execution
        >>> with executing(jobs=2):
        ...     execution().jobs
        2
    """
    given: dict[str, Any] = {
        "jobs": jobs,
        "executor": executor,
        "checkpoint": checkpoint,
        "limit": limit,
        "meter": meter,
    }
    here = replace(execution(), **{name: value for name, value in given.items() if value is not None})
    token = _CURRENT.set(here)
    try:
        yield
    finally:
        _CURRENT.reset(token)


def completed(
    function: Callable[[T], R], tasks: Sequence[T], *, sent: bool = True
) -> Generator[tuple[int, Callable[[], R]]]:
    """Yield the place of each task and how to get what `function` returns of it, in the order of completion.

    Getting it raises `WorkerError` where a worker ended without an answer, and an error of `function` as it is. A task
    gives its own tasks to about those threads that are idle when it asks.

    Args:
        function: its result must not depend on where it runs.
        tasks: one argument each.
        sent: to the executor, if there is one; its workers have one thread.
    """
    here, context = execution(), contextvars.copy_context()
    context.run(_CURRENT.set, replace(here, executor=None, checkpoint=None))
    if sent and here.executor is not None:
        told = cloudpickle.dumps((function, here.limit))
        for place, answer in fan_out(_answer, [(told, cloudpickle.dumps(task)) for task in tasks], here.executor):
            yield place, partial(_opened, answer)
    elif len(tasks) < 2 or (idle := here.jobs - len(_AT_WORK - {threading.get_ident()})) < 2:
        yield from ((place, partial(context.copy().run, function, task)) for place, task in enumerate(tasks))
    else:
        with ThreadPoolExecutor(idle) as pool:
            yield from (
                (place, future.result) for place, future in fan_out(partial(_at_work, context, function), tasks, pool)
            )


def mapped(function: Callable[[T], R], tasks: Sequence[T], *, sent: bool = False) -> Iterator[R]:
    """Yield what `function` returns of each task, in their order; see `completed`."""
    return in_order(completed(function, tasks, sent=sent))


def in_order(pairs: Generator[tuple[int, Callable[[], R]]]) -> Iterator[R]:
    """Yield the results of `completed` by their places; an error is raised in its place, when no thread works on."""
    early: dict[int, Callable[[], R]] = {}
    following = 0
    with closing(pairs):  # an error keeps its frames: threads would end whenever, and wherever, these are freed
        for place, get in pairs:
            early[place] = get
            while following in early:
                yield early.pop(following)()
                following += 1


def _at_work(context: contextvars.Context, function: Callable[[T], R], task: T) -> R:
    """Return what a function returns of a task in the context of who asked, whose time limit holds here, too."""
    _AT_WORK.add(threading.get_ident())
    try:
        return context.copy().run(function, task)
    finally:
        _AT_WORK.discard(threading.get_ident())


def _opened(future: Future[bytes]) -> Any:
    """Return what a worker returned, or raise what it raised."""
    try:
        answer = future.result()
    except Exception as error:
        raise WorkerError(
            f"a worker ended without an answer ({type(error).__name__}): it was killed, lacks memory, or cannot be "
            "reached; run the same command again, with fewer workers if it lacks memory"
        ) from error
    found, raised = cloudpickle.loads(answer)
    if raised is not None:
        raise raised
    return found


def _answer(sent: tuple[bytes, bytes]) -> bytes:
    """Return what a function returns of a task, or what it raised; both are sent as bytes."""
    (function, limit), task = map(cloudpickle.loads, sent)
    with threadpool_limits(1, "blas"), executing(1, limit=limit):
        try:
            return bytes(cloudpickle.dumps((function(task), None)))
        except Exception as error:
            return bytes(cloudpickle.dumps((None, error)))


#: When the time is up, and how many seconds there were.
_end: ContextVar[tuple[float, float]] = ContextVar("end", default=(math.inf, math.inf))


class PastLimitError(Exception):
    """The work took longer than it may."""


@contextmanager
def limited(seconds: float) -> Iterator[None]:
    """Let work of this thread raise `PastLimitError` that many seconds from now.

    The clock is looked at before every simulation: code that never returns, in an effect of the user's, is not ended.
    """
    token = _end.set(min(_end.get(), (time.monotonic() + seconds, seconds)))
    try:
        yield
    finally:
        _end.reset(token)


def check_time() -> None:
    """Count a simulation, or raise `PastLimitError` where the time is up."""
    execution().meter.simulated()
    end, seconds = _end.get()
    if time.monotonic() > end:
        raise PastLimitError(f"it took longer than the limit of {seconds:g} s")
