"""What the water must know of a body: its sections along an axis, and its coefficients.

Given in Python or TOML; in an MJCF: `mjfish.mujoco.custom_numerics`.
"""

from __future__ import annotations

import math
from itertools import pairwise
from numbers import Real
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, Field, ValidationError, field_validator, model_validator

from mjfish import tomlfile
from mjfish.arrays import FloatArray
from mjfish.errors import InputError
from mjfish.fish import NotNegative, Positive, Section
from mjfish.parameter import Parameter
from mjfish.tomlfile import Table

#: Coefficients of a link, dimensionless; each is a field of `StripLink`.
COEFFICIENTS = {
    parameter.name: parameter
    for parameter in (
        Parameter("c_m", "-", 1.0, 0.0, 100.0, 1.0, 0.1, "added mass of the sections, across both axes and in roll"),
        Parameter("c_d", "-", 1.0, 0.0, 100.0, 1.0, 0.1, "drag across both axes of the sections"),
        Parameter("c_f", "-", 0.01, 0.0, 1.0, 0.01, 0.001, "skin friction along the link"),
        Parameter("munk_moment", "-", 0.0, -2.0, 3.0, 0.0, 0.1, "share of the Munk moment: 0 Morison, 1 Kirchhoff"),
        Parameter("roll_damping", "-", 1.0, 0.0, 100.0, 1.0, 0.1, "drag in roll, of that of a turning plate"),
    )
}
_EXACT = 1e-9  # stations this close are the same [m]

Vector = tuple[float, float, float]


def _plain(value: object) -> object:
    """Take arrays for tuples."""
    return tomlfile.frozen(value.tolist()) if isinstance(value, np.ndarray) else value


def _extent(value: object) -> object:
    """Take a number, or one a station; said in one sentence, where pydantic would complain of either."""
    value = _plain(value)
    for item in value if isinstance(value, tuple) else (value,):
        if isinstance(item, bool) or not isinstance(item, Real) or not math.isfinite(item):
            found = f"; found {value}" if isinstance(value, tuple) else ""
            raise ValueError(f"expected a finite number, or a list of them, one a station{found}; correct it")
    return value


def _point(value: object) -> object:
    value = _plain(value)
    if isinstance(value, tuple) and len(value) != 3:
        raise ValueError(f"expected three numbers x, y, z in the body's frame, found {len(value)}; correct it")
    return value


Numbers = Annotated[tuple[float, ...], BeforeValidator(_plain)]
Extent = Annotated[float | tuple[float, ...], BeforeValidator(_extent)]
Point = Annotated[Vector, BeforeValidator(_point)]


