"""Plain data from results, and back: the one way from a dataclass to JSON."""

from __future__ import annotations

import math
from collections.abc import Mapping, Set
from dataclasses import field, fields, is_dataclass
from itertools import repeat
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, get_args, get_origin, get_type_hints

import numpy as np


def unsaved(**options: Any) -> Any:
    """Return a dataclass field that `plain` leaves out: models, datasets, what is only there to compute with."""
    return field(metadata={"saved": False}, **options)


def plain(value: Any) -> Any:
    """Return `value` as dicts, lists, strings, numbers, booleans and None, ready for JSON.

    Dataclasses become dicts of their fields, but for those declared by `unsaved`; a dataclass with a method ``to_dict``
    decides itself. Arrays become nested lists, sets sorted lists, paths strings. A number that is not finite becomes
    None: JSON has no name for it.

    Raises:
        TypeError: there is no plain form of it.
    """
    if value is None or isinstance(value, (str, bool, int)):
        return value
    if isinstance(value, (float, np.floating)):
        return float(value) if math.isfinite(value) else None
    if isinstance(value, (np.ndarray, np.generic)):
        return plain(value.tolist())
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, Set):
        return plain(sorted(value))
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    if isinstance(value, Path):
        return str(value)
    if is_dataclass(value) and not isinstance(value, type):
        return plain(value.to_dict()) if hasattr(value, "to_dict") else fields_of(value)
    raise TypeError(f"{type(value).__name__} has no plain form")


def fields_of(value: Any) -> dict[str, Any]:
    """Return the fields of a dataclass as plain data, but for those declared by `unsaved`."""
    return {name: plain(getattr(value, name)) for name in _saved(value)}


def restored(kind: Any, value: Any) -> Any:
    """Return what `plain` made plain data of.

    Args:
        kind: its type. Of dataclasses with a method ``to_dict`` the plain data must have every field under its name.
        value: the plain data. A number that is None is NaN, whatever was not finite.

    Raises:
        LookupError, TypeError, ValueError: it is of no such type.
    """
    origin, inner = get_origin(kind), get_args(kind)
    if origin is UnionType:
        return None if value is None else restored(next(one for one in inner if one is not NoneType), value)
    if is_dataclass(kind) and isinstance(kind, type):
        hints = get_type_hints(kind)
        return kind(**{name: restored(hints[name], value[name]) for name in _saved(kind)})
    if origin is tuple:
        return tuple(map(restored, repeat(inner[0]) if inner[1:] == (...,) else inner, value))
    if origin in (dict, Mapping):
        return {key: restored(inner[1], item) for key, item in value.items()}
    if origin is np.ndarray:
        return np.array(value, dtype=get_args(inner[1])[0])
    return math.nan if kind is float and value is None else value


def _saved(value: Any) -> list[str]:
    return [entry.name for entry in fields(value) if entry.metadata.get("saved", True)]
