"""Tables of numbers with units in the headers, as CSV or Parquet.

In a CSV the header is line 1, row 1 is line 2, and no line may be left empty.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet

from mjfish.data import columns
from mjfish.data.cells import check_finite, check_size, row_name
from mjfish.data.dialect import Dialect
from mjfish.data.sheet import read_sheet
from mjfish.errors import InputError, located
from mjfish.files import size_limited
from mjfish.files.writing import check_suffix, whole
from mjfish.numerics.arrays import FloatArray, readonly

SUFFIXES = (".csv", ".parquet")


def read_table(path: str | Path, *, missing: Collection[str] = ()) -> dict[str, FloatArray]:
    """Read a CSV or Parquet file whose columns are those of trials and rollouts.

    Args:
        path: with the suffix ``.csv`` or ``.parquet``.
        missing: names of columns whose cells may be empty or NaN; they are NaN then.

    Returns:
        Columns of equal length by name (without unit), in the order of the file; finite but for those, and read-only.

    Raises:
        InputError: the file is absent, empty or damaged, a header is wrong, a cell is empty, no number or not finite.
    """
    path = Path(path)
    check_suffix(path, *SUFFIXES)
    if path.suffix.lower() == ".csv":
        return _read_csv(path, missing)
    try:
        return _read_parquet(path, missing)
    except FileNotFoundError:
        raise InputError(f"{path}: no such file; correct its name or put it there") from None
    except (OSError, UnicodeDecodeError, pa.ArrowException) as error:
        raise InputError(f"{path}: cannot be read: {error}; save it again as a table of numbers") from None


def write_table(path: str | Path, table: Mapping[str, FloatArray]) -> None:
    """Write columns to a CSV or Parquet file, so that reading gives every number back to the last bit.

    The file appears complete or not at all.

    Args:
        path: with the suffix ``.csv`` or ``.parquet``.
        table: columns of equal length by header, e.g. ``surge [m/s]``.

    Raises:
        InputError: columns of unequal length, a wrong suffix, more than is read, or the file cannot be written.
    """
    path = Path(path)
    check_suffix(path, *SUFFIXES)
    shapes = {header: np.shape(values) for header, values in table.items()}
    if len(set(shapes.values())) != 1 or len(next(iter(shapes.values()))) != 1:
        raise InputError(f"{path}: columns of shapes {shapes}, expected one-dimensional columns of one length")
    check_size(sum(map(np.size, table.values())), path)
    arrays = {header: np.asarray(values, dtype=np.float64) for header, values in table.items()}
    with whole(path) as file, located(str(path)):
        if path.suffix.lower() == ".csv":
            _write_csv(file, arrays)
        else:
            pa.parquet.write_table(pa.table(arrays), file, write_page_checksum=True)


def _write_csv(file: Path, table: Mapping[str, FloatArray]) -> None:
    rows = zip(*(values.tolist() for values in table.values()), strict=True)
    # repr is the shortest text that reads back as the same float.
    lines = [",".join(table), *(",".join(map(repr, row)) for row in rows)]
    text = ("\n".join(lines) + "\n").encode("utf-8")
    if len(text) > size_limited.TABLE:
        raise InputError(f"{len(text)} bytes of CSV, expected {size_limited.TABLE} at most; write Parquet")
    file.write_bytes(text)


def _read_csv(path: Path, missing: Collection[str]) -> dict[str, FloatArray]:
    sheet = read_sheet(path, Dialect(skip=0))
    headers = sheet.layout.headers
    names = columns.parse(headers, path)
    if sheet.layout.first_line != 2:
        raise InputError(f"{path}: line 2 has units, expected the first row; remove it, line 1 has them")
    return {name: sheet.numbers(own, missing=name in missing) for name, own in zip(names, headers, strict=True)}


def _read_parquet(path: Path, missing: Collection[str]) -> dict[str, FloatArray]:
    with pa.parquet.ParquetFile(path, page_checksum_verification=True) as file:
        schema = file.schema_arrow
        if not schema.names:
            raise InputError(f"{path}: has no columns; expected '{columns.header('time')}' and what was measured")
        names = columns.parse(schema.names, path)
        for name, kind in zip(names, schema.types, strict=True):
            if not (pa.types.is_floating(kind) or pa.types.is_integer(kind)):
                raise InputError(
                    f"{path}: column '{columns.header(name)}' has type {kind}, expected float64; convert it"
                )
        check_size(file.metadata.num_rows * len(names), path)
        table = file.read(use_threads=False)
    if not table.num_rows:
        raise InputError(f"{path}: has a header and no rows; expected a row for every sample")
    result = {}
    for name, cells in zip(names, table.columns, strict=True):
        label = f"column '{columns.header(name)}'"
        if cells.null_count and name not in missing:
            row = row_name(path, int(np.argmax(cells.is_null().to_numpy())))
            raise InputError(f"{row}, {label}: the cell is empty, expected a number; fill it in or remove the row")
        result[name] = readonly(cells.cast(pa.float64()).to_numpy())
        check_finite(result[name], path, label, missing=name in missing)
    return result


def write_rows(path: str | Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """Write rows to a CSV or Parquet file, complete or not at all; None is an empty cell.

    Args:
        path: with the suffix ``.csv`` or ``.parquet``.
        rows: of the same keys, e.g. those of `mjfish.estimation.intervals.coefficient_rows`.

    Raises:
        InputError: no rows, rows of unlike keys, a wrong suffix, or the file cannot be written.
    """
    path = Path(path)
    check_suffix(path, *SUFFIXES)
    if not rows or any(tuple(row) != tuple(rows[0]) for row in rows):
        raise InputError(f"{path}: {len(rows)} rows, expected one or more with the same columns; correct the rows")
    write = pa.csv.write_csv if path.suffix.lower() == ".csv" else pa.parquet.write_table
    with whole(path) as file:
        write(pa.Table.from_pylist([dict(row) for row in rows]), file)
