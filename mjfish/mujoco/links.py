"""What the water must know of a body: strips by their sections along an axis, or a blunt body, and its coefficients.

Told from each other by their keys; given in Python or TOML, in an MJCF by `mjfish.mujoco.custom_numerics`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from numbers import Real
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import ArrayLike
from pydantic import BeforeValidator, Field, field_validator, model_validator

from mjfish.errors import InputError, UnknownNameError
from mjfish.files import tomlfile
from mjfish.files.tomlfile import Table
from mjfish.fish import NotNegative, Section
from mjfish.hydro.blunt_force import ellipsoid_added_mass, ellipsoid_turning
from mjfish.hydro.force import KC_0
from mjfish.numerics.arrays import FloatArray
from mjfish.parameters import Parameter

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
#: Smallest and largest size that is taken [m], largest density [kg/m3]: within these no force overflows.
SMALLEST, LARGEST = 1e-6, 1e4
DENSEST = 1e5
_EXACT = 1e-9  # stations this close are the same [m]


def without_arrays(value: object) -> object:
    """Take arrays for tuples."""
    return tomlfile.frozen(value.tolist()) if isinstance(value, np.ndarray) else value


def _extent(value: object) -> object:
    """Take a number, or one a station; said in one sentence, where pydantic would complain of either."""
    value = without_arrays(value)
    for item in value if isinstance(value, tuple) else (value,):
        if isinstance(item, bool) or not isinstance(item, Real) or not math.isfinite(item):
            found = f"; found {value}" if isinstance(value, tuple) else ""
            raise ValueError(f"expected a finite number, or a list of them, one a station{found}; correct it")
    return value


def point(value: object) -> object:
    """Take three numbers; said in one sentence."""
    value = without_arrays(value)
    if isinstance(value, tuple) and len(value) != 3:
        raise ValueError(f"expected three numbers x, y, z in the body's frame, found {len(value)}; correct it")
    return value


Size = Annotated[float, Field(ge=SMALLEST, le=LARGEST)]
Coordinate = Annotated[float, Field(ge=-LARGEST, le=LARGEST)]
Stations = Annotated[tuple[Coordinate, ...], BeforeValidator(without_arrays)]
Extent = Annotated[float | tuple[float, ...], BeforeValidator(_extent)]
Point = Annotated[tuple[Coordinate, Coordinate, Coordinate], BeforeValidator(point)]


def check_bounds(value: float, info: Any) -> float:
    """Return the value of a coefficient, as a validator of its field."""
    declared = COEFFICIENTS[info.field_name]
    if not declared.low <= value <= declared.high:
        raise ValueError(f"{value:g} is outside its bounds [{declared.low:g}, {declared.high:g}]; choose one inside")
    return value


class Described(Table):
    """A body in water by its keys.

    Attributes:
        body: name of the body in the MuJoCo model.
    """

    body: str = Field(min_length=1)

    def __init__(self, **keys: Any) -> None:
        with tomlfile.complaining(f"link '{keys.get('body', '')}'"):
            self.__pydantic_validator__.validate_python(tomlfile.frozen(keys), self_instance=self, strict=True)

    _bounded = field_validator(*COEFFICIENTS, check_fields=False)(check_bounds)


class StripLink(Described):
    """A body with strips of water on it; its sections are ellipses of a height and a width.

    On a strip of height h and width w that moves at q across the link act, per length [N/m], the inertial force
    c_m rho pi h^2 / 4 q' and the drag 1/2 rho c_d h |q| q across the height, the same with w across the width, and
    friction 1/2 rho c_f P u^2 along the link, P the perimeter ([Yu2016]; all of it in `mjfish.hydro.spatial_force`).
    Where a list is expected, arrays and tuples do as well.

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
        c_m: added mass across both axes and in roll, 1 for an ellipse in potential flow.
        c_d: drag across both axes.
        c_f: skin friction along the link.
        munk_moment: share of the Munk moment: 0 Morison, 1 Kirchhoff.
        roll_damping: drag in roll, of that of a turning plate.
        kc: Keulegan-Carpenter number KC = 2 pi A / h, above 0, of a link that beats to the side with amplitude A: c_d
            is that of KC = 3, and the drag has c_d (KC / 3)^-n, `drag_coefficient`. Absent: the drag has c_d.
        kc_power: n; plates across the flow have c_d = 8 KC^(-1/3) (Graham, J. Fluid Mech. 97 (1980)).
        volume: displaced [m3]; absent: that of the sections.
        buoyancy_center: in the body's frame [m]; absent: that of the sections.

    Raises:
        InputError: every broken key, by name; sizes must be from 1e-6 to 1e4 m, coefficients within their bounds.

    Example:
        >>> fin = mjfish.StripLink(body="fin", length=0.2, height=[0.05, 0.12], width=0.004, c_d=1.8)
        >>> fin.outline[0].height
        (0.05, 0.12)
    """

    length: Size
    station: Stations = ()
    height: Extent = ()
    width: Extent = ()
    sections: tuple[Section, ...] = ()
    start: Annotated[NotNegative, Field(le=LARGEST)] = 0.0
    origin: Point = (0.0, 0.0, 0.0)
    axis: Point = (-1.0, 0.0, 0.0)
    up: Point = (0.0, 0.0, 1.0)
    c_m: float = COEFFICIENTS["c_m"].default
    c_d: float = COEFFICIENTS["c_d"].default
    c_f: float = COEFFICIENTS["c_f"].default
    munk_moment: float = COEFFICIENTS["munk_moment"].default
    roll_damping: float = COEFFICIENTS["roll_damping"].default
    kc: Annotated[float, Field(gt=0.0)] | None = None
    kc_power: Annotated[float, Field(ge=-1.0, le=1.5)] = 1.0 / 3.0
    volume: Annotated[NotNegative, Field(le=LARGEST**3)] | None = None
    buoyancy_center: Point | None = None

    @model_validator(mode="after")
    def _outlined(self) -> StripLink:
        by_extents = [name for name in ("station", "height", "width") if getattr(self, name) != ()]
        if self.start and not self.sections:
            raise ValueError("'start' is a station of 'sections'; without these, stations start at 0")
        if self.sections and by_extents:
            raise ValueError(f"found 'sections' beside {', '.join(by_extents)}; give one or the other")
        if not self.sections and not by_extents:
            raise ValueError("its sections are missing; give height and width, or 'sections'")
        pieces = self.outline  # raises where stations and extents do not match
        for before, after in pairwise(pieces):
            if abs(after.start - before.end) > _EXACT:
                raise ValueError(
                    f"sections leave a gap or overlap between {before.end:g} and {after.start:g} m; "
                    "let each start where the last one ends"
                )
        for piece in pieces:
            for name, ends in (("height", piece.height), ("width", piece.width)):
                if not SMALLEST <= max(ends) <= LARGEST:
                    raise ValueError(
                        f"{name} is at most {max(ends):g} m in the piece from {piece.start:g} to {piece.end:g} m; "
                        f"expected {SMALLEST:g} to {LARGEST:g} m at one end at least; correct it"
                    )
        first, last, end = pieces[0].start, pieces[-1].end, self.start + self.length
        if first > self.start + _EXACT or last < end - _EXACT or (self.station and last > end + _EXACT):
            raise ValueError(
                f"sections are given from {first:g} to {last:g} m, the link runs from {self.start:g} to {end:g} m; "
                "give them over its whole length"
            )
        self.frame  # noqa: B018 - raises where axis and up are parallel
        if self.kc is None and "kc_power" in self.model_fields_set:
            raise ValueError("'kc_power' is a power of 'kc', which is missing; add it, or take out the power")
        self.check_drag()
        return self

    def check_drag(self) -> None:
        """Raise ValueError where `kc` makes the drag larger than any."""
        if not self.drag_coefficient <= COEFFICIENTS["c_d"].high:
            raise ValueError(
                f"kc {self.kc:g} makes c_d {self.drag_coefficient:g}, expected {COEFFICIENTS['c_d'].high:g} at most; "
                "correct kc, kc_power or c_d"
            )

    @property
    def drag_coefficient(self) -> float:
        """The drag coefficient at the link's Keulegan-Carpenter number, c_d (kc / 3)^-kc_power; without one, c_d."""
        return self.c_d if self.kc is None else self.c_d * (self.kc / KC_0) ** -self.kc_power

    @property
    def outline(self) -> tuple[Section, ...]:
        """The pieces of the outline, from station 0 to the end."""
        if self.sections:
            return self.sections
        station = self.station or (0.0, self.length)
        heights, widths = (self._at_stations(name, len(station)) for name in ("height", "width"))
        if len(station) < 2:
            raise ValueError(f"found one station, {station[0]:g} m; expected two at least; add the other end")
        for a, b in pairwise(station):
            if b - a <= _EXACT:
                raise ValueError(f"stations must grow; found {b:g} m behind {a:g} m; correct them")
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
        for k, extent in enumerate(extents):
            before, place = (f" at station {k} and", f" at station {k + 1}") if isinstance(value, tuple) else ("", "")
            if extent < 0.0:
                raise ValueError(f"{name} is {extent:g} m{place}; must be at least 0; correct it")
            if k and max(extents[k - 1 : k + 1]) <= 0.0:
                raise ValueError(f"{name} is 0 m{before}{place}; must be above 0; correct it")
        return tuple(extents)

    @property
    def frame(self) -> FloatArray:
        """The axes (3, 3) of the strips in the body's frame, row by row: along the strips, y, height."""
        x, up = np.array(self.axis), np.array(self.up)
        for name, vector in (("axis", x), ("up", up)):
            if not np.linalg.norm(vector) > _EXACT:
                raise ValueError(f"{name} {getattr(self, name)} has no length; give a direction")
        z = up - x * (x @ up) / (x @ x)
        if not np.linalg.norm(z) > 1e-6 * np.linalg.norm(up):
            raise ValueError(f"up {self.up} is along axis {self.axis}; give another direction")
        x, z = x / np.linalg.norm(x), z / np.linalg.norm(z)
        return np.array([x, np.cross(z, x), z])


