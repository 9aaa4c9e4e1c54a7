"""Tables of numbers: text files of any dialect, and CSV or Parquet files of this package, with units in the headers.

In a CSV of this package the header is line 1, row 1 is line 2, and no line may be left empty.
"""

from __future__ import annotations

import contextlib
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute
import pyarrow.csv
import pyarrow.parquet

from mjfish.data import columns
from mjfish.data.dialect import DECIMAL, REMEDY, SEPARATOR, SKIP, Dialect, Layout, recognise
from mjfish.errors import InputError, UnknownNameError, located
from mjfish.files import size_limited
from mjfish.files.writing import check_suffix, whole
from mjfish.numerics.arrays import FloatArray, readonly

#: Beginning of the remark on such times.
DATES = "times are dates"
#: Later times are counted from 1970, as computers do, and not from the start of a run or of a computer [s].
_EPOCH = 1e8


@dataclass(frozen=True, eq=False)
class Sheet:
    """The table of a text file.

    Attributes:
        path: of the file.
        layout: how it is laid out.
        cells: as text; only so can a message show what stood in the file.
        numbered: whether no line of the file names the columns, so that messages need their numbers.
    """

    path: Path
    layout: Layout
    cells: pa.Table
    numbered: bool

    def numbers(self, name: str, *, missing: bool = False) -> FloatArray:
        """Return the numbers of a column (n,), by its header, or by its header without the unit in brackets.

        Args:
            name: of the column.
            missing: whether cells may be empty or NaN; they are NaN then.

        Raises:
            UnknownNameError: no such column.
            InputError: several of that name, or a cell that is empty or no finite number.
        """
        index = self._index(name)
        values = self._numbers(index, missing=missing)
        columns.check_finite(values, self.path, self._label(index), self.layout.first_line, missing=missing)
        return values

    def seconds(self, name: str, unit: float) -> tuple[FloatArray, str]:
        """Return the times of a column (n,) [s], and a remark where they were dates: these count from the first row.

        Args:
            name: of the column.
            unit: of numbers in it [s]; dates such as 2024-05-01T12:00:00.02 have none.

        Raises:
            UnknownNameError: no such column.
            InputError: several of that name, or a cell that is empty or no time.
        """
        index = self._index(name)
        cells = pa.compute.utf8_trim_whitespace(self.cells.column(index))
        if ":" in cells[0].as_py():
            time, begin = self._dates(index, cells)
        else:
            raw = self._numbers(index)
            begin = float(unit * raw[0])
            time = unit * (raw - raw[0]) if _EPOCH < begin < columns.LARGEST else unit * raw
        columns.check_finite(time, self.path, self._label(index), self.layout.first_line)
        if begin <= _EPOCH:
            return readonly(time), ""
        return readonly(time), f"{DATES}: they count from the first row, {np.datetime64(round(1e3 * begin), 'ms')} UTC"

    def _dates(self, index: int, cells: Any) -> tuple[FloatArray, float]:
        """Return dates (n,) from the first on, and the first since 1970 [s]."""
        kind = pa.timestamp("ns", "UTC" if set("Z+-") & set(cells[0].as_py()[-6:]) else None)
        cells = pa.compute.replace_substring(cells, ",", ".")
        try:
            since = cells.cast(kind).cast(pa.int64()).to_numpy()
        except pa.ArrowInvalid:
            row = next(row for row, cell in enumerate(cells) if not _is_date(cell, kind))
            raise InputError(
                f"{columns.row_name(self.path, row, self.layout.first_line)}, {self._label(index)}: "
                f"'{cells[row]}' is no date, expected such as 2024-05-01T12:00:00.02, with a time zone where the first "
                "row has one; correct it or remove the row"
            ) from None
        return 1e-9 * (since - since[0]), 1e-9 * float(since[0])

    def _index(self, name: str) -> int:
        headers = self.layout.headers
        found = [index for index, header in enumerate(headers) if header == name]
        found = found or [index for index, header in enumerate(headers) if header.partition(" [")[0] == name]
        if not found:
            remedy = f"or correct it in the mapping file; give {SKIP} if the headers are in another line"
            raise UnknownNameError(f"column in {self.path}", name, headers, remedy)
        if len(found) > 1:
            raise InputError(
                f"{self.path}: {len(found)} columns '{columns.short(name)}', expected one; rename the others"
            )
        return found[0]

    def _label(self, index: int) -> str:
        name, bare = self.layout.headers[index], self.layout.first_line == 1
        numbered = f"column {index + 1} ({name}){' (read as a file without header)' if bare else ''}"
        return numbered if self.numbered else f"column '{name}'"

    def _numbers(self, index: int, *, missing: bool = False) -> FloatArray:
        """Convert a column of text; look for the cell at fault only where the fast way fails."""
        cells = self.cells.column(index)
        plain = pa.compute.replace_substring(cells, "−", "-")
        if self.layout.decimal == ",":
            # A point is no decimal mark then: no number has a #.
            plain = pa.compute.replace_substring(pa.compute.replace_substring(plain, ".", "#"), ",", ".")
        try:
            return readonly(plain.cast(pa.float64()).to_numpy())
        except pa.ArrowInvalid:
            rows = enumerate(zip(cells.to_pylist(), plain.to_pylist(), strict=True))
            return readonly([self._number(index, row, *pair, missing=missing) for row, pair in rows])

    def _number(self, index: int, row: int, cell: str, plain: str, *, missing: bool) -> float:
        if missing and not cell.strip():
            return np.nan
        try:
            return float(plain if "_" not in cell else "")
        except ValueError:
            where = f"{columns.row_name(self.path, row, self.layout.first_line)}, {self._label(index)}"
        found = "the cell is empty, expected a number; fill it in or remove the row"
        if cell.strip():
            example = "-0,25" if self.layout.decimal == "," else "-0.25"
            found = f"'{columns.short(cell)}' is not a number such as {example}; correct it or remove the row"
        raise InputError(f"{where}: {found}{f', or give {DECIMAL}' if {',', '.'} & set(cell) else ''}")


