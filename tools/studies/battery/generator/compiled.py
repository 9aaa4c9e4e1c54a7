"""Compilation of the generator's own code, cached under a hash of its sources."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any, TypeVar

import numba

F = TypeVar("F", bound=Callable[..., Any])


def _folder() -> str:
    """Return the folder of machine code for exactly these sources: numba itself looks at one file at a time."""
    digest = hashlib.sha256(f"{version('numba')} {version('numpy')}".encode())
    for source in sorted(Path(__file__).parent.glob("*.py")):
        if "compiled" in source.read_text(encoding="utf-8"):
            digest.update(source.read_bytes())
    root = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    return str(Path(root) / "mjfish" / "battery" / digest.hexdigest()[:16])


_FOLDER = _folder()
#: Sums in any order; but what is not a number is noticed.
_LOOSE = {"reassoc", "contract", "arcp", "nsz"}


def compiled(function: F) -> F:
    """Compile for the CPU, without the GIL, sums in any order (the strips are many and alike)."""
    before = numba.config.CACHE_DIR
    numba.config.CACHE_DIR = before or _FOLDER
    try:
        dispatcher: F = numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=_LOOSE)(function)
    finally:
        numba.config.CACHE_DIR = before
    return dispatcher