_SYMMETRIC = 1e-9  # of the largest entry
_NONE = (0.0, 0.0, 0.0)  # semiaxes of no ellipsoid
#: Keys of which a table must have one to be a `BluntLink`.
KEYS = ("semiaxes", "added_mass")


def _matrix(value: object) -> object:
    """Take six numbers for a diagonal, 36 or six rows of six for a matrix."""
    value = without_arrays(value)
    if not isinstance(value, tuple):
        return value
    try:
        numbers = np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        numbers = np.zeros(0)
    if numbers.size not in (6, 36) or numbers.shape not in ((6,), (36,), (6, 6)) or not np.isfinite(numbers).all():
        raise ValueError("expected six numbers, a diagonal, or a matrix of 6 x 6; correct it")
    matrix = np.diag(numbers) if numbers.size == 6 else numbers.reshape(6, 6)
    largest = np.abs(matrix).max()
    if np.abs(matrix - matrix.T).max() > _SYMMETRIC * largest:
        raise ValueError("expected a symmetric matrix; take the mean of it and its transpose")
    if np.linalg.eigvalsh(matrix).min() < -_SYMMETRIC * largest:
        raise ValueError("found a negative eigenvalue, expected none; correct its signs")
    return tuple(map(tuple, matrix.tolist()))


