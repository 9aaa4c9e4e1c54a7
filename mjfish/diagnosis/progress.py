"""Progress of long work, told to whoever wants to show it."""

from __future__ import annotations

from collections.abc import Callable

#: Called with what is being done and the share of it that is done, 0 to 1.
Progress = Callable[[str, float], None]


def silent(_what: str, _done: float) -> None:
    """Tell nobody."""


def part(progress: Progress, begin: float, share: float) -> Progress:
    """Return the progress of a part of the work, which begins at `begin` and is `share` of it."""
    return lambda what, done: progress(what, begin + share * done)
