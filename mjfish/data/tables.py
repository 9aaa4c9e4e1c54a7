"""Tables of numbers: text files of any dialect, and CSV or Parquet files of this package, with units in the headers.

In a CSV of this package the header is line 1, row 1 is line 2, and no line may be left empty.
"""

from __future__ import annotations

import contextlib
import csv
import io
import re
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import pyarrow as pa
import pyarrow.compute
import pyarrow.csv
import pyarrow.parquet
from pydantic import Field

from mjfish.data import columns
from mjfish.data.columns import short
from mjfish.errors import InputError, UnknownNameError, located
from mjfish.files import size_limited
from mjfish.files.tomlfile import Table
from mjfish.files.writing import check_suffix, whole
from mjfish.numerics.arrays import FloatArray, readonly

TAB = "\t"
REMEDY = "save it again as a table of numbers"
SEPARATORS = {",": ",", ";": ";", "tab": TAB, "|": "|"}
_NAMES = {";": "semicolons", TAB: "tabs", "|": "bars"}
#: How the parts of a dialect are stated, for messages.
SEPARATOR, DECIMAL, ENCODING, SKIP = (
    f"--{name} (in a mapping file: {name})" for name in ("separator", "decimal", "encoding", "skip")
)
#: Marks at the beginning of a text, and its encoding.
_MARKS = {b"\xef\xbb\xbf": "utf-8-sig", b"\xff\xfe": "utf-16", b"\xfe\xff": "utf-16"}
#: Lines that are looked at.
_LINES = 200
_UNIT = re.compile(r"-|%|#|[µμmcknu]?(?:s|m|V|A|N|g|Hz)|sec(?:onds?)?|rad|deg(?:rees?)?|°|px|pixels?|frames?|counts?")
_PER_TIME = re.compile(r"\s*(?:/\s*(?:s|sec|min)|[ ·*]\s*s(?:\^?-|⁻)\S)(?:\^?2|²)?$")
#: A number, and its decimal mark if it has one; a date.
_NUMBER = re.compile(r"[+\-−]?(?:\d+([.,]?)\d*|([.,])\d+|inf|nan)(?:e[+\-−]?\d+)?", re.IGNORECASE)
_DATE = re.compile(r"\d{4}-\d\d-\d\d[T ]\d\d:")


class Dialect(Table):
    """What is stated of a text file; the rest is recognised.

    Attributes:
        separator: of the columns.
        decimal: mark in numbers.
        encoding: of the text, as Python names it.
        skip: lines above the header, or above the numbers where there is no header.
    """

    separator: Literal[",", ";", "tab", "|"] | None = None
    decimal: Literal[".", ","] | None = None
    encoding: Annotated[str, Field(min_length=1)] | None = None
    skip: Annotated[int, Field(ge=0)] | None = None


@dataclass(frozen=True)
class Layout:
    r"""A table as text, and how it is laid out.

    Attributes:
        text: of the file, its lines ended by ``\n``.
        headers: of the columns, with the units of the line below in brackets where there is one.
        separator: of the columns.
        decimal: mark in numbers.
        first_line: of the numbers, from 1.
        notes: what differs from a UTF-8 file of commas and points with a header in line 1.
    """

    text: str
    headers: tuple[str, ...]
    separator: str
    decimal: str
    first_line: int
    notes: tuple[str, ...]


def recognise(path: Path, dialect: Dialect, names: Sequence[str] | None = None) -> Layout:
    """Return the text of a table and how it is laid out.

    Args:
        path: the file.
        dialect: what is stated.
        names: of all columns, where no line of the file names them.

    Raises:
        InputError: no such file, no text, no table, or two ways to read its numbers; the message names the option.
    """
    text, encoding = _text(path, dialect.encoding)
    skip = dialect.skip or 0
    lines = list(islice(io.StringIO(text), skip, skip + _LINES))
    if not lines:
        raise InputError(f"{path}: has no line {skip + 1}, expected the table below {skip} lines; correct {SKIP}")
    possible = [SEPARATORS[dialect.separator]] if dialect.separator else SEPARATORS.values()
    read = [(own, _rows(lines, own)) for own in possible]
    separator, rows = max(read, key=lambda own: _fit(own[1]))
    if not rows:
        raise InputError(f"{path}: has a cell of more than {csv.field_size_limit()} characters; {REMEDY}")
    headers, first, above, units = names or (), 0, 0, list[str]()
    if names is None:
        at = _header(rows, path) if dialect.skip is None else 0
        headers, first, above = [cell.strip() for cell in rows[at]], at + 1, skip + at
        if not any(headers):
            raise InputError(
                f"{path}: line {skip + first} is empty, expected the headers of the columns; remove the lines above "
                f"them, or give {SKIP}"
            )
        if units := _units(rows[first : first + 1], len(headers)):
            headers = [f"{name} [{unit}]" if unit else name for name, unit in zip(headers, units, strict=True)]
            first += 1
    decimal = dialect.decimal or _decimal(rows[first:], path)
    notes = {
        f"text read as {encoding}": not encoding.startswith("utf-8"),
        f"columns separated by {_NAMES.get(separator)}": separator in _NAMES,
        f"{above} lines above the header left out": above > 0,
        f"units from line {skip + first}": bool(units),
        "decimal commas": decimal == ",",
    }
    return Layout(
        text,
        tuple(headers),
        separator,
        decimal,
        first_line=skip + first + 1,
        notes=tuple(note for note, applies in notes.items() if applies),
    )


def _is_value(cell: str) -> bool:
    """Return whether a cell holds a number, with a point or a comma, or a date such as 2024-05-01T12:00:00.02."""
    return bool(_NUMBER.fullmatch(cell.strip()) or _DATE.match(cell.strip()))


