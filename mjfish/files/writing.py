"""Files that are written whole or not at all."""

from __future__ import annotations

import contextlib
import json
import os
import re
import shutil
import tempfile
import uuid
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from mjfish.errors import InputError, UnwritableError

#: A list of nothing but numbers, a line each, as `json` writes it: no string has a line break.
_NUMBERS = re.compile(r"\[\n[^\[\]{}\"]+\n *\]")


def write_text(path: Path, text: str) -> None:
    """Write `text` to `path` through a temporary sibling, so that a reader never sees half of it.

    Raises:
        UnwritableError: the folder does not exist, `path` is one itself, or it cannot be written to.
    """
    with whole(path) as partial:
        partial.write_text(text, encoding="utf-8")


@contextlib.contextmanager
def whole(path: Path) -> Iterator[Path]:
    """Yield a file name of the same suffix that becomes `path` when the block is done: it is there whole or not at all.

    For what libraries write by themselves; `write_text` writes text.

    Raises:
        UnwritableError: the folder does not exist, `path` is one itself, or it cannot be written to.
    """
    try:
        with tempfile.TemporaryDirectory(dir=path.parent, prefix=f".{path.name}.", suffix=".partial") as folder:
            partial = Path(folder) / f"whole{path.suffix}"
            yield partial
            partial.replace(path)
    except OSError as error:
        raise UnwritableError(
            f"{path}: cannot be written: {error.strerror or error}; choose a folder that you can write to"
        ) from None


def write_json(path: Path, content: Any) -> None:
    """Write plain data as JSON; a number that is not finite becomes null, for JSON has no name for it.

    Raises:
        InputError: see `write_text`.
    """
    write_text(path, json_text(content))


def json_text(content: Any) -> str:
    """Return plain data as `write_json` writes it: indented, but a list of nothing but numbers takes one line."""
    from mjfish.files.plain_data import plain

    text = json.dumps(plain(content), indent=2, allow_nan=False)
    return _NUMBERS.sub(lambda found: " ".join(found[0].split()).replace("[ ", "[").replace(" ]", "]"), text) + "\n"


def exists(path: Path) -> bool:
    """Return whether there is such a file or folder; a name that the system refuses, such as one too long, has none."""
    try:
        return path.exists()
    except OSError:
        return False


def check_suffix(path: Path, *suffixes: str) -> None:
    """Refuse a file by its name.

    Raises:
        InputError: the name ends in none of the suffixes.
    """
    if path.suffix.lower() not in suffixes:
        raise InputError(
            f"{path}: the name ends in '{path.suffix}', expected {' or '.join(suffixes)}; rename it, or convert it"
        )


def check_file(path: Path) -> None:
    """Refuse a file that cannot be written; for callers with long work before they write.

    Raises:
        InputError: its folder is absent or not writable, or it is a folder itself.
    """
    if path.is_dir():
        raise InputError(f"{path}: is a folder, expected the name of a file; add one")
    if not path.parent.is_dir():
        raise InputError(f"{path}: there is no folder {path.parent}; make it, or choose another")
    _check_writable(path.parent)


def check_folder(path: Path) -> None:
    """Refuse a folder that is not there and cannot be made, or that cannot be written to.

    Raises:
        InputError: see above.
    """
    existing = next(place for place in (path, *path.absolute().parents) if place.exists())
    if not existing.is_dir():
        raise InputError(f"{existing}: is a file, expected a folder; choose another place")
    _check_writable(existing)


def check_new_folder(path: Path) -> None:
    """Refuse a folder that holds something, or that cannot be made or written to.

    Raises:
        InputError: see above.
    """
    check_folder(path)
    if path.exists() and any(path.iterdir()):
        raise InputError(f"{path}: is not empty, expected a new folder; choose another")


@contextlib.contextmanager
def new_folder(path: Path) -> Iterator[Path]:
    """Yield a folder that becomes `path` when the block is done, complete or not at all.

    Args:
        path: absent, or an empty folder.

    Raises:
        InputError: it holds something, or cannot be written.
    """
    path = path.resolve()
    check_new_folder(path)
    partial = path.with_name(f".{path.name}.{uuid.uuid4().hex[:8]}.partial")
    try:
        partial.mkdir(parents=True)
        yield partial
        if path.exists():
            path.rmdir()
        partial.rename(path)
    except OSError as error:
        raise UnwritableError(f"{path}: cannot be written: {error}; choose another place") from None
    finally:
        shutil.rmtree(partial, ignore_errors=True)


def make_folder(path: Path) -> None:
    """Make a folder and those above it, where they are not there.

    Raises:
        InputError: it cannot be made.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{path}: cannot be made: {error.strerror}; choose another folder") from None


def _check_writable(folder: Path) -> None:
    if not os.access(folder, os.W_OK | os.X_OK):
        raise InputError(f"{folder}: cannot be written to; choose a folder that you can write to")
