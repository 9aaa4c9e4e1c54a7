"""Plain data from results: the one way from a dataclass to JSON."""

from __future__ import annotations

import math
from collections.abc import Mapping, Set
from dataclasses import field, fields, is_dataclass
from pathlib import Path
from typing import Any

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
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    if isinstance(value, Set):
        return [plain(item) for item in sorted(value)]
    if isinstance(value, Path):
        return str(value)
    if is_dataclass(value) and not isinstance(value, type):
        return plain(value.to_dict()) if hasattr(value, "to_dict") else fields_of(value)
    raise TypeError(f"{type(value).__name__} has no plain form")


def fields_of(value: Any) -> dict[str, Any]:
    """Return the fields of a dataclass as plain data, but for those declared by `unsaved`."""
    kept = [entry.name for entry in fields(value) if entry.metadata.get("saved", True)]
    return {name: plain(getattr(value, name)) for name in kept}
