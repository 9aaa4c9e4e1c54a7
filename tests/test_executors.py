"""Threads, and those of tasks that have tasks of their own."""

from __future__ import annotations

import threading

import pytest

from mjfish.estimation.time_limit import PastLimitError, check_time, limited
from mjfish.executors import mapped


def _ident(_: int) -> int:
    return threading.get_ident()


def test_a_task_that_is_alone_gives_its_own_tasks_to_idle_threads() -> None:
    """And one beside whom another is at work does them itself: no more threads work than there are jobs."""
    started, done = threading.Barrier(2, timeout=20.0), threading.Barrier(2, timeout=20.0)

    def task(_: int) -> bool:
        started.wait()  # both are at work
        alone = set(mapped(_ident, range(3), 2)) == {threading.get_ident()}
        done.wait()
        return alone

    assert list(mapped(task, range(2), 2)) == [True, True]
    meeting = threading.Barrier(2, timeout=20.0)

    def outer(number: int) -> int:
        if number:
            return 0
        threading.Event().wait(0.2)  # the other one has ended
        return len(set(mapped(lambda _: (meeting.wait(), threading.get_ident())[1], range(2), 2)))

    assert list(mapped(outer, range(2), 2)) == [2, 0]


@pytest.mark.parametrize("jobs", [1, 2])
def test_a_limit_holds_in_every_thread(jobs: int) -> None:
    def task(_: int) -> None:
        check_time()

    assert list(mapped(task, range(2), jobs)) == [None, None]
    with limited(-1.0), pytest.raises(PastLimitError):
        list(mapped(task, range(2), jobs))