class StripLink(Table):
    """A body with strips of water on it; its sections are ellipses of a height and a width.

    Attributes:
        body: name of the body in the MuJoCo model.
        length: of the strips' axis [m].
        station: where `height` and `width` are given [m], linear in between, from 0 to `length`; not needed where these
            are one number, or two, one at either end.
        height, width: one number, or one a station [m].
        sections: pieces of the outline instead of the three above, as in a fish's TOML.
        start: station of `sections` where this link begins [m]: links may share one outline.
        origin: where the link's first station lies in the body's frame [m].
        axis: direction of growing stations in the body's frame.
        up: direction of the height in the body's frame; what of it is along `axis` is taken off.
        c_m, c_d, c_f, munk_moment, roll_damping: see `COEFFICIENTS`.
        volume: displaced [m3]; absent: that of the sections.
        buoyancy_center: in the body's frame [m]; absent: that of the sections.

    Raises:
        InputError: every broken key, by name.
    """

    body: str = Field(min_length=1)
    length: Positive
    station: Numbers = ()
    height: Extent = ()
    width: Extent = ()
    sections: tuple[Section, ...] = ()
    start: NotNegative = 0.0
    origin: Point = (0.0, 0.0, 0.0)
    axis: Point = (-1.0, 0.0, 0.0)
    up: Point = (0.0, 0.0, 1.0)
    c_m: float = COEFFICIENTS["c_m"].default
    c_d: float = COEFFICIENTS["c_d"].default
    c_f: float = COEFFICIENTS["c_f"].default
    munk_moment: float = COEFFICIENTS["munk_moment"].default
    roll_damping: float = COEFFICIENTS["roll_damping"].default
    volume: NotNegative | None = None
    buoyancy_center: Point | None = None

    def __init__(self, **keys: Any) -> None:
        try:
            self.__pydantic_validator__.validate_python(tomlfile.frozen(keys), self_instance=self, strict=True)
        except ValidationError as error:
            raise InputError(tomlfile.complaints(f"link '{keys.get('body', '')}'", error)) from None

    @field_validator(*COEFFICIENTS)
    @classmethod
    def _bounded(cls, value: float, info: Any) -> float:
        declared = COEFFICIENTS[info.field_name]
        if not declared.low <= value <= declared.high:
            raise ValueError(
                f"{value:g} is outside its bounds [{declared.low:g}, {declared.high:g}]; choose one inside"
            )
        return value

    @model_validator(mode="after")
    def _outlined(self) -> StripLink:
        given = self.station or self.height != () or self.width != ()
        if self.start and not self.sections:
            raise ValueError("'start' is a station of 'sections'; without these, stations start at 0")
        if bool(self.sections) == bool(given):
            raise ValueError("give its sections either by height and width or by 'sections'")
        pieces = self.outline  # raises where stations and extents do not match
        if any(abs(b.start - a.end) > _EXACT for a, b in pairwise(pieces)):
            raise ValueError("sections have gaps; each must start where the last one ends")
        first, last, end = pieces[0].start, pieces[-1].end, self.start + self.length
        if first > self.start + _EXACT or last < end - _EXACT or (self.station and last > end + _EXACT):
            raise ValueError(
                f"sections are given from {first:g} to {last:g} m, the link runs from {self.start:g} to {end:g} m; "
                "give them over its whole length"
            )
        self.frame  # noqa: B018 - raises where axis and up are parallel
        return self

    @property
    def outline(self) -> tuple[Section, ...]:
        """The pieces of the outline, from station 0 to the end."""
        if self.sections:
            return self.sections
        station = self.station or (0.0, self.length)
        heights, widths = (self._at_stations(name, len(station)) for name in ("height", "width"))
        if len(station) < 2 or any(b <= a for a, b in pairwise(station)):
            raise ValueError(f"stations must be two at least, and grow; found {station}; correct them")
        return tuple(
            Section.model_validate({"from": a, "to": b, "height": h, "width": w})
            for (a, b), h, w in zip(pairwise(station), pairwise(heights), pairwise(widths), strict=True)
        )

    def _at_stations(self, name: Literal["height", "width"], stations: int) -> tuple[float, ...]:
        value = getattr(self, name)
        if value == ():
            raise ValueError(f"{name}: this key is missing; add it")
        extents = (value,) * stations if isinstance(value, float) else value
        if len(extents) != stations:
            raise ValueError(f"{len(extents)} values of {name} for {stations} stations; give one a station")
        if min(extents) < 0.0 or any(max(ends) <= 0.0 for ends in pairwise(extents)):
            raise ValueError(
                f"{name} must be 0 at least, and above 0 at one end of each piece; found {value}; correct it"
            )
        return tuple(extents)

    @property
    def frame(self) -> FloatArray:
        """The axes (3, 3) of the strips in the body's frame, row by row: along the strips, y, height."""
        x, up = np.array(self.axis), np.array(self.up)
        z = up - x * (x @ up) / max(float(x @ x), 1e-300)
        if not np.linalg.norm(x) > _EXACT or not np.linalg.norm(z) > 1e-6 * np.linalg.norm(up):
            raise ValueError(f"axis {self.axis} and up {self.up} must be two directions; choose others")
        x, z = x / np.linalg.norm(x), z / np.linalg.norm(z)
        return np.array([x, np.cross(z, x), z])


class Water(Table):
    """A TOML of links in water: ``density`` [kg/m3] and ``[[links]]``, each a `StripLink`."""

    schema_: Literal[1] = Field(alias="schema", default=1)
    density: Positive = 1000.0
    links: tuple[StripLink, ...] = Field(min_length=1)


def read(path: str | Path) -> Water:
    """Read a TOML of links in water.

    Raises:
        InputError: every broken key, by name.
    """
    return tomlfile.read(Path(path), Water)
