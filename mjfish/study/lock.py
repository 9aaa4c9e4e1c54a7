"""A lock: one run at a time over the same pieces of a folder."""

from __future__ import annotations

import contextlib
import json
import os
import platform
import uuid
from collections.abc import Iterator
from pathlib import Path

from mjfish.errors import InputError
from mjfish.files import write_text
from mjfish.study.pieces import Shard

#: Locks that this process holds: another process may have had its number.
_HELD: set[Path] = set()


@contextlib.contextmanager
def locked(folder: Path, shard: Shard) -> Iterator[None]:
    """Hold the lock of a share of the pieces in `folder` while the block runs.

    Shares that have no piece in common run side by side. The lock of a process of this host that has ended is taken
    over.

    Raises:
        InputError: another run is at these pieces, or the folder cannot be written.
    """
    folder = folder.resolve()
    path = folder / f"run-{shard.index}-of-{shard.count}.lock"
    holder = {"pid": os.getpid(), "host": platform.node(), "shard": [shard.index, shard.count]}
    with _written(folder, json.dumps(holder) + "\n") as text:
        while not _linked(text, path):
            _bury(path)
    _HELD.add(path)
    try:
        for other in folder.glob("run-*.lock"):
            if other != path and shard.overlaps(_shard_of(other)):
                _bury(other)
        yield
    finally:
        _HELD.discard(path)
        path.unlink(missing_ok=True)


@contextlib.contextmanager
def _written(folder: Path, text: str) -> Iterator[Path]:
    path = folder / f".{uuid.uuid4().hex[:8]}.partial"
    write_text(path, text)
    try:
        yield path
    finally:
        path.unlink(missing_ok=True)


def _linked(text: Path, path: Path) -> bool:
    """Make the lock, with its text at once; return whether there was none."""
    try:
        path.hardlink_to(text)
    except FileExistsError:
        return False
    except OSError as error:
        raise InputError(f"{path}: cannot be made: {error.strerror}; choose another folder") from None
    return True


def _bury(path: Path) -> None:
    """Remove the lock of a process that has ended, or raise `InputError`."""
    try:
        text = path.read_text(encoding="utf-8")
    except FileNotFoundError:
        return
    try:
        holder = json.loads(text)
        pid, host = int(holder["pid"]), str(holder["host"])
    except (ValueError, LookupError, TypeError):
        raise InputError(f"{path}: is no lock of a run; delete it") from None
    if path in _HELD or host != platform.node() or (pid != os.getpid() and _runs(pid)):
        raise InputError(
            f"{path.parent}: process {pid} on {host} is at work on these pieces; wait for it, or delete "
            f"{path.name} if it has ended"
        )
    grave = path.with_name(f".{uuid.uuid4().hex[:8]}.partial")
    try:
        path.rename(grave)
    except FileNotFoundError:
        return
    if grave.read_text(encoding="utf-8") != text:  # another run was faster, and this is its lock
        _linked(grave, path)
    grave.unlink()


def _runs(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return True


def _shard_of(path: Path) -> Shard:
    """Return the share that a lock is for; all of them where its name does not say."""
    parts = path.stem.split("-")
    with contextlib.suppress(ValueError, IndexError, InputError):
        return Shard(int(parts[1]), int(parts[3]))
    return Shard()
