"""Threads, and those of tasks that have tasks of their own."""

from __future__ import annotations

import threading
from pathlib import Path

import pytest

from mjfish.execution import Execution, PastLimitError, check_time, executing, execution, limited, mapped
from mjfish.execution.checkpoint import Checkpoint


def _ident(_: int) -> int:
    return threading.get_ident()


def test_a_task_that_is_alone_gives_its_own_tasks_to_idle_threads() -> None:
    """And one beside whom another is at work does them itself: no more threads work than there are jobs."""
    started, done = threading.Barrier(2, timeout=20.0), threading.Barrier(2, timeout=20.0)

    def task(_: int) -> bool:
        started.wait()  # both are at work
        alone = set(mapped(_ident, range(3))) == {threading.get_ident()}
        done.wait()
        return alone

    with executing(2):
        assert list(mapped(task, range(2))) == [True, True]
    meeting = threading.Barrier(2, timeout=20.0)

    def outer(number: int) -> int:
        if number:
            return 0
        threading.Event().wait(0.2)  # the other one has ended
        return len(set(mapped(lambda _: (meeting.wait(), threading.get_ident())[1], range(2))))

    with executing(2):
        assert list(mapped(outer, range(2))) == [2, 0]


@pytest.mark.parametrize("jobs", [1, 2])
def test_a_limit_holds_in_every_thread(jobs: int) -> None:
    def task(_: int) -> None:
        check_time()

    with executing(jobs):
        assert list(mapped(task, range(2))) == [None, None]
        with limited(-1.0), pytest.raises(PastLimitError):
            list(mapped(task, range(2)))


def test_where_a_task_raises_no_thread_works_on_while_the_error_is_kept() -> None:
    """Its traceback keeps the frames; freed in one of these threads, they would make it wait for itself."""
    before, go = threading.active_count(), threading.Event()

    def task(number: int) -> None:
        if number == 0:
            raise ZeroDivisionError("first")
        go.wait(0.2)

    with executing(2), pytest.raises(ZeroDivisionError) as kept:
        list(mapped(task, range(6)))
    assert kept.value.__traceback__ is not None
    assert threading.active_count() == before


def test_a_block_goes_on_as_the_one_around_it_says(tmp_path: Path) -> None:
    """And tasks have its threads and its limit, yet neither executor nor folder: they are one worker of many."""
    kept = Checkpoint(tmp_path, "a")
    with executing(2, checkpoint=kept, limit=9.0), executing(3):
        here = execution()
        assert (here.jobs, here.checkpoint, here.limit) == (3, kept, 9.0)
        for inner in mapped(lambda _: execution(), range(2)):
            assert (inner.jobs, inner.checkpoint, inner.executor, inner.limit) == (3, None, None, 9.0)
    assert execution() == Execution()
