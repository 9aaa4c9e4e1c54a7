"""Importers by name, or in a file of one's own: measured files of some laboratory in, a dataset and a report out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Protocol, cast

from mjfish.data import Dataset
from mjfish.data.importers.bags import import_mcap
from mjfish.data.importers.mapping import MAPS, PosesMap, VelocitiesMap
from mjfish.data.importers.markers import import_deeplabcut, import_fishsim, import_markers
from mjfish.data.importers.recognition import check_once, check_text, describe
from mjfish.data.importers.tables import import_tables
from mjfish.data.importers.trials import ImportReport
from mjfish.errors import InputError, UnknownNameError, located
from mjfish.files.user_code import user_code


class Importer(Protocol):
    """Turns files into a dataset.

    An importer raises `MjfishError` where a file cannot be used; it writes nothing.
    """

    def __call__(
        self, files: Sequence[Path], held_out: Sequence[str] = (), mapping: Path | None = None
    ) -> tuple[Dataset, ImportReport]:
        """Import `files`.

        Args:
            files: paths that exist or not.
            held_out: trials or runs named here get the role ``held_out``, all others ``fit``.
            mapping: a TOML that says what columns, units and axes mean; an importer that needs none ignores it.
        """


IMPORTERS: Mapping[str, Importer] = {
    "deeplabcut": import_deeplabcut,
    "fishsim": import_fishsim,
    "markers": import_markers,
    "mcap": import_mcap,
    "poses": partial(import_tables, model=PosesMap, importer="poses"),
    "velocities": partial(import_tables, model=VelocitiesMap, importer="velocities"),
}
#: What a file with an importer must define.
FUNCTION = "import_files"


def find(importer: str | Path) -> Importer:
    """Return an importer by name, or from a Python file that defines ``import_files`` with the signature of `Importer`.

    Raises:
        UnknownNameError: no such importer.
        InputError: the file is missing, fails, or defines no such function.
    """
    if str(importer) in IMPORTERS:
        return IMPORTERS[str(importer)]
    path = Path(importer)
    if path.suffix != ".py":
        if path.exists():
            raise InputError(f"{path}: is no importer, and {describe(path)}")
        raise UnknownNameError("importer", str(importer), IMPORTERS, "or give a Python file")
    if not path.is_file():
        raise InputError(f"{path}: no such file; give the Python file of an importer, or one of {', '.join(IMPORTERS)}")
    with located(str(path)), user_code(path) as module:
        function = getattr(module, FUNCTION, None)
    if not callable(function):
        raise InputError(
            f"{path}: defines no function '{FUNCTION}', expected {FUNCTION}(files, held_out=(), mapping=None) that "
            "returns a Dataset and an ImportReport; add it"
        )
    return cast("Importer", function)


def import_files(
    importer: str | Path,
    files: Sequence[str | Path],
    held_out: Sequence[str] = (),
    mapping: str | Path | None = None,
) -> tuple[Dataset, ImportReport]:
    """Import measured files.

    Args:
        importer: its name, one of `IMPORTERS`, or a Python file with one.
        files: paths.
        held_out: names of trials, or of files without their prefix and suffix, that are not to be fitted.
        mapping: mapping file, for importers that need one.

    Raises:
        UnknownNameError: no such importer, or nothing of a name in `held_out`.
        InputError: a file is missing, not what it must be, given twice, or not usable.
    """
    function = find(importer)
    paths = [Path(file) for file in files]
    if not paths:
        raise InputError(f"no files to import, expected one or more; name the files of {importer}")
    check_once(paths)
    for path in paths if importer in MAPS else ():
        check_text(path)
    if mapping is None and importer in MAPS and paths[0].exists():
        raise InputError(
            f"importer '{importer}' needs a mapping file, give --map FILE; {paths[0]} {describe(paths[0])}"
        )
    return function(paths, held_out, None if mapping is None else Path(mapping))
