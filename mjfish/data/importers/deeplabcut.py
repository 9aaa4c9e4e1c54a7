"""Importer of tracks by DeepLabCut, its CSV files of one animal.

Three lines head such a file: ``scorer``, ``bodyparts``, ``coords``. Every body part has the columns x, y [pixels] and
likelihood; the first column numbers the frames. A marker of the mapping has the name of its body part.

[Mathis2018] A. Mathis and others, DeepLabCut: markerless pose estimation of user-defined body parts with deep learning,
Nature Neuroscience 21.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from mjfish.data import Dataset
from mjfish.data.dialect import recognise
from mjfish.data.importers.mapping import MarkersMap
from mjfish.data.importers.markers import import_markers
from mjfish.data.importers.report import ImportReport
from mjfish.data.sheet import read_sheet
from mjfish.errors import InputError, UnknownNameError
from mjfish.numerics.arrays import FloatArray

_HEADS = ("scorer", "bodyparts", "coords")
_COORDINATES = ("x", "y", "likelihood")


def import_deeplabcut(
    files: Sequence[Path], held_out: Sequence[str] = (), mapping: Path | None = None
) -> tuple[Dataset, ImportReport]:
    """Import tracks of DeepLabCut, see `import_markers`; a point below the mapping's ``likelihood`` is lost.

    Raises:
        MjfishError: as of `import_markers`; a file is no such CSV, or has several animals.
    """
    return import_markers(files, held_out, mapping, importer="deeplabcut", read=read_tracks)


def read_tracks(path: Path, table: MarkersMap) -> FloatArray:
    """Return the points of the mapping's markers (n, markers, 2) [pixels]; NaN where the tracker was not sure.

    Raises:
        InputError: no such file, no CSV of DeepLabCut, of several animals, or a cell that is no number.
        UnknownNameError: no such body part.
    """
    parts = _body_parts(path, table)
    columns = ["frame", *(f"{part} {coordinate}" for part in parts for coordinate in _COORDINATES)]
    sheet = read_sheet(path, _below(table, len(_HEADS)), names=columns)
    points = np.empty((sheet.cells.num_rows, len(table.markers), 2))
    for m, entry in enumerate(table.markers):
        if entry.name not in parts:
            raise UnknownNameError(f"body part in {path}", entry.name, parts)
        x, y, likelihood = (sheet.numbers(f"{entry.name} {coordinate}", missing=True) for coordinate in _COORDINATES)
        points[:, m] = np.column_stack([x, y])
        points[~(likelihood >= table.likelihood), m] = np.nan
    return points


def _body_parts(path: Path, table: MarkersMap) -> list[str]:
    """Return the body parts of a file that is laid out as DeepLabCut does."""
    heads: list[tuple[str, ...]] = []
    for number, head in enumerate(_HEADS):
        heads.append(recognise(path, _below(table, number)).headers)
        if heads[-1][:1] == ("individuals",):
            raise InputError(f"{path}: has tracks of several animals; export those of one")
        if heads[-1][:1] != (head,) or (heads[2:] and heads[2][1:4] != _COORDINATES):
            raise InputError(
                f"{path}: no CSV of DeepLabCut, expected lines that begin with {', '.join(_HEADS)} and columns "
                f"{', '.join(_COORDINATES)}; import it as 'markers' with a mapping file"
            )
    return list(heads[1][1 :: len(_COORDINATES)])


def _below(table: MarkersMap, lines: int) -> MarkersMap:
    """Return the mapping of what lies below the first lines of a table."""
    return table.model_copy(update={"skip": (table.skip or 0) + lines})
