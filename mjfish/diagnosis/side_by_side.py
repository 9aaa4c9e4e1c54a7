"""Refits side by side: a thread a candidate, each with its trials one after the other."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any, TypeVar

from mjfish.threads import threaded

T = TypeVar("T")


def side_by_side(make: Callable[[T], Any], tasks: Sequence[T], jobs: int) -> Iterator[Any]:
    """Yield the refit that `make` makes of each task, in their order; its problem gets all the threads back."""
    for one in threaded(make, tasks, jobs):
        yield with_jobs(one, jobs)


def with_jobs(one: Any, jobs: int) -> Any:
    """Return an evidence or a refit whose problem has so many threads."""
    return replace(one, problem=replace(one.problem, jobs=jobs))
