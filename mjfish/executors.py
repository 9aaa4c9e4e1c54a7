"""Work side by side, by one map over an executor: threads, processes, or the workers of a Dask cluster.

Compiled rollouts leave Python's lock to others, so that threads serve within a fit or a diagnosis. Processes and
clusters serve whole fits: what they work on is sent to them by cloudpickle, which knows closures and causes of a user.
"""

from __future__ import annotations

import multiprocessing
import os
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor, as_completed
from contextlib import contextmanager
from functools import partial
from multiprocessing.connection import wait
from typing import Any, TypeVar

import cloudpickle
from threadpoolctl import threadpool_limits

from mjfish.errors import InputError, WorkerError

T = TypeVar("T")
R = TypeVar("R")

#: The address that stands for a cluster of one's own on this machine.
LOCAL = "local"
#: Within which a scheduler must answer [s].
_PATIENCE = 10


def fan_out(function: Callable[[T], R], tasks: Sequence[T], executor: Executor) -> Iterator[tuple[int, Future[R]]]:
    """Yield the place of each task and the future of what `function` returns of it, in the order of completion.

    Where the caller stops, tasks that have not begun are dropped.
    """
    places = {_submitted(function, task, executor): place for place, task in enumerate(tasks)}
    try:
        for future in as_completed(places):
            yield places[future], future
    finally:
        for future in places:
            future.cancel()


def _submitted(function: Callable[[T], R], task: T, executor: Executor) -> Future[R]:
    """Submit a task; a worker that ended before it was asked is an answer as well."""
    try:
        return executor.submit(function, task)
    except BrokenExecutor as error:
        broken: Future[R] = Future()
        broken.set_exception(error)
        return broken


def completed(
    function: Callable[[T], R], tasks: Sequence[T], jobs: int, executor: Executor | None = None
) -> Iterator[tuple[int, Callable[[], R]]]:
    """Yield the place of each task and how to get what `function` returns of it, in the order of completion.

    Args:
        function: its result must not depend on where it runs.
        tasks: one argument each.
        jobs: threads, where there is no executor.
        executor: its workers get function and task by cloudpickle, and work with one thread.

    Getting it raises `WorkerError` where a worker ended without an answer, and an error of `function` as it is.
    """
    if executor is not None:
        sent = cloudpickle.dumps(function)
        for place, answer in fan_out(_answer, [(sent, cloudpickle.dumps(task)) for task in tasks], executor):
            yield place, partial(_opened, answer)
    elif jobs <= 1 or len(tasks) < 2:
        yield from ((place, partial(function, task)) for place, task in enumerate(tasks))
    else:
        with ThreadPoolExecutor(jobs) as pool:
            yield from ((place, future.result) for place, future in fan_out(function, tasks, pool))


def mapped(function: Callable[[T], R], tasks: Sequence[T], jobs: int, executor: Executor | None = None) -> Iterator[R]:
    """Yield what `function` returns of each task, in their order; see `completed`."""
    return in_order(completed(function, tasks, jobs, executor))


def in_order(pairs: Iterable[tuple[int, Callable[[], R]]]) -> Iterator[R]:
    """Yield the results of `completed` by their places; an error is raised in its place."""
    early: dict[int, Callable[[], R]] = {}
    following = 0
    for place, get in pairs:
        early[place] = get
        while following in early:
            yield early.pop(following)()
            following += 1


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
    with threadpool_limits(1, "blas"):
        function, task = map(cloudpickle.loads, sent)
        try:
            return bytes(cloudpickle.dumps((function(task), None)))
        except Exception as error:
            return bytes(cloudpickle.dumps((None, error)))


@contextmanager
def processes(jobs: int) -> Iterator[Executor]:
    """Yield an executor of so many new processes, which end with this one, however it ends."""
    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(jobs, mp_context=context, initializer=_end_with_parent)
    try:
        yield pool
    finally:
        pool.shutdown(cancel_futures=True)


def _end_with_parent() -> None:
    """End this process when its parent is gone: the queue alone would let it wait for ever."""
    parent = multiprocessing.parent_process()

    def watch() -> None:
        if parent is not None:
            wait([parent.sentinel])
            os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


@contextmanager
def cluster(address: str, jobs: int) -> Iterator[Executor]:
    """Yield an executor of the workers of a Dask scheduler.

    Args:
        address: of the scheduler, such as ``tcp://node1:8786``; ``local`` starts one on the loopback interface.
        jobs: workers of a local cluster, a process each.

    Raises:
        InputError: ``distributed`` is not installed, or no scheduler answers.
    """
    try:
        from distributed import Client, LocalCluster
    except ImportError:
        raise InputError(
            "--cluster: Dask is not installed; install it by `pip install 'mjfish[cluster]'`, or use --jobs"
        ) from None
    if address == LOCAL:
        with (
            LocalCluster(
                host="127.0.0.1", n_workers=jobs, threads_per_worker=1, processes=True, dashboard_address=None
            ) as own,
            Client(own) as client,
        ):
            yield client.get_executor(pure=False)
        return
    try:
        client = Client(address, timeout=_PATIENCE)
    except (OSError, ValueError) as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise InputError(f"--cluster: no scheduler answers at {address}: {reason}; start one, or use --jobs") from None
    with client:
        yield client.get_executor(pure=False)
