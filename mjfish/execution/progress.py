"""Progress of long work, told to whoever wants to show it.

How many refits and simulations a diagnosis needs, nobody knows before. So its stages have shares of the work. In a
stage a refit takes as much as if a few were to follow those that are known, and a simulation a small share of what is
left of a refit. What is done never falls, and grows with every simulation.
"""

from __future__ import annotations

import threading
from collections.abc import Callable

#: Called with what is being done and the share of it that is done, 0 to 1.
Progress = Callable[[str, float], None]

#: Share of what is left of a refit that a simulation takes; share of a stage that is always left of one, however long
#: it is; share of a stage before its first refit; and how many refits are taken to follow.
_SIMULATION, _LONG, _BEFORE, _FOLLOW = 0.01, 0.02, 0.5, 30


def silent(_what: str, _done: float) -> None:
    """Tell nobody."""


def part(progress: Progress, begin: float, share: float) -> Progress:
    """Return the progress of a part of the work, which begins at `begin` and is `share` of it."""
    return lambda what, done: progress(what, begin + share * done)


class Meter:
    """The share of the work that is done, in all threads.

    Args:
        tell: called as it grows.
    """

    def __init__(self, tell: Progress = silent) -> None:
        self._tell, self._lock = tell, threading.Lock()
        self._what, self._done, self._next, self._end = "", 0.0, 0.0, 0.0

    def stage(self, what: str, end: float) -> None:
        """Begin a stage where that before it ends; it ends at this share of the work, 1 being done."""
        begin, self._what, self._end = self._end if end < 1.0 else end, what, max(end, self._end)
        self._advance(begin if begin < end or end == 1.0 else self._done, begin + _BEFORE * (end - begin))

    def refitted(self, left: int) -> None:
        """Count a refit; so many are left of those that are made side by side."""
        self._advance(self._next, self._next + (self._end - self._next) / (left + _FOLLOW))

    def simulated(self) -> None:
        """Count a simulation."""
        ahead = max(self._next - self._done, _LONG * (self._end - self._done))
        self._advance(self._done + _SIMULATION * ahead, self._next)

    def _advance(self, done: float, following: float) -> None:
        with self._lock:
            self._done, self._next = max(done, self._done), max(following, self._next)
            self._tell(self._what, self._done)
