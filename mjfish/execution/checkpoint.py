"""Finished parts of a long computation, kept in a folder: the same computation finds them there and goes on."""

from __future__ import annotations

import itertools
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from mjfish.errors import InputError
from mjfish.files import checksummed_json
from mjfish.files.writing import make_folder

#: Of the files.
SCHEMA = 1


class Checkpoint:
    """Parts of a computation that takes the same steps whenever it is given the same input.

    A file holds one part, named by the hash of the input, the number of the step and the name of the part in it. Two
    computations may share a folder: of one input they write the same files, of two inputs different ones.

    Args:
        folder: where the files are; made where it is not there.
        whole: all that the computation depends on, as plain data.

    Raises:
        InputError: the folder cannot be made.
    """

    def __init__(self, folder: Path, whole: Any) -> None:
        make_folder(folder)
        self._folder, self._whole, self._steps = folder, checksummed_json.digest(whole), itertools.count(1)

    def step(self, names: Sequence[str]) -> Iterator[Path]:
        """Yield the files of the parts of the next step."""
        step = next(self._steps)
        return (self._folder / f"{checksummed_json.digest([self._whole, step, name])}.json" for name in names)

    @staticmethod
    def read(path: Path) -> dict[str, Any] | None:
        """Return a part; None where it is not done yet, or its file is damaged, of which is warned."""
        try:
            content = checksummed_json.read(path)
        except InputError as error:
            warnings.warn(f"{str(error).removesuffix('; delete it')}; it is made again", stacklevel=2)
            return None
        return content if content is not None and content.get("schema") == SCHEMA else None

    @staticmethod
    def write(path: Path, content: dict[str, Any]) -> None:
        """Write a part, whole or not at all, or raise `InputError`."""
        checksummed_json.write(path, {"schema": SCHEMA, **content})
