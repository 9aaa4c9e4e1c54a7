"""The columns of data files: names, units, headers such as ``yaw_rate [rad/s]``; rows, and which numbers are taken.

Rows are counted from 1, at the first row of numbers; messages have the line of the file beside it.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from mjfish.errors import InputError
from mjfish.fish.frames import UNITS as VELOCITY_UNITS
from mjfish.numerics.arrays import BoolArray, FloatArray

POSE = ("x", "y", "yaw")
#: Of a fish that is free in space: roll is positive with the port side up, pitch with the nose down.
ATTITUDE = ("roll", "pitch", "heave")
#: Unit of every column but the joints'.
UNITS = {
    "time": "s", **VELOCITY_UNITS, "x": "m", "y": "m", "yaw": "rad", "roll": "rad", "pitch": "rad", "heave": "m",
    "mode": "-",  # number of a mode of the errors
    "surge_acceleration": "m/s2", "sway_acceleration": "m/s2",
}  # fmt: skip

_LONGEST_SHOWN = 40
_HEADER = re.compile(r"([^\[\]]*?)\s*(?:\[([^\[\]]*)\])?")
#: Columns of joint angles begin so; their numbers follow, from 1 at the head.
JOINT = "joint_"
_JOINT = re.compile(rf"{JOINT}[1-9][0-9]{{0,3}}")
#: What to multiply by where a header shows a unit that is not SI.
_FACTORS = {
    ("deg", "rad"): "pi/180",
    ("deg/s", "rad/s"): "pi/180",
    ("rpm", "rad/s"): "pi/30",
    ("ms", "s"): "0.001",
    ("mm", "m"): "0.001",
    ("cm", "m"): "0.01",
    ("mm/s", "m/s"): "0.001",
    ("cm/s", "m/s"): "0.01",
    ("km/h", "m/s"): "1/3.6",
}


def unit(name: str) -> str | None:
    """Return the unit of the column `name`, None where there is no such column."""
    return "rad" if _JOINT.fullmatch(name) else UNITS.get(name)


def joint(number: int) -> str:
    """Return the column name of joint `number`, counted from 1 at the head."""
    return f"{JOINT}{number}"


def header(name: str) -> str:
    """Return the header of the column `name`, e.g. ``surge [m/s]``."""
    return f"{name} [{unit(name)}]"


def short(text: str) -> str:
    """Return the beginning of what stood in a file, for messages."""
    line = text.replace("\n", " ")
    return line if len(line) <= _LONGEST_SHOWN else f"{line[:_LONGEST_SHOWN]}..."


def parse(headers: Sequence[str], path: Path) -> list[str]:
    """Return the column names of the headers of the file `path`.

    Raises:
        InputError: a header without unit, in a wrong unit, unknown, or given twice.
    """
    numbers: dict[str, int] = {}
    for number, text in enumerate(headers, start=1):
        name = _name(text.strip(), number, path)
        first = numbers.setdefault(name, number)
        if first != number:
            raise InputError(
                f"{path}: columns {first} and {number} are both '{header(name)}', expected one; remove the wrong one"
            )
    return list(numbers)


def _name(text: str, number: int, path: Path) -> str:
    """Return the name in one header."""
    match = _HEADER.fullmatch(text)
    name, found = (match[1], match[2]) if match else (text, None)
    expected = unit(name)
    place = f"{path}: column {number} '{short(text)}'"
    if expected is None:
        raise InputError(f"{place}: unknown column; {_suggestion(name)}")
    if found is None or not found.strip():
        raise InputError(f"{place}: the header has no unit; expected '{header(name)}', with the values in that unit")
    if found.strip() != expected:
        factor = _FACTORS.get((found.strip(), expected))
        how = f" (multiply by {factor})" if factor else ""
        raise InputError(
            f"{place}: unit [{found}], expected [{expected}]; convert the values{how} and name the column "
            f"'{header(name)}'"
        )
    return name


def _suggestion(name: str) -> str:
    if not name:
        return "a table saved with row numbers has such a column; save it without them"
    close = difflib.get_close_matches(name.lower(), [*UNITS, "joint_1"], n=1)
    hint = f"did you mean '{header(close[0])}'? " if close else ""
    known = ", ".join(map(header, (*UNITS, "joint_1")))
    return f"{hint}known: {known}, joint_2 and so on; rename or remove it"


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
    first = first_line or (2 if path.suffix.lower() == ".csv" else 1)
    return f"{path}: row {index + 1}" + (f" (line {index + first})" if first > 1 else "")


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
