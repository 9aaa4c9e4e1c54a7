"""Rows and numbers of tables: how messages name a row, and which numbers are taken.

Rows are counted from 1, at the first row of numbers; messages have the line of the file beside it.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mjfish.errors import InputError
from mjfish.numerics.arrays import BoolArray, FloatArray

#: Numbers that a table may have; as float64 they fill 256 MiB.
MOST_NUMBERS = 2**25
#: Largest number that is taken for a measured one: float64 holds the squares and products of such.
LARGEST = 1e15


def row_name(path: Path, index: int, first_line: int | None = None) -> str:
    """Return the name of a row for messages.

    Args:
        path: of the table.
        index: of the row, from 0.
        first_line: of the numbers, from 1; left out: 2 in a CSV file, and no lines in others.
    """
    if first_line is None:
        first_line = 2 if path.suffix.lower() == ".csv" else 1
    return f"{path}: row {index + 1}" + (f" (line {index + first_line})" if first_line > 1 else "")


def check_size(numbers: int, path: Path) -> None:
    """Refuse a file with more numbers than memory should hold."""
    if numbers > MOST_NUMBERS:
        raise InputError(f"{path}: has {numbers} numbers, expected {MOST_NUMBERS} at most; cut it into shorter runs")


def check_finite(
    values: FloatArray, path: Path, column: str, first_line: int | None = None, *, missing: bool = False
) -> None:
    """Refuse a column with a NaN, unless they may be `missing`, an infinity or a number that is none of a measurement.

    Args:
        values: (n,).
        path: of the table.
        column: its name, for messages.
        first_line: see `row_name`.
        missing: whether NaN is allowed.

    Raises:
        InputError: there is such a number; the message names the first row.
    """
    wrong = np.flatnonzero(np.abs(values) > LARGEST if missing else ~(np.abs(values) <= LARGEST))
    if wrong.size:
        raise InputError(
            f"{row_name(path, int(wrong[0]), first_line)}, {column}: {values[wrong[0]]}, expected a finite number up "
            f"to {LARGEST:g}; fill in or remove the row ({wrong.size} of {values.size} rows are like this)"
        )


def check_increasing(
    time: FloatArray,
    path: Path,
    first_line: int | None = None,
    column: str = "time [s]",
    *,
    repeated: BoolArray | bool = False,
) -> None:
    """Refuse times that do not increase.

    Args:
        time: (n,) [s].
        path: of the table.
        first_line: see `row_name`.
        column: of the time, for messages.
        repeated: whether a time may repeat the one before, or which may, from the second on (n - 1,).

    Raises:
        InputError: there is such a time; the message names the first row.
    """
    before, after = time[:-1], time[1:]
    wrong = np.flatnonzero(~((after > before) | (after == before) & repeated))
    if wrong.size:
        row = int(wrong[0]) + 1
        how, what = f"is before the {before[row - 1]:.9g} s of", "sort the rows by time"
        if after[row - 1] == before[row - 1]:
            how = "repeats that of"
            what = "the row is repeated: remove one of the two, or give times that tell them apart"
        raise InputError(
            f"{row_name(path, row, first_line)}, column '{column}': {after[row - 1]:.9g} s {how} row {row}, expected "
            f"increasing times; {what}"
        )