Row = tuple[float, float, float, float, float, float]
Matrix = Annotated[tuple[Row, Row, Row, Row, Row, Row], BeforeValidator(_matrix)]
Semiaxes = Annotated[tuple[Size, Size, Size], BeforeValidator(point)]
Amounts = Annotated[tuple[NotNegative, NotNegative, NotNegative], BeforeValidator(point)]


class BluntLink(Described):
    """A body in water that strips do not describe: a hull, a float, a sphere.

    The force is that of `mjfish.hydro.blunt_force`, in the axes of the body. Either it is an ellipsoid along these
    axes, or its added mass is given, with areas and volume; what is given replaces what the ellipsoid has.

    Attributes:
        body: name of the body in the MuJoCo model.
        semiaxes: of the ellipsoid along x, y, z of the body [m].
        added_mass: about the origin, forces first: diagonal (6,) or matrix (6, 6) [kg, kg m, kg m2], symmetric, at no
            motion negative.
        area: that the body shows to the water along x, y, z [m2]; of an ellipsoid, those of its ellipses.
        turning: T of the drag about x, y, z [m5]; without an ellipsoid, 0.
        volume: displaced [m3].
        origin: middle of the ellipsoid, and where `added_mass` and the drag hold, in the body's frame [m].
        buoyancy_center: in the body's frame [m]; absent: the origin.
        c_m: factor of the added mass.
        c_d: drag, of the areas.
        munk_moment: share of the Munk moment: 1 Kirchhoff.

    Raises:
        InputError: every broken key, by name.

    Example:
        >>> hull = mjfish.BluntLink(body="hull", semiaxes=[0.4, 0.2, 0.2], c_d=0.3)
        >>> hull.matrix(1000.0).diagonal().round(2).tolist()
        [14.08, 47.2, 47.2, 0.0, 0.64, 0.64]
    """

    semiaxes: Semiaxes | None = None
    added_mass: Matrix | None = None
    area: Amounts | None = None
    turning: Amounts | None = None
    volume: Annotated[NotNegative, Field(le=LARGEST**3)] | None = None
    origin: Point = (0.0, 0.0, 0.0)
    buoyancy_center: Point | None = None
    c_m: float = COEFFICIENTS["c_m"].default
    c_d: float = COEFFICIENTS["c_d"].default
    munk_moment: float = 1.0

    @model_validator(mode="after")
    def _described(self) -> BluntLink:
        for key in ("added_mass", "area", "volume") if self.semiaxes is None else ():
            if getattr(self, key) is None:
                raise ValueError(f"{key}: this key is missing, as there are no 'semiaxes'; add either")
        return self

    def matrix(self, density: float) -> FloatArray:
        """Return the added mass (6, 6) about the origin, for c_m = 1."""
        return np.array(self.added_mass or np.diag(ellipsoid_added_mass(self.semiaxes or _NONE, density)))

    @property
    def areas(self) -> FloatArray:
        """S (3,) of the drag [m2]."""
        a, b, c = self.semiaxes or _NONE
        return np.array(self.area or (np.pi * (b * c), np.pi * (c * a), np.pi * (a * b)))

    @property
    def turnings(self) -> FloatArray:
        """T (3,) of the drag [m5]."""
        return np.array(self.turning or ellipsoid_turning(self.semiaxes or _NONE))

    @property
    def displaced(self) -> float:
        """Volume [m3]."""
        ellipsoid = float(4.0 / 3.0 * np.pi * np.prod(self.semiaxes or _NONE))
        return ellipsoid if self.volume is None else self.volume


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
