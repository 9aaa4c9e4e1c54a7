"""Tables of results with words in them, as CSV or Parquet; tables of measurements are `mjfish.data.write_table`'s."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet

from mjfish.data.tables import check_suffix, whole
from mjfish.errors import InputError


def write_rows(path: str | Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """Write rows to a CSV or Parquet file, complete or not at all; None is an empty cell.

    Args:
        path: with the suffix ``.csv`` or ``.parquet``.
        rows: of the same keys, e.g. those of `mjfish.estimation.table_iv.Row.to_dict`.

    Raises:
        InputError: no rows, rows of unlike keys, a wrong suffix, or the file cannot be written.
    """
    path = Path(path)
    check_suffix(path)
    if not rows or any(tuple(row) != tuple(rows[0]) for row in rows):
        raise InputError(f"{path}: {len(rows)} rows, expected one or more with the same columns; correct the rows")
    table = pa.Table.from_pylist([dict(row) for row in rows])
    write = pa.csv.write_csv if path.suffix.lower() == ".csv" else pa.parquet.write_table
    with whole(path) as file:
        write(table, file)
