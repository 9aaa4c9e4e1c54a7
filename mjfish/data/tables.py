"""Tables of numbers with units in the headers, as CSV or Parquet.

Rows are counted from 1 at the first row of data; in a CSV that is line 2, and no line may be left empty.
"""

from __future__ import annotations

import contextlib
import csv
from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet

from mjfish import bounded
from mjfish.arrays import FloatArray, readonly
from mjfish.data import columns
from mjfish.errors import InputError, UnknownNameError, located

SUFFIXES = (".csv", ".parquet")
#: Numbers that a table may have; as float64 they fill 256 MiB.
MOST_NUMBERS = 2**25
#: Largest number that is taken for a measured one: float64 holds the squares and products of such.
LARGEST = 1e15
_REMEDY = "save it again as a table of numbers"


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
    check_suffix(path)
    try:
        table = _read_csv(path, missing) if path.suffix.lower() == ".csv" else _read_parquet(path, missing)
    except FileNotFoundError:
        raise InputError(f"{path}: no such file; correct its name or put it there") from None
    except InputError:
        raise
    except (OSError, UnicodeDecodeError, pa.ArrowException) as error:
        raise InputError(f"{path}: cannot be read: {error}; {_REMEDY}") from None
    if not next(iter(table.values())).size:
        raise InputError(f"{path}: has a header and no rows; expected a row for every sample")
    for name, values in table.items():
        check_finite(name, np.nan_to_num(values, posinf=np.inf, neginf=-np.inf) if name in missing else values, path)
    return table


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
    check_suffix(path)
    shapes = {header: np.shape(values) for header, values in table.items()}
    if len(set(shapes.values())) != 1 or len(next(iter(shapes.values()))) != 1:
        raise InputError(f"{path}: columns of shapes {shapes}, expected one-dimensional columns of one length")
    check_size(sum(map(np.size, table.values())), path)
    write = _write_csv if path.suffix.lower() == ".csv" else _write_parquet
    with atomic_file(path) as file, located(str(path)):
        write(file, table)


@contextlib.contextmanager
def atomic_file(path: Path) -> Iterator[BinaryIO]:
    """Open a file that appears under its name when the block is done, complete or not at all.

    Raises:
        InputError: it cannot be written.
    """
    partial = path.with_name(f".{path.name}.partial")
    try:
        with partial.open("wb") as file:
            yield file
        partial.replace(path)
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error}; choose another place") from None
    finally:
        with contextlib.suppress(OSError):
            partial.unlink()


def check_suffix(path: Path) -> None:
    """Refuse a file that is neither CSV nor Parquet by its name."""
    if path.suffix.lower() not in SUFFIXES:
        raise InputError(f"{path}: the name ends in '{path.suffix}', expected .csv or .parquet; convert the file")


def _write_csv(file: BinaryIO, table: Mapping[str, FloatArray]) -> None:
    rows = zip(*(np.asarray(values, dtype=np.float64).tolist() for values in table.values()), strict=True)
    # repr is the shortest text that reads back as the same float.
    lines = [",".join(table), *(",".join(map(repr, row)) for row in rows)]
    text = ("\n".join(lines) + "\n").encode("utf-8")
    if len(text) > bounded.TABLE:
        raise InputError(f"{len(text)} bytes of CSV, expected {bounded.TABLE} at most; write Parquet")
    file.write(text)


def _write_parquet(file: BinaryIO, table: Mapping[str, FloatArray]) -> None:
    arrays = {header: np.asarray(values, dtype=np.float64) for header, values in table.items()}
    pa.parquet.write_table(pa.table(arrays), file, write_page_checksum=True)


def read_columns(
    path: Path,
    names: Sequence[str],
    *,
    header: bool,
    fewest: int,
    missing: bool = False,
    about: str = "",
    skipped: int = 0,
) -> dict[str, FloatArray]:
    """Read columns of a CSV file of some laboratory, with headers of its own or none.

    Args:
        path: the file.
        names: of the columns wanted; without a header, of all columns in their order.
        header: whether the first line names the columns.
        fewest: rows.
        missing: whether cells may be empty or NaN.
        about: what the file should be, for messages.
        skipped: lines above the data, where `names` gives the columns though there are such lines.

    Returns:
        Columns (n,) by name, finite but for missing cells, and read-only.

    Raises:
        InputError: no such file, no text, another number of columns, text or a missing number in a cell, too few rows.
        UnknownNameError: no column of a name.
    """
    text = read_text(path, about)
    found = [cell.strip() for cell in first_row(text, path)] if header else list(names)
    for name in names:
        if name not in found:
            raise UnknownNameError(f"column in {path}", name, found, "or correct it in the mapping file")
        if found.count(name) > 1:
            raise InputError(
                f"{path}: {found.count(name)} columns '{columns.short(name)}', expected one; rename the others"
            )
    first_line = 2 if header else 1 + skipped
    cells = _cells(text, found, path, first_line, about)
    if cells.num_rows < fewest:
        raise InputError(
            f"{path}: has {cells.num_rows} rows, expected one a frame and {fewest} or more; give a longer track"
        )
    read_as = "" if header or skipped else " (read as a file without header)"
    result = {}
    for name in names:
        column = f"column {found.index(name) + 1} ({name}){read_as}"
        values = _numbers(cells.column(found.index(name)), path, column, missing=missing, first_line=first_line)
        result[name] = values
        wrong = np.flatnonzero(np.abs(values) > LARGEST if missing else ~(np.abs(values) <= LARGEST))
        if wrong.size:
            row = row_name(path, int(wrong[0]), first_line)
            raise InputError(
                f"{row}, {column}: {values[wrong[0]]}, expected a finite number up to {LARGEST:g}; correct it or cut "
                "the track there"
            )
    return result


