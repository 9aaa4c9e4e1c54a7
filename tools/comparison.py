"""Two ways to do the same work, timed in turns within one run."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

#: Interleaved repeats of a comparison; the medians count.
REPEATS = 7


@dataclass(frozen=True)
class Side:
    """One side of a comparison: `run` is called `times` times in a row and timed.

    Attributes:
        about: what it does.
        run: does it.
        times: calls in a row.
        warm: whether it is first called once untimed; a slow side that compiles nothing need not be.
    """

    about: str
    run: Callable[[], object]
    times: int = 1
    warm: bool = True


@dataclass(frozen=True)
class Comparison:
    """Two sides; the ratio is time of `top` over time of `bottom`.

    Attributes:
        top, bottom: the sides.
        target: bound on the ratio.
        at_least: whether the ratio must be above the target, or below it.
        clock: CPU time by default, which a busy machine disturbs least.
        repeats: how often the two are timed in turns.
        agree: raises SystemExit where what top and bottom returned, last time, is not the same; None: was checked.
    """

    top: Side
    bottom: Side
    target: float
    at_least: bool
    clock: Callable[[], float] = time.process_time
    repeats: int = REPEATS
    agree: Callable[[Any, Any], None] | None = None

    def met(self, ratio: float) -> bool:
        """Return whether the target is met."""
        return ratio >= self.target if self.at_least else ratio <= self.target


def measure(comparison: Comparison, tick: Callable[[], None]) -> tuple[float, float]:
    """Return the median seconds a call of top and bottom, measured in turns."""
    sides = (comparison.top, comparison.bottom)
    seconds: tuple[list[float], list[float]] = ([], [])
    results: list[object] = [side.run() if side.warm else None for side in sides]  # compiles, fills caches
    for _ in range(comparison.repeats):
        for k, (side, taken) in enumerate(zip(sides, seconds, strict=True)):
            start = comparison.clock()
            for _ in range(side.times):
                results[k] = side.run()
            taken.append((comparison.clock() - start) / side.times)
        tick()
    if comparison.agree is not None:
        comparison.agree(*results)
    return statistics.median(seconds[0]), statistics.median(seconds[1])