def _is_date(cell: Any, kind: Any) -> bool:
    with contextlib.suppress(pa.ArrowInvalid):
        cell.cast(kind)
        return True
    return False


def read_sheet(path: Path, dialect: Dialect | None = None, *, names: Sequence[str] | None = None) -> Sheet:
    """Read the table of a text file.

    Args:
        path: the file.
        dialect: what is stated of it; the rest is recognised.
        names: of all columns, where no line of the file names them.

    Raises:
        InputError: no such file, no text, no table, no rows, or rows of unequal length.
    """
    layout = recognise(path, dialect or Dialect(), names)
    lines = layout.text.count("\n") + 1
    if lines < layout.first_line:
        raise InputError(f"{path}: has a header and no rows; expected a row for every sample")
    columns.check_size(lines * len(layout.headers), path)
    ragged: list[Any] = []

    def note(row: Any) -> str:
        ragged.append(row)
        return "error"

    keys = [str(index) for index in range(len(layout.headers))]
    try:
        cells = pa.csv.read_csv(
            pa.BufferReader(layout.text.encode("utf-8")),
            read_options=pa.csv.ReadOptions(use_threads=False, column_names=keys, skip_rows=layout.first_line - 1),
            parse_options=pa.csv.ParseOptions(
                delimiter=layout.separator, ignore_empty_lines=False, invalid_row_handler=note
            ),
            convert_options=pa.csv.ConvertOptions(column_types=dict.fromkeys(keys, pa.string())),
        )
    except pa.ArrowInvalid as error:
        if not ragged:
            raise InputError(f"{path}: cannot be read: {error}; {REMEDY}") from None
        row, headers = ragged[0], layout.headers
        more = row.actual_columns > row.expected_columns
        remedy = f", or give {SEPARATOR}; decimal commas need another separator, or quotes" if more else ""
        raise InputError(
            f"{columns.row_name(path, row.number - layout.first_line, layout.first_line)}: {row.actual_columns} cells, "
            f"expected {row.expected_columns} ({headers[0]} to {headers[-1]}); found '{columns.short(row.text)}'; "
            f"complete or remove the row{remedy}"
        ) from None
    return Sheet(path, layout, cells, names is not None)


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
    columns.check_size(sum(map(np.size, table.values())), path)
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
        columns.check_size(file.metadata.num_rows * len(names), path)
        table = file.read(use_threads=False)
    if not table.num_rows:
        raise InputError(f"{path}: has a header and no rows; expected a row for every sample")
    result = {}
    for name, cells in zip(names, table.columns, strict=True):
        label = f"column '{columns.header(name)}'"
        if cells.null_count and name not in missing:
            row = columns.row_name(path, int(np.argmax(cells.is_null().to_numpy())))
            raise InputError(f"{row}, {label}: the cell is empty, expected a number; fill it in or remove the row")
        result[name] = readonly(cells.cast(pa.float64()).to_numpy())
        columns.check_finite(result[name], path, label, missing=name in missing)
    return result
