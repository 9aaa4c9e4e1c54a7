"""Pieces of work, each known by the hash of all that goes into it, shares of them, and the folder that keeps them.

The folder has a file a piece, under the hash of its input, and the run times beside them. A lock lets one run at a time
work on the same pieces; the system takes it from a process that ends.
"""

from __future__ import annotations

import contextlib
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import gcd
from pathlib import Path
from typing import Any, TypeVar

from filelock import BaseFileLock, FileLock, Timeout

from mjfish.errors import InputError
from mjfish.files import checksummed_json, size_limited
from mjfish.files.checksummed_json import digest
from mjfish.files.writing import make_folder, write_json


class Piece(ABC):
    """One piece of work. It goes to other processes, so that it can be pickled."""

    @property
    @abstractmethod
    def name(self) -> str:
        """By which messages call it."""

    @property
    @abstractmethod
    def input(self) -> dict[str, Any]:
        """All that the result hangs on, as plain data: contents in place of names and paths."""

    @cached_property
    def key(self) -> str:
        """The hash of the input."""
        return digest(self.input)

    @abstractmethod
    def result(self) -> dict[str, Any]:
        """Return what is found, as plain data; the same for the same input."""


P = TypeVar("P", bound=Piece)


@dataclass(frozen=True)
class Shard:
    """One of `count` shares of the pieces, the `index`-th from 1."""

    index: int = 1
    count: int = 1

    def __post_init__(self) -> None:
        """Refuse a share that there is not."""
        if not 1 <= self.index <= self.count:
            raise InputError(f"shard {self.index}/{self.count}: expected I/N with I from 1 to N; correct it")

    def of(self, pieces: Sequence[P]) -> list[P]:
        """Return the share's pieces: every `count`-th, so that long and short ones are spread."""
        return [*pieces[self.index - 1 :: self.count]]

    def overlaps(self, other: Shard) -> bool:
        """Return whether a piece may be in both."""
        return (self.index - other.index) % gcd(self.count, other.count) == 0


#: Of the file of a piece.
SCHEMA = 1


@dataclass(frozen=True)
class Store:
    """Pieces in a folder.

    Attributes:
        folder: has ``pieces/HASH.json`` and ``seconds/HASH.json``. Times stand apart, so that a piece has the same
            bytes whenever it is made.
    """

    folder: Path

    def make(self) -> None:
        """Make the folders, or raise `InputError`."""
        for kind in ("pieces", "seconds"):
            make_folder(self.folder / kind)

    def write(self, piece: Piece, outcome: dict[str, Any], seconds: float) -> None:
        """Write what came of a piece, whole or not at all, or raise `InputError`."""
        write_json(self._file("seconds", piece.key), {"seconds": round(seconds, 3)})
        checksummed_json.write(self._file("pieces", piece.key), {"schema": SCHEMA, "input": piece.input, **outcome})

    def keys(self) -> list[str]:
        """Return the hashes of all pieces that are there."""
        return sorted(path.stem for path in (self.folder / "pieces").glob("*.json"))

    def read(self, key: str) -> dict[str, Any] | None:
        """Return what came of the piece of a hash; None where that is not known yet.

        Raises:
            InputError: the file is damaged: it cannot be read, or its hash does not fit.
        """
        path = self._file("pieces", key)
        content = checksummed_json.read(path)
        if content is not None and checksummed_json.digest(content.get("input")) != key:
            raise InputError(f"{path}: it is of another piece; delete it")
        return content

    def seconds(self, key: str) -> float | None:
        """Return how long a piece took [s]; None where nothing says it."""
        try:
            seconds = size_limited.read_json(self._file("seconds", key), "delete it")["seconds"]
        except (InputError, LookupError, TypeError):
            return None
        return float(seconds) if isinstance(seconds, (int, float)) else None

    def _file(self, kind: str, key: str) -> Path:
        return self.folder / kind / f"{key}.json"


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
