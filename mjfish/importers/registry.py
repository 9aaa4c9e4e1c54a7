"""Importers by name: measured files of some laboratory in, a dataset and a report out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Protocol

from mjfish.errors import InputError, UnknownNameError
from mjfish.importers import fishsim
from mjfish.importers.report import ImportReport
from mjfish.trial import Dataset


class Importer(Protocol):
    """Turns files into a dataset.

    An importer raises `MjfishError` where a file cannot be used; it writes nothing.
    """

    def __call__(self, files: Sequence[Path], held_out: Sequence[str] = ()) -> tuple[Dataset, ImportReport]:
        """Import `files`; trials or files named in `held_out` get the role ``held_out``, all others ``fit``."""
        ...


IMPORTERS: Mapping[str, Importer] = {"fishsim": fishsim.import_files}


def import_files(
    importer: str, files: Sequence[str | Path], held_out: Sequence[str] = ()
) -> tuple[Dataset, ImportReport]:
    """Import measured files.

    Args:
        importer: its name, one of `IMPORTERS`.
        files: paths.
        held_out: names of trials, or of files without their prefix and suffix, that are not to be fitted.

    Raises:
        UnknownNameError: no such importer, or nothing of a name in `held_out`.
        InputError: a file is missing, not what it must be, given twice, or not usable.
    """
    if importer not in IMPORTERS:
        raise UnknownNameError("importer", importer, IMPORTERS)
    paths = [Path(file) for file in files]
    if not paths:
        raise InputError(f"no files to import, expected one or more; name the files of {importer}")
    seen: dict[Path, Path] = {}
    for path in paths:
        first = seen.setdefault(path.resolve(), path)
        if first is not path:
            raise InputError(f"{path}: given twice, expected every file once; remove one")
    return IMPORTERS[importer](paths, held_out)
