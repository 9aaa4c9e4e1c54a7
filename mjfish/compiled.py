"""Compilation by numba, cached on disk so that a later process starts at once.

numba's own cache looks at the file of a function only: after an edit in another file that the function calls, it
would return stale machine code. Here the cache folder carries a hash of every compiled source and of the
versions below it, so that a stale entry cannot be found.
"""

from __future__ import annotations

import functools
import hashlib
import os
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any, TypeVar

import numba

F = TypeVar("F", bound=Callable[..., Any])

#: Where functions are compiled; sources elsewhere do not end up in machine code.
_COMPILED_FOLDERS = ("drive", "hydro", "ode", "sim", "effects", "diagnose/noise")


@functools.cache
def cache_folder() -> Path:
    """Return the folder of compiled code for exactly these sources and these libraries."""
    digest = hashlib.sha256()
    for library in ("numba", "llvmlite", "numpy", "mujoco"):
        digest.update(f"{library} {version(library)}\n".encode())
    package = Path(__file__).parent
    digest.update(Path(__file__).read_bytes())  # how functions are compiled
    for folder in _COMPILED_FOLDERS:
        for source in sorted((package / folder).rglob("*.py")):
            digest.update(source.read_bytes())
    root = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    return Path(root) / "mjfish" / digest.hexdigest()[:16]


def compiled(function: F) -> F:
    """Compile `function` for the CPU, without the GIL; IEEE division; cached on disk.

    Functions of a user's own file are compiled anew in every process: what they read from other files is not hashed.
    """
    ours = Path(function.__code__.co_filename).is_relative_to(Path(__file__).parent)
    with _CacheDir():
        dispatcher: F = numba.njit(cache=ours, nogil=True, error_model="numpy")(function)
    return dispatcher


def inlined(function: F) -> F:
    """Compile like `compiled`, but as a part of every compiled function that calls it: for the innermost loops."""
    ours = Path(function.__code__.co_filename).is_relative_to(Path(__file__).parent)
    with _CacheDir():
        make = numba.njit(cache=ours, nogil=True, error_model="numpy", inline="always")
        dispatcher: F = make(function)
    return dispatcher


def merged(function: F) -> F:
    """Compile like `compiled`, and let LLVM put it into every function that calls it: typed once, unlike `inlined`."""
    with _CacheDir():
        dispatcher: F = numba.njit(cache=True, nogil=True, error_model="numpy", forceinline=True, _nrt=False)(function)
    return dispatcher


def borrowing(function: F) -> F:
    """Compile like `compiled`, for functions that allocate nothing: their views of arrays are not counted."""
    with _CacheDir():
        dispatcher: F = numba.njit(cache=True, nogil=True, error_model="numpy", _nrt=False)(function)
    return dispatcher


def c_callback(signature: Any, *, cached: bool = True) -> Callable[[Callable[..., Any]], Any]:
    """Compile a function to a C callback of the numba `signature`; cached on disk like `compiled`.

    Args:
        signature: of the callback.
        cached: False for a closure over compiled code, whose key is another one in every process: its entries would
            never be found again and pile up.
    """

    def decorate(function: Callable[..., Any]) -> Any:
        with _CacheDir():
            return numba.cfunc(signature, cache=cached, error_model="numpy")(function)

    return decorate


class _CacheDir:
    """Sets numba's cache folder while a function is decorated: numba reads it then and only then."""

    def __enter__(self) -> None:
        self._before = numba.config.CACHE_DIR
        if not self._before:
            numba.config.CACHE_DIR = str(cache_folder())

    def __exit__(self, *_: object) -> None:
        numba.config.CACHE_DIR = self._before
