"""Caches whose limit is the memory of what they hold, not their number: a run may last seconds or an hour."""

from __future__ import annotations

import functools
import threading
import weakref
from collections.abc import Callable
from typing import Any, ClassVar, Generic, ParamSpec, Protocol, TypeVar

import cachetools

P = ParamSpec("P")
R = TypeVar("R")


class Large(Protocol):
    """What has a size."""

    @property
    def nbytes(self) -> int:
        """Bytes that it takes."""


L = TypeVar("L", bound=Large)


def sized_cache(size: Callable[[Any], float], limit: float) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Return a decorator that keeps results of a function, the last used ones, up to `limit` bytes.

    The newest is kept whatever its size. Arguments must be hashable; calls may come from several threads.

    Args:
        size: tells the bytes of a result.
        limit: bytes.

    Example:
        >>> import numpy as np
        >>> squares = sized_cache(lambda block: block.nbytes, 1e6)(lambda n: np.arange(float(n)) ** 2)
        >>> squares(3) is squares(3)
        True
    """
    kept: cachetools.LRUCache[Any, Any] = cachetools.LRUCache(limit, getsizeof=lambda made: min(size(made), limit))
    return cachetools.cached(kept, lock=threading.Lock())


def always(value: R) -> Callable[[], R]:
    """Return a function that returns this value, and can be sent to another process."""
    return functools.partial(_same, value)


def _same(value: R) -> R:
    return value


class Budget:
    """Bytes that values which can be made again may take together, of those that are still in use.

    The newest is held whatever its size; those not asked for longest are dropped first. Threads may share one.

    Attributes:
        limit: bytes.
    """

    def __init__(self, limit: float) -> None:
        """Hold values of up to `limit` bytes."""
        self.limit = limit
        self._lock = threading.Lock()
        self._sizes: weakref.WeakKeyDictionary[Recomputable[Any], int] = weakref.WeakKeyDictionary()

    def hold(self, one: Recomputable[Any], size: int) -> None:
        """Note that a value was asked for, and drop others where it is one too many."""
        with self._lock:
            self._sizes.pop(one, None)
            self._sizes[one] = size
            total = sum(self._sizes.values())
            for oldest in [*self._sizes]:
                if total <= self.limit or oldest is one:
                    break
                total -= self._sizes.pop(oldest)
                oldest.value = None


class Recomputable(Generic[L]):
    """A large value that is made again, to the last bit, where it was dropped: all take so many bytes together.

    Example:
        >>> import numpy as np
        >>> squares = Recomputable(lambda: np.arange(4.0) ** 2)
        >>> print(squares())
        [0. 1. 4. 9.]
        >>> squares() is squares()
        True
    """

    budget: ClassVar[Budget] = Budget(0.4e9)

    def __init__(self, make: Callable[[], L], value: L | None = None) -> None:
        """Make a value by `make`, unless it is known already."""
        self.make, self.value = make, value
        if value is not None:
            self.budget.hold(self, value.nbytes)

    def __call__(self) -> L:
        """Return the value."""
        value = self.value
        if value is None:
            value = self.value = self.make()
        self.budget.hold(self, value.nbytes)
        return value
