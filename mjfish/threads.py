"""Work side by side: compiled rollouts leave Python's lock to others."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

T = TypeVar("T")
R = TypeVar("R")


def threaded(function: Callable[[T], R], tasks: Sequence[T], jobs: int) -> Iterator[R]:
    """Yield what `function` returns of each task, in their order, by so many threads."""
    if jobs <= 1 or len(tasks) < 2:
        yield from map(function, tasks)
        return
    with ThreadPoolExecutor(jobs) as pool:
        yield from pool.map(function, tasks)
