"""Reading tables of numbers as laboratories write them: with their own headers or none."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from mjfish.arrays import FloatArray, readonly
from mjfish.errors import InputError, UnknownNameError

_MISSING = ("", "nan")


def read(
    path: Path, names: Sequence[str], *, header: bool, fewest: int, missing: bool = False, about: str = ""
) -> dict[str, FloatArray]:
    """Read columns of a file of comma separated values.

    Args:
        path: the file.
        names: of the columns wanted; without a header, of all columns in their order.
        header: whether the first line names the columns.
        fewest: rows.
        missing: whether cells may be empty or NaN.
        about: what the file should be, for messages.

    Returns:
        Columns (n,) by name.

    Raises:
        InputError: no such file, no text, another number of columns, text or a missing number in a cell, too few rows.
        UnknownNameError: no column of a name.
    """
    lines = _lines(path, about)
    columns = list(names)
    first = 1
    if header:
        columns = [cell.strip() for cell in lines[0][1].split(",")] if lines else []
        lines, first = lines[1:], 2
        for name in names:
            if name not in columns:
                raise UnknownNameError(f"column in {path}", name, columns, "or correct it in the mapping file")
    if len(lines) < fewest:
        raise InputError(
            f"{path}: has {len(lines)} rows, expected one a frame and {fewest} or more; give a longer track"
        )
    del first
    wanted = [columns.index(name) for name in names]
    rows = []
    for number, line in lines:
        cells = line.split(",")
        if len(cells) != len(columns):
            raise InputError(
                f"{path}: row {number}: {len(cells)} columns, expected {len(columns)} ({columns[0]} to {columns[-1]}, "
                f"separated by commas); {about or 'correct the row'}"
            )
        rows.append([_number(path, number, at + 1, columns[at], cells[at], header, missing) for at in wanted])
    table = np.array(rows, dtype=np.float64).reshape(len(rows), len(wanted))
    return {name: readonly(table[:, i]) for i, name in enumerate(names)}


def _lines(path: Path, about: str) -> list[tuple[int, str]]:
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except FileNotFoundError:
        raise InputError(f"{path}: no such file; correct its name") from None
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: cannot be read as text: {error}; {about or 'give a table of numbers'}") from None
    return [(number, line) for number, line in enumerate(lines, start=1) if line.strip()]


def _number(path: Path, row: int, column: int, name: str, cell: str, header: bool, missing: bool) -> float:
    where = f"{path}: row {row}, column {column} ({name})"
    text = cell.strip()
    if missing and text.lower() in _MISSING:
        return float("nan")
    try:
        value = float(text)
    except ValueError:
        hint = "" if header else " (the file is read as one without header)"
        raise InputError(f"{where}: '{text}' is not a number; correct the cell{hint}") from None
    if not np.isfinite(value):
        raise InputError(f"{where}: {value}, expected a finite number; correct the cell or cut the track there")
    return value
