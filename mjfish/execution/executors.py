"""Executors that take whole fits: processes of this machine, or the workers of a Dask cluster."""

from __future__ import annotations

import contextlib
import logging
import multiprocessing
import os
import signal
import threading
import warnings
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, Executor, Future, ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from multiprocessing.connection import wait
from typing import Any, TypeVar

from mjfish.errors import InputError

T = TypeVar("T")
R = TypeVar("R")

#: The address that stands for a cluster of one's own on this machine.
LOCAL = "local"
#: Within which a scheduler must answer [s].
_PATIENCE = 10
#: Run by the workers of a cluster of one's own: Ctrl-C in a terminal is for all processes, and this one stops them.
_UNDISTURBED = "import signal\nsignal.signal(signal.SIGINT, signal.SIG_IGN)\n"


def fan_out(function: Callable[[T], R], tasks: Sequence[T], executor: Executor) -> Iterator[tuple[int, Future[R]]]:
    """Yield the place of each task and the future of what `function` returns of it, in the order of completion.

    Where the caller stops, tasks that have not begun are dropped.
    """
    places = {_submitted(function, task, executor): place for place, task in enumerate(tasks)}
    try:
        for future in as_completed(places):
            yield places.pop(future), future
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


@contextmanager
def processes(jobs: int) -> Iterator[Executor]:
    """Yield an executor of so many new processes, which end with this one, however it ends."""
    pool = ProcessPoolExecutor(jobs, mp_context=multiprocessing.get_context("spawn"), initializer=_end_with_parent)
    try:
        with _killed_on_error():
            yield pool
    finally:
        pool.shutdown(cancel_futures=True)


def _end_with_parent() -> None:
    """End this process when its parent is gone, and not before: the queue alone would let it wait for ever."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C in a terminal is for all processes; the parent stops this one
    parent = multiprocessing.parent_process()

    def watch() -> None:
        if parent is not None:
            wait([parent.sentinel])
            os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


@contextmanager
def _killed_on_error() -> Iterator[None]:
    """Kill the processes that began in the block where it ends by an error: they may be in the middle of long work."""
    before = multiprocessing.active_children()
    try:
        yield
    except BaseException:
        for child in multiprocessing.active_children():
            if child not in before:
                child.kill()
        raise


@contextmanager
def _silenced() -> Iterator[None]:
    """Keep what Dask logs from the terminal: lost workers and schedulers are told by whoever runs the tasks."""
    names = [name for name in logging.root.manager.loggerDict if name.partition(".")[0] in ("distributed", "tornado")]
    levels = {name: logging.getLogger(name).level for name in names}
    try:
        for name in names:
            logging.getLogger(name).setLevel(logging.CRITICAL)
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", "Sending large graph")  # its advice is for users of Dask
            yield
    finally:
        for name, level in levels.items():
            logging.getLogger(name).setLevel(level)


class NoClusterError(InputError):
    """There is no Dask, or no scheduler that answers."""


@contextmanager
def cluster(address: str, jobs: int) -> Iterator[Executor]:
    """Yield an executor of the workers of a Dask scheduler.

    Where the scheduler goes, futures are cancelled; where the last worker goes, they wait for another.

    Args:
        address: of the scheduler, such as ``tcp://node1:8786``; ``local`` starts one on the loopback interface.
        jobs: workers of a local cluster, a process each.

    Raises:
        NoClusterError: ``distributed`` is not installed, or no scheduler answers.
    """
    try:
        from distributed import Client, LocalCluster
    except ImportError:
        raise NoClusterError(
            "--cluster: Dask is not installed; install it by `pip install 'mjfish[cluster]'`, or use --jobs"
        ) from None
    with _silenced(), contextlib.ExitStack() as stack:
        if address == LOCAL:
            own = LocalCluster(
                host="127.0.0.1", n_workers=jobs, threads_per_worker=1, processes=True,
                dashboard_address="127.0.0.1:0",
                silence_logs=logging.CRITICAL, preload=_UNDISTURBED,
            )  # fmt: skip
            stack.enter_context(own)  # at its end, Dask gives running work a few seconds before it kills
            address = own.scheduler_address
        try:
            client = stack.enter_context(Client(address, timeout=_PATIENCE))
        except (OSError, ValueError) as error:
            reason = str(error).splitlines()[0] if str(error) else type(error).__name__
            raise NoClusterError(
                f"--cluster: no scheduler answers at {address}: {reason}; start one, or use --jobs"
            ) from None
        over = threading.Event()
        stack.callback(over.set)
        threading.Thread(target=_warn_without_workers, args=(client, address, over), daemon=True).start()
        yield client.get_executor(pure=False)


def _warn_without_workers(client: Any, address: str, over: threading.Event) -> None:
    """Say, once, that a scheduler has no workers: tasks wait for one."""
    while not over.wait(_PATIENCE):
        with contextlib.suppress(Exception):  # a scheduler that has gone is told by the tasks
            if not client.nthreads() and not over.is_set():
                warnings.warn(f"--cluster: {address} has no workers; the work waits for one", stacklevel=1)
                return
