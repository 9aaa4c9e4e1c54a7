"""Tables of an identification, row by row, and their files: CSV or Parquet."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet

from mjfish.data.tables import SUFFIXES
from mjfish.errors import InputError
from mjfish.estimation.fit import Fit
from mjfish.estimation.intervals import Intervals
from mjfish.files.writing import check_suffix, whole


def coefficient_rows(fit: Fit, intervals: Intervals | None = None) -> list[dict[str, Any]]:
    """Return a row a free parameter: estimate, 95 % interval, standard error, and how it was declared.

    Args:
        fit: the estimates; of it are the columns ``plain_..``, which take the residuals for white noise.
        intervals: that hold for correlated residuals; None: no columns for them.
    """
    interval_of = intervals.to_dict()["parameters"] if intervals is not None else {}
    rows = []
    for p, at_bound in zip(fit.parameters, fit.at_bound, strict=True):
        low, high = fit.interval(p.name)
        plain = {"plain_low": low, "plain_high": high, "plain_standard_error": fit.sigma[p.name]}
        rows.append(
            {
                "parameter": p.name,
                "unit": p.unit,
                "estimate": fit.values[p.name],
                "at_bound": bool(at_bound),
                **plain,
                **interval_of.get(p.name, {}),
                "start": p.start,
                "lower_bound": p.low,
                "upper_bound": p.high,
                "about": p.about,
            }
        )
    return rows


def write_rows(path: str | Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """Write rows to a CSV or Parquet file, complete or not at all; None is an empty cell.

    Args:
        path: with the suffix ``.csv`` or ``.parquet``.
        rows: of the same keys, e.g. those of `mjfish.estimation.table_iv.Row.to_dict`.

    Raises:
        InputError: no rows, rows of unlike keys, a wrong suffix, or the file cannot be written.
    """
    path = Path(path)
    check_suffix(path, *SUFFIXES)
    if not rows or any(tuple(row) != tuple(rows[0]) for row in rows):
        raise InputError(f"{path}: {len(rows)} rows, expected one or more with the same columns; correct the rows")
    table = pa.Table.from_pylist([dict(row) for row in rows])
    write = pa.csv.write_csv if path.suffix.lower() == ".csv" else pa.parquet.write_table
    with whole(path) as file:
        write(table, file)
