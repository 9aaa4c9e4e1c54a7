"""A limit on the time of a fit: the clock is looked at before every simulation, which is counted.

Code that never returns, in an effect of the user's, is not ended by it.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

from mjfish.execution import execution

#: When the time is up, and how many seconds there were.
_end: ContextVar[tuple[float, float]] = ContextVar("end", default=(math.inf, math.inf))


class PastLimitError(Exception):
    """The work took longer than it may."""


@contextmanager
def limited(seconds: float) -> Iterator[None]:
    """Let fits of this thread raise `PastLimitError` that many seconds from now."""
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
