"""TOML: files read into validated models, with complaints that name file, key, expectation and remedy; text written."""

from __future__ import annotations

import contextlib
import tomllib
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, TypeVar

import tomlkit
from pydantic import AfterValidator, BaseModel, ConfigDict, ValidationError, model_validator

from mjfish.errors import InputError
from mjfish.files import size_limited


class Table(BaseModel):
    """A TOML table: unknown keys and non-finite numbers are refused, the result is frozen."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, populate_by_name=True)


def required(condition: Callable[[Any], bool], message: str) -> AfterValidator:
    """Return a validator that refuses values without a condition; the message may show the value as ``{0}``."""
    return AfterValidator(_refusing(condition, message))


def consistent(condition: Callable[[Any], bool], message: str) -> Any:
    """Return a validator, for an attribute of a model, that refuses tables as `required` refuses values."""
    return model_validator(mode="after")(_refusing(condition, message))


def _refusing(condition: Callable[[Any], bool], message: str) -> Callable[[Any], Any]:
    def checked(value: Any) -> Any:
        if not condition(value):
            raise ValueError(message.format(value))
        return value

    return checked


T = TypeVar("T", bound=BaseModel)

_REMEDIES = {
    "extra_forbidden": "unknown key; remove it or correct its spelling",
    "missing": "this key is missing; add it",
    "finite_number": "expected a finite number; correct it",
    "float_type": "expected a number; write it without quotes",
    "string_type": "expected text; write it in quotes",
    "tuple_type": "expected a list in brackets",
    "dict_type": "expected a table",
    "model_type": "expected a table",
    "literal_error": "expected {expected}",
    "greater_than": "must be above {gt:g}; correct it",
    "greater_than_equal": "must be at least {ge:g}; correct it",
    "less_than_equal": "must be at most {le:g}; correct it",
    "string_too_short": "must not be empty; give it a text",
    "too_short": "expected at least {min_length} entries, found {actual_length}",
    "too_long": "expected at most {max_length} entries, found {actual_length}",
}


def read(path: Path, model: type[T]) -> T:
    """Read the TOML file `path` as `model`.

    Raises:
        InputError: the file is absent, no TOML, or breaks the schema; the message lists every broken key.
    """
    return parse(table(path), model, str(path))


def table(path: Path) -> dict[str, Any]:
    """Return the TOML file `path` as it stands, or raise `InputError`."""
    try:
        return tomllib.loads(size_limited.read_text(path, size_limited.SETTINGS, "give a TOML file"))
    except InputError:
        raise
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: cannot be read as text: {error}") from None
    except (ValueError, RecursionError) as error:  # of which the first is also raised for endless integers
        raise InputError(f"{path}: not valid TOML: {error}") from None


def text(table: Mapping[str, Any]) -> str:
    """Return `table` as TOML.

    Args:
        table: of strings, booleans, numbers, sequences of these, tables, and sequences of tables; None is left out.
    """
    return tomlkit.dumps(_writable(table, 0))


def _writable(value: Any, depth: int) -> Any:
    """Return tables without None, for which TOML has no name, and sequences as lists.

    A table of plain values in another one takes one line, as in ``c_d.head = {low = 0.1}``, but for one of lists.
    """
    if isinstance(value, Mapping):
        table = {key: _writable(item, depth + 1) for key, item in value.items() if item is not None}
        items = table.values()
        if depth < 2 or all(isinstance(item, list) for item in items) or any(_holds_tables(item) for item in items):
            return table
        line = tomlkit.inline_table()
        line.update(table)
        return line
    if isinstance(value, (list, tuple)):
        return [_writable(item, 1 if isinstance(item, Mapping) else depth) for item in value]
    return value


def _holds_tables(value: Any) -> bool:
    return isinstance(value, dict) or (isinstance(value, list) and any(isinstance(item, dict) for item in value))


def parse(raw: object, model: type[T], place: str) -> T:
    """Validate the parsed table `raw` as `model`; `place` opens every message.

    Strictly, so that ``"1.5"`` and ``true`` are not numbers.
    """
    try:
        with complaining(place):
            return model.model_validate(frozen(raw), strict=True)
    except RecursionError:
        raise InputError(
            f"{place}: tables are nested too deep, expected those of {model.__name__}; flatten them"
        ) from None


@contextlib.contextmanager
def complaining(place: str) -> Iterator[None]:
    """Raise `InputError` where pydantic complains inside; `place` opens every message."""
    try:
        yield
    except ValidationError as error:
        raise InputError(complaints(place, error)) from None


def complaints(place: str, error: ValidationError) -> str:
    """Say every complaint of pydantic in the words of this project, one a line; `place` opens each."""
    items = error.errors()
    # A list whose entries are broken is not too short as well, as pydantic has it.
    deeper = {item["loc"][:depth] for item in items for depth in range(len(item["loc"]))}
    own = [item for item in items if item["type"] != "too_short" or item["loc"] not in deeper]
    return "\n".join(_complaint(place, item) for item in own)


def frozen(raw: object) -> object:
    """Turn lists into tuples, all the way down: strict validation takes no list for a tuple."""
    if isinstance(raw, Mapping):
        return {key: frozen(value) for key, value in raw.items()}
    return tuple(frozen(item) for item in raw) if isinstance(raw, (list, tuple)) else raw


def _complaint(place: str, item: object) -> str:
    assert isinstance(item, dict)  # noqa: S101 - pydantic's ErrorDetails is a TypedDict
    key = ".".join(str(part + 1) if isinstance(part, int) else str(part) for part in item["loc"])
    text = _REMEDIES.get(item["type"], "").format(**item.get("ctx", {}))
    text = text or str(item["msg"]).removeprefix("Value error, ")
    found = item["input"]
    if item["type"] == "float_type" and isinstance(found, tuple):
        text = f"expected one number, found {len(found)}; correct it"
    name = ".".join(part for part in item["loc"] if isinstance(part, str))
    if item["type"] == "tuple_type" and isinstance(found, Mapping):
        text = f"one table, expected a list of them; write [[{name}]] in place of [{name}]"
    if item["type"] in ("model_type", "dict_type") and isinstance(found, tuple):
        text = f"a list of tables, expected one; write [{name}] in place of [[{name}]]"
    shown = f" (found {found!r:.200})" if isinstance(found, (int, float, str, bool)) else ""
    return ": ".join(part for part in (place, key, text + shown) if part)
