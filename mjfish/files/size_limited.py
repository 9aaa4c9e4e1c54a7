"""Files that are read whole, up to a size: what is too large, or no text, is refused before it fills the memory."""

from __future__ import annotations

import json
import math
import os
from pathlib import Path
from typing import Any

from mjfish.errors import InputError

_MIB = 2**20
#: Largest file of tables as text, of settings (TOML), and of results (JSON) [bytes].
TABLE, SETTINGS, RESULT = 128 * _MIB, 2 * _MIB, 64 * _MIB
#: What is looked at before the rest of a file is read; a table has a shorter first line [bytes].
_BEGINNING = _MIB


def read_text(path: Path, most: int, remedy: str, *, rows: bool = False) -> str:
    r"""Return the UTF-8 text of a file, its lines ended by ``\n``.

    Args:
        path: the file.
        most: bytes it may have.
        remedy: for messages of a file that is none of these.
        rows: whether it must have lines, as a table does.

    Raises:
        InputError: the file is larger, holds a byte of zero, or lacks lines.
        OSError: it cannot be read.
        UnicodeDecodeError: it is no UTF-8 text.
    """
    raw = read_bytes(path, most, remedy, rows=rows)
    zero = raw.find(b"\0")
    if zero >= 0:
        raise InputError(
            f"{path}: byte {zero + 1} is zero, as in a damaged or binary file, expected UTF-8 text; {remedy}"
        )
    return raw.decode("utf-8").replace("\r\n", "\n").replace("\r", "\n")


def read_bytes(path: Path, most: int, remedy: str, *, rows: bool = False) -> bytes:
    """Return the bytes of a file; arguments and errors as of `read_text`, but that it need not be text."""
    with path.open("rb") as stream:
        raw = stream.read(_BEGINNING)
        if rows and len(raw) == _BEGINNING and b"\n" not in raw and b"\r" not in raw:
            raise InputError(f"{path}: line 1 has more than {_size(_BEGINNING)}, expected the first row; {remedy}")
        if os.fstat(stream.fileno()).st_size <= most:  # of a pipe it is 0
            raw += stream.read(most + 1 - len(raw))
        if len(raw) > most or os.fstat(stream.fileno()).st_size > most:
            raise InputError(f"{path}: has more than {_size(most)}, the most that is read; {remedy}")
    return raw


def read_json(path: Path, remedy: str) -> Any:
    """Return what the JSON file of a result says.

    Args:
        path: the file.
        remedy: for messages.

    Raises:
        InputError: it cannot be read, is too large, is no JSON, or has a number that is not finite.
    """
    try:
        return json.loads(read_text(path, RESULT, remedy), parse_constant=_finite, parse_float=_finite)
    except InputError:
        raise
    except FileNotFoundError:
        raise InputError(f"{path}: no such file; {remedy}") from None
    except (OSError, ValueError, RecursionError) as error:
        raise InputError(f"{path}: cannot be read as JSON: {error}; {remedy}") from None


def _finite(number: str) -> float:
    if not math.isfinite(value := float(number)):
        raise ValueError(f"{number} is no finite number")
    return value


def _size(count: int) -> str:
    return f"{count // _MIB} MiB"
