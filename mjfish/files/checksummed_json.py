"""JSON files that carry their own hash, so that a damaged one is seen."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

from mjfish.errors import InputError
from mjfish.files import size_limited
from mjfish.files.writing import json_text, write_json


def digest(content: Any) -> str:
    """Return the SHA-256 of plain data, as JSON with sorted keys."""
    text = json.dumps(content, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()


def write(path: Path, content: dict[str, Any]) -> None:
    """Write plain data and its hash, whole or not at all, or raise `InputError`; a number not finite becomes null."""
    content = json.loads(json_text(content))
    write_json(path, {**content, "sha256": digest(content)})


def read(path: Path) -> dict[str, Any] | None:
    """Return the content of a file without its hash; None where there is no such file.

    Raises:
        InputError: the file is damaged: it cannot be read, or its hash does not fit.
    """
    if not path.exists():
        return None
    content = size_limited.read_json(path, "delete it")
    own = content.pop("sha256", None) if isinstance(content, dict) else None
    if own is None or own != digest(content):
        raise InputError(f"{path}: its content does not fit its hash; delete it")
    return dict(content)