def read_text(path: Path, about: str = "") -> str:
    """Return the text of a table of some laboratory.

    Raises:
        InputError: no such file, no UTF-8 text, or an empty one; `about` says what the file should be.
    """
    try:
        return _text(path)
    except FileNotFoundError:
        raise InputError(f"{path}: no such file; correct its name") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error}; {about or 'give a table of numbers'}") from None


def _read_csv(path: Path, missing: Collection[str]) -> dict[str, FloatArray]:
    """Parse every cell as text first: only so can a message show what stood in the file."""
    text = _text(path)
    headers = first_row(text, path)
    if not headers:
        raise InputError(f"{path}: line 1 is empty, expected the headers of the columns; remove the lines above them")
    if len(headers) == 1 and (";" in text or "\t" in text):
        raise InputError(f"{path}: line 1 has no commas; separate the columns by commas, with points in the numbers")
    names = columns.parse(headers, path)
    cells = _cells(text, names, path)
    return {
        name: _numbers(cells.column(name), path, f"column '{columns.header(name)}'", missing=name in missing)
        for name in names
    }


def first_row(text: str, path: Path) -> list[str]:
    """Return the cells of the first line of a text."""
    try:
        return next(csv.reader([text.partition("\n")[0]]))
    except csv.Error as error:
        raise InputError(f"{path}: line 1 cannot be read: {error}; {_REMEDY}") from None


def _cells(text: str, names: Sequence[str], path: Path, first_line: int = 2, about: str = "") -> pa.Table:
    """Return the cells as text; the rows begin at a line, from 1."""
    lines = text.count("\n") + 1
    if lines < first_line:
        return pa.table({name: pa.array([], pa.string()) for name in names})
    check_size(lines * len(names), path)
    ragged: list[Any] = []

    def note(row: Any) -> str:
        ragged.append(row)
        return "error"

    try:
        return pa.csv.read_csv(
            pa.BufferReader(text.encode("utf-8")),
            read_options=pa.csv.ReadOptions(use_threads=False, column_names=names, skip_rows=first_line - 1),
            parse_options=pa.csv.ParseOptions(ignore_empty_lines=False, invalid_row_handler=note),
            convert_options=pa.csv.ConvertOptions(column_types=dict.fromkeys(names, pa.string())),
        )
    except pa.ArrowInvalid as error:
        if not ragged:
            raise InputError(f"{path}: cannot be read: {error}; {about or _REMEDY}") from None
        row = ragged[0]
        raise InputError(
            f"{row_name(path, row.number - first_line, first_line)}: {row.actual_columns} cells, expected "
            f"{row.expected_columns} ({names[0]} to {names[-1]}); found '{columns.short(row.text)}'; "
            f"{about or 'complete or remove the row'}"
        ) from None


def _text(path: Path) -> str:
    remedy = "save what is wanted as UTF-8 CSV of one run"
    try:
        text = bounded.read_text(path, bounded.TABLE, remedy, encoding="utf-8-sig", rows=True).rstrip()
    except UnicodeDecodeError as error:
        line = error.object[: error.start].count(b"\n") + 1
        raise InputError(f"{path}: line {line} is no UTF-8 text; save the file as UTF-8 CSV") from None
    if not text:
        raise InputError(f"{path}: the file is empty; expected a header line and a row for every sample")
    return text


def _numbers(cells: Any, path: Path, column: str, *, missing: bool, first_line: int = 2) -> FloatArray:
    """Convert a column of text; look for the cell at fault only where the fast way fails."""
    try:
        return readonly(cells.cast(pa.float64()).to_numpy())
    except pa.ArrowInvalid:
        return readonly(
            [
                np.nan if missing and not text.strip() else _number(text, f"{row_name(path, k, first_line)}, {column}")
                for k, text in enumerate(cells.to_pylist())
            ]
        )


def _number(cell: str, where: str) -> float:
    if not cell.strip():
        raise InputError(f"{where}: the cell is empty, expected a number; fill it in or remove the row")
    try:
        return float(cell) if "_" not in cell else float("no number")
    except ValueError:
        raise InputError(
            f"{where}: '{columns.short(cell)}' is not a number such as -0.25; correct it or remove the row"
        ) from None


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
    result = {}
    for name, cells in zip(names, table.columns, strict=True):
        if cells.null_count and name not in missing:
            row = row_name(path, int(np.argmax(cells.is_null().to_numpy())))
            _number("", f"{row}, column '{columns.header(name)}'")
        result[name] = readonly(cells.cast(pa.float64()).to_numpy())
    return result


def check_size(numbers: int, path: Path) -> None:
    """Refuse a file with more numbers than memory should hold."""
    if numbers > MOST_NUMBERS:
        raise InputError(f"{path}: has {numbers} numbers, expected {MOST_NUMBERS} at most; cut it into shorter runs")


def check_finite(name: str, values: FloatArray, path: Path) -> None:
    """Refuse a column with a NaN, an infinity or a number that is none of a measurement, naming the first row."""
    wrong = np.flatnonzero(~(np.abs(values) <= LARGEST))
    if wrong.size:
        raise InputError(
            f"{row_name(path, int(wrong[0]))}, column '{columns.header(name)}': {values[wrong[0]]}, expected a finite "
            f"number up to {LARGEST:g}; fill in or remove the row ({wrong.size} of {values.size} rows are like this)"
        )


def row_name(path: Path, index: int, first_line: int = 2) -> str:
    """Return the name of the row of data `index` (from 0): they count from 1, at the first line of data."""
    line = f" (line {index + first_line})" if path.suffix.lower() == ".csv" and first_line > 1 else ""
    return f"{path}: row {index + 1}{line}"
