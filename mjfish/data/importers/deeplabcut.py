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

from mjfish.arrays import FloatArray
from mjfish.data import Dataset
from mjfish.data.importers.mapping import MarkersMap
from mjfish.data.importers.markers import import_markers
from mjfish.data.importers.report import ImportReport
from mjfish.data.tables import first_row, read_columns, read_text
from mjfish.errors import InputError, UnknownNameError

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
    parts = _body_parts(path)
    columns = ["frame", *(f"{part} {coordinate}" for part in parts for coordinate in _COORDINATES)]
    numbers = read_columns(path, columns, header=False, fewest=1, missing=True, skipped=len(_HEADS))
    points = np.empty((len(numbers["frame"]), len(table.markers), 2))
    for m, entry in enumerate(table.markers):
        if entry.name not in parts:
            raise UnknownNameError(f"body part in {path}", entry.name, parts)
        x, y, likelihood = (numbers[f"{entry.name} {coordinate}"] for coordinate in _COORDINATES)
        points[:, m] = np.column_stack([x, y])
        points[~(likelihood >= table.likelihood), m] = np.nan
    return points


def _body_parts(path: Path) -> list[str]:
    """Return the body parts of a file that is laid out as DeepLabCut does."""
    heads = [first_row(line, path) for line in read_text(path).split("\n")[: len(_HEADS)]]
    if [row[:1] for row in heads[1:2]] == [["individuals"]]:
        raise InputError(f"{path}: has tracks of several animals; export those of one")
    if [row[:1] for row in heads] != [[head] for head in _HEADS] or tuple(heads[2][1:4]) != _COORDINATES:
        raise InputError(
            f"{path}: no CSV of DeepLabCut, expected lines that begin with {', '.join(_HEADS)} and columns "
            f"{', '.join(_COORDINATES)}; import it as 'markers' with a mapping file"
        )
    return heads[1][1 :: len(_COORDINATES)]
