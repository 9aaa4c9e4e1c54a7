"""Pieces of work, each known by the hash of all that goes into it, and shares of them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import gcd
from typing import Any, TypeVar

from mjfish.errors import InputError
from mjfish.files.checksummed_json import digest


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
