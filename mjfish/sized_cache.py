"""A cache whose limit is the memory of what it holds, not their number: a run may last seconds or an hour."""

from __future__ import annotations

import functools
import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable
from typing import Any, Generic, ParamSpec, TypeVar

P = ParamSpec("P")
R = TypeVar("R")


class SizedCache(Generic[P, R]):
    """A function whose results are kept, the last used ones, up to a limit in bytes.

    The newest is kept whatever its size. Calls may come from several threads.

    Example:
        >>> import numpy as np
        >>> squares = SizedCache(lambda n: np.arange(float(n)) ** 2, lambda block: block.nbytes, 1e6)
        >>> squares(3) is squares(3)
        True
    """

    def __init__(self, function: Callable[P, R], size: Callable[[Any], int], limit: float) -> None:
        """Keep results of `function`, of which `size` tells the bytes, up to `limit` bytes."""
        functools.update_wrapper(self, function)
        self._function, self._size, self._limit = function, size, limit
        self._lock = threading.Lock()
        self._held: OrderedDict[Hashable, R] = OrderedDict()
        self._bytes = 0

    def __call__(self, *args: P.args, **kwargs: P.kwargs) -> R:
        """Return what is held of these arguments, which must be hashable, or what the function makes of them."""
        key = (args, tuple(kwargs.items()))
        with self._lock:
            if key in self._held:
                self._held.move_to_end(key)
                return self._held[key]
        made = self._function(*args, **kwargs)
        with self._lock:
            if key not in self._held:
                self._held[key] = made
                self._bytes += self._size(made)
            while self._bytes > self._limit and len(self._held) > 1:
                _, oldest = self._held.popitem(last=False)
                self._bytes -= self._size(oldest)
            return made

    def cache_clear(self) -> None:
        """Forget all results."""
        with self._lock:
            self._held.clear()
            self._bytes = 0


def sized_cache(size: Callable[[Any], int], limit: float) -> Callable[[Callable[P, R]], SizedCache[P, R]]:
    """Return a decorator that keeps results of a function up to `limit` bytes; `size` tells those of one."""
    return lambda function: SizedCache(function, size, limit)
