"""TOML text of plain tables: what the standard library reads but does not write."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from typing import Any

_BARE_KEY = re.compile(r"[A-Za-z0-9_-]+")


def dumps(table: Mapping[str, Any]) -> str:
    """Return `table` as TOML.

    Args:
        table: of strings, booleans, numbers, sequences of these, tables, and sequences of tables; None is left out.
    """
    return "\n".join(_lines(table, ())) + "\n"


def _lines(table: Mapping[str, Any], path: tuple[str, ...]) -> list[str]:
    """Return the plain keys of `table`, then its tables: TOML allows no plain key of a table behind a subtable."""
    lines, tables = [], []
    for key, value in table.items():
        if value is None:
            continue
        if _is_tables(value):
            for entry in value:
                tables += ["", f"[[{_address((*path, key))}]]", *_lines(entry, (*path, key))]
        elif isinstance(value, Mapping) and not (path and _is_flat(value)):
            tables += ["", f"[{_address((*path, key))}]", *_lines(value, (*path, key))]
        else:
            lines.append(f"{_address((key,))} = {_value(value)}")
    return lines + tables


def _is_tables(value: object) -> bool:
    return isinstance(value, Sequence) and bool(value) and all(isinstance(entry, Mapping) for entry in value)


def _is_flat(table: Mapping[str, Any]) -> bool:
    return not any(isinstance(value, Mapping) or _is_tables(value) for value in table.values())


def _address(keys: Sequence[str]) -> str:
    return ".".join(key if _BARE_KEY.fullmatch(key) else _string(key) for key in keys)


def _value(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int):
        return repr(int(value))
    if isinstance(value, float):
        return repr(float(value))  # a number of numpy says its type in its own
    if isinstance(value, str):
        return _string(value)
    if isinstance(value, Mapping):
        entries = [f"{_address((key,))} = {_value(entry)}" for key, entry in value.items() if entry is not None]
        return f"{{ {', '.join(entries)} }}"
    return f"[{', '.join(_value(entry) for entry in value)}]"


def _string(text: str) -> str:
    # A JSON string is a TOML basic string but for the one control character that JSON leaves bare.
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")