def _text(path: Path, encoding: str | None) -> tuple[str, str]:
    """Return the text of a file without empty lines at its end, and its encoding."""
    try:
        raw = size_limited.read_bytes(
            path, size_limited.TABLE, "save what is wanted as UTF-8 CSV of one run", rows=True
        )
    except OSError as error:
        why = "no such file" if isinstance(error, FileNotFoundError) else f"cannot be read: {error}"
        raise InputError(f"{path}: {why}; correct its name or put it there") from None
    stated = encoding or next((name for mark, name in _MARKS.items() if raw.startswith(mark)), "")
    # Every byte but five is a letter of Windows: what is no UTF-8 was written there, or in Latin-1, which it contains.
    for name in [stated] if stated else ["utf-8", "cp1252"]:
        try:
            text = raw.decode(name)
            break
        except UnicodeDecodeError as error:
            line = raw[: error.start].count(b"\n") + 1
        except (LookupError, UnicodeError):
            raise InputError(
                f"{path}: no encoding '{name}', expected e.g. utf-8 or cp1252; correct {ENCODING}"
            ) from None
    else:
        raise InputError(f"{path}: line {line} is no {name} text; give {ENCODING}, or save the file as UTF-8")
    if "\0" in text:
        raise InputError(
            f"{path}: byte {raw.find(0) + 1} is zero, as in a damaged or binary file, or in UTF-16 without its mark, "
            f"expected text; save it as UTF-8 CSV, or give {ENCODING}, e.g. utf-16-le"
        )
    text = text.replace("\r\n", "\n").replace("\r", "\n").rstrip(" \n")
    if not text:
        raise InputError(f"{path}: the file is empty; expected a header line and a row for every sample")
    return text, name


def _rows(lines: Sequence[str], separator: str) -> list[list[str]]:
    """Return the cells of lines, none where one is too long."""
    try:
        return [next(csv.reader([line], delimiter=separator), []) for line in lines]
    except csv.Error:
        return []


def _fit(rows: Sequence[Sequence[str]]) -> tuple[int, int, int, int]:
    """Return how well a separator fits: rows of values alone, rows of one length, values, and cells of a row."""
    rows = [row for row in rows if len(row) > 1]
    lengths = Counter(map(len, rows))
    values = [sum(map(_is_value, row)) for row in rows]
    alone = sum(value == len(row) for value, row in zip(values, rows, strict=True))
    return alone, max(lengths.values(), default=0), sum(values), max(lengths, default=0)


def _header(rows: Sequence[Sequence[str]], path: Path) -> int:
    """Return which row names the columns: the last one without a value above the first row of values."""
    values = [sum(map(_is_value, row)) for row in rows]
    data = [k for k, row in enumerate(rows) if values[k] > 1 and 2 * values[k] > sum(map(bool, map(str.strip, row)))]
    usual = Counter(len(rows[k]) for k in data).most_common(1)
    first = next((k for k in data if len(rows[k]) == usual[0][0]), 1)
    named = [k for k in range(first) if any(rows[k]) and not values[k]]
    if not data and (len(rows[0]) < 2 or not "".join(rows[0]).isprintable()):
        raise InputError(
            f"{path}: looks like no table of numbers, found '{short(' '.join(rows[0]))}' in line 1; give "
            f"{SEPARATOR}, or write the recording to a CSV file with a header line"
        )
    if not named:
        raise InputError(
            f"{path}: looks like a CSV file of {len(rows[0])} columns without a header line; put a line with their "
            f"names above the numbers, give {SKIP} if it is further down, or import the file as 'markers'"
        )
    *above, header = named
    return header - 1 if header - 1 in above and _units(rows[header : header + 1], len(rows[header - 1])) else header


def _units(rows: Sequence[Sequence[str]], columns: int) -> list[str]:
    """Return the units in a row that has nothing else, such as ``mm`` or ``[deg/s]``, without brackets; else none."""
    units = [cell.strip().strip("[]()").strip() for row in rows for cell in row]
    known = all(_UNIT.fullmatch(_PER_TIME.sub("", unit or "-")) for unit in units)
    return units if known and len(units) == columns and any(units) else []


def _decimal(rows: Sequence[Sequence[str]], path: Path) -> str:
    """Return the decimal mark of numbers; a point where they have none."""
    cells = (cell.strip() for row in rows for cell in row)
    found = ((match[1] or match[2], match[0]) for cell in cells if (match := _NUMBER.fullmatch(cell)))
    marks = {mark: number for mark, number in found if mark}
    if len(marks) > 1:
        raise InputError(
            f"{path}: numbers with a decimal comma, '{marks[',']}', and with a decimal point, '{marks['.']}', expected "
            f"one of them; give {DECIMAL}, and write numbers without separators of thousands"
        )
    return next(iter(marks), ".")


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
        sheet = read_sheet(path, Dialect(skip=0))
        headers, first_line = sheet.layout.headers, sheet.layout.first_line
        names = columns.parse(headers, path)
        if first_line != 2:
            raise InputError(f"{path}: line 2 has units, expected the first row; remove it, line 1 has them")
        return {name: sheet.numbers(own, missing=name in missing) for name, own in zip(names, headers, strict=True)}
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
            rows = zip(*(values.tolist() for values in arrays.values()), strict=True)
            # repr is the shortest text that reads back as the same float.
            lines = [",".join(arrays), *(",".join(map(repr, row)) for row in rows)]
            text = ("\n".join(lines) + "\n").encode("utf-8")
            if len(text) > size_limited.TABLE:
                raise InputError(f"{len(text)} bytes of CSV, expected {size_limited.TABLE} at most; write Parquet")
            file.write_bytes(text)
        else:
            pa.parquet.write_table(pa.table(arrays), file, write_page_checksum=True)


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
