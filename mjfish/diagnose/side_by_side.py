"""Refits side by side: a thread a candidate, each with its trials one after the other."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any, TypeVar

T = TypeVar("T")
R = TypeVar("R")


def side_by_side(make: Callable[[T], R], tasks: Sequence[T], jobs: int) -> Iterator[R]:
    """Yield what `make` makes of each task, in their order; `jobs` threads."""
    if jobs == 1 or len(tasks) < 2:
        yield from map(make, tasks)
        return
    with ThreadPoolExecutor(jobs) as pool:
        yield from pool.map(make, tasks)


def with_jobs(one: Any, jobs: int) -> Any:
    """Return an evidence or a refit whose problem has so many threads."""
    return replace(one, problem=replace(one.problem, jobs=jobs))
