"""Links in water, of strips or blunt: told from each other by their keys, read from TOML, given other coefficients."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import ArrayLike
from pydantic import BeforeValidator, Field

from mjfish.errors import InputError, UnknownNameError
from mjfish.files import tomlfile
from mjfish.files.tomlfile import Table
from mjfish.mujoco.blunt_link import KEYS, BluntLink
from mjfish.mujoco.strip_link import COEFFICIENTS, DENSEST, StripLink

Link = StripLink | BluntLink


def link_of(keys: Mapping[str, Any]) -> Link:
    """Return the link that a table of keys describes: a `BluntLink` where it has one of `KEYS`.

    Raises:
        InputError: every broken key, by name.
    """
    return BluntLink(**keys) if keys.keys() & set(KEYS) else StripLink(**keys)


AnyLink = Annotated[Link, BeforeValidator(lambda value: link_of(value) if isinstance(value, Mapping) else value)]
Density = Annotated[float, Field(gt=0.0, le=DENSEST)]


def with_coefficients(links: Sequence[Link], values: Mapping[str, ArrayLike]) -> tuple[Link, ...]:
    """Return links with other coefficients.

    Args:
        links: n links.
        values: by coefficient, a number for all links or one a link (n,); a link without that coefficient passes it
            over.

    Raises:
        UnknownNameError: no such coefficient.
        InputError: a value is no number, outside its bounds, or there are not as many as links.
    """
    columns = {}
    for name, value in values.items():
        if name not in COEFFICIENTS:
            raise UnknownNameError("coefficient", name, COEFFICIENTS)
        declared = COEFFICIENTS[name]
        try:
            numbers = np.asarray(value, dtype=np.float64)
        except (TypeError, ValueError):
            raise InputError(f"{name}: found {value!r}, expected a number or one a link; correct it") from None
        if numbers.shape not in ((), (len(links),)):
            raise InputError(
                f"{name}: found an array of shape {numbers.shape}, expected a number, or {len(links)}, one a link; "
                "correct it"
            )
        column = columns[name] = np.broadcast_to(numbers, len(links)).tolist()
        for link, number in zip(links, column, strict=True):
            if not declared.low <= number <= declared.high:
                raise InputError(
                    f"link '{link.body}': {name}: {number:g} is outside its bounds "
                    f"[{declared.low:g}, {declared.high:g}]; choose one inside"
                )
    changed = tuple(
        link.model_copy(update={n: column[index] for n, column in columns.items() if n in type(link).model_fields})
        for index, link in enumerate(links)
    )
    for link in changed:
        try:
            if isinstance(link, StripLink):
                link.check_drag()
        except ValueError as error:
            raise InputError(f"link '{link.body}': {error}") from None
    return changed


class Water(Table):
    """A TOML of links in water: ``density`` [kg/m3] and ``[[links]]``, each a `StripLink` or a `BluntLink`."""

    schema_: Literal[1] = Field(alias="schema", default=1)
    density: Density = 1000.0
    links: tuple[AnyLink, ...] = Field(min_length=1)


def read(path: str | Path) -> Water:
    """Read a TOML of links in water.

    Raises:
        InputError: every broken key, by name.
    """
    return tomlfile.read(Path(path), Water)
