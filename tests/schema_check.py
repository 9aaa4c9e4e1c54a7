"""Checks plain data against the JSON Schemas of the package."""

from __future__ import annotations

import functools
import json
from importlib.resources import files
from typing import Any

from jsonschema import Draft202012Validator


def schema(name: str) -> dict[str, Any]:
    """Return a schema of the package, such as ``diagnosis-2``."""
    loaded: dict[str, Any] = json.loads((files("mjfish") / "schemas" / f"{name}.json").read_text(encoding="utf-8"))
    return loaded


@functools.cache
def _validator(name: str) -> Draft202012Validator:
    return Draft202012Validator(schema(name))


def complaints(name: str, found: object) -> list[str]:
    """Return what a schema has against `found`, each with its place; it goes through JSON first."""
    strict = json.loads(json.dumps(found, allow_nan=False))
    return [f"{error.json_path}: {error.message[:300]}" for error in _validator(name).iter_errors(strict)]
