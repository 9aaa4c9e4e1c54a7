"""How a text file holds a table: its encoding, separator, decimal mark, and the lines above the numbers.

What a laboratory does not state is recognised by the first lines. The cells are read by `mjfish.data.tables`.
"""

from __future__ import annotations

import csv
import io
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from mjfish.data.columns import short
from mjfish.errors import InputError
from mjfish.files import size_limited
from mjfish.files.tomlfile import Table

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
    notes = [] if encoding.startswith("utf-8") else [f"text read as {encoding}"]
    notes += [f"columns separated by {_NAMES[separator]}"] if separator in _NAMES else []
    headers, first = names or (), 0
    if names is None:
        at = _header(rows, path) if dialect.skip is None else 0
        headers, first = [cell.strip() for cell in rows[at]], at + 1
        if not any(headers):
            raise InputError(
                f"{path}: line {skip + first} is empty, expected the headers of the columns; remove the lines above "
                f"them, or give {SKIP}"
            )
        notes += [f"{skip + at} lines above the header left out"] if skip + at else []
        if units := _units(rows[first : first + 1], len(headers)):
            headers = [f"{name} [{unit}]" if unit else name for name, unit in zip(headers, units, strict=True)]
            first += 1
            notes.append(f"units from line {skip + first}")
    decimal = dialect.decimal or _decimal(rows[first:], path)
    notes += ["decimal commas"] if decimal == "," else []
    return Layout(text, tuple(headers), separator, decimal, skip + first + 1, tuple(notes))


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
    known = (
        len(units) == columns and any(units) and all(_UNIT.fullmatch(_PER_TIME.sub("", unit or "-")) for unit in units)
    )
    return units if known else []


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
