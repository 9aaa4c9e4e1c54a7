"""Work side by side, by one map over an executor: threads, processes, or the workers of a Dask cluster.

Compiled rollouts leave Python's lock to others, so that threads serve within a fit or a diagnosis. Processes and
clusters serve whole fits.
"""

from __future__ import annotations

import multiprocessing
import os
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor, as_completed
from contextlib import contextmanager
from multiprocessing.connection import wait
from typing import TypeVar

from mjfish.errors import InputError

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


def threaded(function: Callable[[T], R], tasks: Sequence[T], jobs: int) -> Iterator[R]:
    """Yield what `function` returns of each task, in their order, by so many threads."""
    if jobs <= 1 or len(tasks) < 2:
        yield from map(function, tasks)
        return
    with ThreadPoolExecutor(jobs) as pool:
        early: dict[int, Future[R]] = {}
        following = 0
        for place, future in fan_out(function, tasks, pool):
            early[place] = future
            while following in early:
                yield early.pop(following).result()
                following += 1


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
