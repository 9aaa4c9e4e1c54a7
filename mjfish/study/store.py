"""The folder of a study: a file a piece, under the hash of its input, and the run times beside them."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mjfish import bounded, hashed
from mjfish.errors import InputError
from mjfish.files import json_text, make_folder, write_json
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

    def path(self, piece: Piece) -> Path:
        """Return the file of a piece."""
        return self.folder / "pieces" / f"{piece.key}.json"

    def write(self, piece: Piece, outcome: dict[str, Any], seconds: float) -> None:
        """Write what came of a piece, whole or not at all, or raise `InputError`."""
        write_json(self.folder / "seconds" / f"{piece.key}.json", {"seconds": round(seconds, 3)})
        hashed.write(self.path(piece), {"schema": SCHEMA, "input": piece.input, **outcome})

    def read(self, piece: Piece) -> dict[str, Any] | None:
        """Return what came of a piece; None where that is not known yet.

        Raises:
            InputError: the file is damaged: it cannot be read, or its hash does not fit.
        """
        path = self.path(piece)
        content = hashed.read(path)
        if content is not None and content.get("input") != json.loads(json_text(piece.input)):
            raise InputError(f"{path}: it is of another piece; delete it")
        return content

    def seconds(self, piece: Piece) -> float | None:
        """Return how long a piece took [s]; None where nothing says it."""
        try:
            seconds = bounded.read_json(self.folder / "seconds" / f"{piece.key}.json", "delete it")["seconds"]
        except (InputError, LookupError, TypeError):
            return None
        return float(seconds) if isinstance(seconds, (int, float)) else None
