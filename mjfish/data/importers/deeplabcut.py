"""Importer of tracks by DeepLabCut, its CSV files of one animal.

Three lines head such a file: ``scorer``, ``bodyparts``, ``coords``. Every body part has the columns x, y [pixels] and
likelihood; the first column numbers the frames. A marker of the mapping has the name of its body part.

[Mathis2018] A. Mathis and others, DeepLabCut: markerless pose estimation of user-defined body parts with deep learning,
Nature Neuroscience 21.
"""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from mjfish.arrays import FloatArray
from mjfish.data import Dataset
from mjfish.data.importers.mapping import MarkersMap
from mjfish.data.importers.markers import import_markers
from mjfish.data.importers.report import ImportReport
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
    rows = _rows(path)
    parts = rows[1][1:]
    for entry in table.markers:
        if entry.name not in parts:
            raise UnknownNameError(f"body part in {path}", entry.name, dict.fromkeys(parts))
    numbers = _numbers(path, rows[3:], len(parts) + 1)
    points = np.empty((len(numbers), len(table.markers), 2))
    for m, entry in enumerate(table.markers):
        first = 1 + parts.index(entry.name)
        points[:, m] = numbers[:, first : first + 2]
        points[~(numbers[:, first + 2] >= table.likelihood), m] = np.nan
    return points


def _rows(path: Path) -> list[list[str]]:
    """Return the rows of a file that is laid out as DeepLabCut does."""
    try:
        text = path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}; correct its name") from None
    except UnicodeDecodeError:
        raise InputError(f"{path}: is no text; export the tracks as CSV") from None
    rows = [row for row in csv.reader(text.splitlines()) if row]
    heads = tuple(row[0] for row in rows[:3])
    if len(heads) > 1 and heads[1] == "individuals":
        raise InputError(f"{path}: has tracks of several animals; export those of one")
    if heads != _HEADS or tuple(rows[2][1:4]) != _COORDINATES:
        raise InputError(
            f"{path}: no CSV of DeepLabCut, expected lines that begin with {', '.join(_HEADS)} and columns "
            f"{', '.join(_COORDINATES)}; import it as 'markers' with a mapping file"
        )
    return rows


def _numbers(path: Path, rows: Sequence[Sequence[str]], width: int) -> FloatArray:
    """Return the cells (n, width) as numbers, NaN where one is empty."""
    found = np.empty((len(rows), width))
    for number, row in enumerate(rows):
        if len(row) != width:
            raise InputError(f"{path}: line {number + 4} has {len(row)} cells, expected {width}; export the file anew")
        for column, cell in enumerate(row):
            try:
                found[number, column] = float(cell) if cell.strip() else np.nan
            except ValueError:
                raise InputError(
                    f"{path}: line {number + 4}, column {column + 1}: found '{cell}', expected a number; correct it"
                ) from None
    return found
