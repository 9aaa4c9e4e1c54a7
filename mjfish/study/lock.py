"""A lock: one run at a time over the same pieces of a folder. The system takes it from a process that ends."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path

from filelock import BaseFileLock, FileLock, Timeout

from mjfish.errors import InputError
from mjfish.study.pieces import Shard


@contextlib.contextmanager
def locked(folder: Path, shard: Shard) -> Iterator[None]:
    """Hold the lock of a share of the pieces in `folder` while the block runs.

    Shares that have no piece in common run side by side.

    Raises:
        InputError: another run is at these pieces, or the folder cannot be written.
    """
    path = folder.resolve() / f"run-{shard.index}-of-{shard.count}.lock"
    own = _acquired(path)
    try:
        for other in path.parent.glob("run-*.lock"):
            if other != path and shard.overlaps(_shard_of(other)):
                _acquired(other).release()
        yield
    finally:
        path.unlink(missing_ok=True)
        own.release()


def _acquired(path: Path) -> BaseFileLock:
    lock = FileLock(path, timeout=0)
    try:
        lock.acquire()
    except Timeout:
        raise InputError(f"{path.parent}: another run is at work on these pieces; wait for it") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be made: {error.strerror}; choose another folder") from None
    return lock


def _shard_of(path: Path) -> Shard:
    """Return the share that a lock is for; all of them where its name does not say."""
    parts = path.stem.split("-")
    with contextlib.suppress(ValueError, IndexError, InputError):
        return Shard(int(parts[1]), int(parts[3]))
    return Shard()
