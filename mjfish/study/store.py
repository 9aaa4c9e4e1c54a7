"""The folder of a study: a file a piece, under the hash of its input, and the run times beside them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mjfish.errors import InputError
from mjfish.files import checksummed_json, size_limited
from mjfish.files.writing import make_folder, write_json
from mjfish.study.pieces import Piece

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
