"""Records of one link that compiled code works on: constants of body and water, and its velocity.

`LINK` is a link of the planar equation of motion, `SPATIAL` one that moves in space.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping
from typing import Any, Generic, TypeVar

import numpy as np

from mjfish.errors import UnknownNameError
from mjfish.fish import KINDS, Fish
from mjfish.fish.outline import COARSE, INTERVALS, STRIPS, outlines
from mjfish.numerics.arrays import FloatArray, RecordArray

#: Most hidden states a load may have on each link.
MEMORY = 8
#: One link; every field is a float64, so that a record is also a plain row of numbers.
#: mass, com, inertia, length: of the body; last: 1 of the last link, else 0.
#: density, c_m, c_d, c_f, munk: of the water on it.
#: added, wetted, height_moment, node_height, strip_*, coarse_*: integrals, see `mjfish.fish.outline.LinkOutline`.
#: u, v, w: velocity of the link's origin relative to the water in the link's frame (x towards the tail).
#: x, y, heading: place of the link's origin in the world and its heading, of the forward frame; for loads only.
#: bend: heading of the link relative to the head; first: 1 of the first link, else 0; for loads only.
#: memory: hidden states of the load that is called, on this link.
LINK = np.dtype(
    [
        ("mass", "f8"),
        ("com", "f8"),
        ("inertia", "f8"),
        ("length", "f8"),
        ("first", "f8"),
        ("last", "f8"),
        ("density", "f8"),
        ("c_m", "f8"),
        ("c_d", "f8"),
        ("c_f", "f8"),
        ("munk", "f8"),
        ("wetted", "f8"),
        ("u", "f8"),
        ("v", "f8"),
        ("w", "f8"),
        ("x", "f8"),
        ("y", "f8"),
        ("heading", "f8"),
        ("bend", "f8"),
        ("memory", "f8", (MEMORY,)),
        ("added", "f8", (3,)),
        ("node_height", "f8", (INTERVALS + 1,)),
        ("height_moment", "f8", (INTERVALS + 1, 4)),
        ("strip_r", "f8", (STRIPS,)),
        ("strip_weight", "f8", (STRIPS,)),
        ("strip_height", "f8", (STRIPS,)),
        ("strip_width", "f8", (STRIPS,)),
        ("strip_perimeter", "f8", (STRIPS,)),
        ("coarse_r", "f8", (COARSE,)),
        ("coarse_weight", "f8", (COARSE,)),
        ("coarse_height", "f8", (COARSE,)),
    ],
    align=True,
)

#: One link in three dimensions; every field is a float64, so that a record is also a plain row of numbers.
#: body: id of its body; carrier: where that body stands in the list of bodies that the water reaches.
#: origin (3,): of the strips' frame in the body's frame [m]; turn (9,): its axes, row by row: x along the strips, y, z.
#: center (3,): centre of buoyancy in the body's frame [m]; volume: displaced [m3].
#: length ... roll_damping: of the water on the link, see `mjfish.mujoco.links.StripLink`.
#: blunt: 1 where the link is no strips but `mjfish.hydro.blunt_force`, of which are matrix, area and turning.
#: the rest: integrals, see `mjfish.fish.outline.LinkOutline`.
SPATIAL = np.dtype(
    [
        ("body", "f8"),
        ("carrier", "f8"),
        ("origin", "f8", (3,)),
        ("turn", "f8", (9,)),
        ("center", "f8", (3,)),
        ("volume", "f8"),
        ("length", "f8"),
        ("density", "f8"),
        ("c_m", "f8"),
        ("c_d", "f8"),
        ("c_f", "f8"),
        ("munk", "f8"),
        ("roll_damping", "f8"),
        ("blunt", "f8"),
        ("matrix", "f8", (36,)),
        ("area", "f8", (3,)),
        ("turning", "f8", (3,)),
        ("added", "f8", (3,)),
        ("added_width", "f8", (3,)),
        ("added_roll", "f8"),
        ("roll_drag", "f8"),
        ("wetted", "f8"),
        ("node_height", "f8", (INTERVALS + 1,)),
        ("height_moment", "f8", (INTERVALS + 1, 4)),
        ("node_width", "f8", (INTERVALS + 1,)),
        ("width_moment", "f8", (INTERVALS + 1, 4)),
        ("strip_r", "f8", (STRIPS,)),
        ("strip_weight", "f8", (STRIPS,)),
        ("strip_height", "f8", (STRIPS,)),
        ("strip_width", "f8", (STRIPS,)),
    ],
    align=True,
)

#: Fields of `LINK` that compiled code writes.
MOVING = frozenset(("u", "v", "w", "x", "y", "heading", "bend", "memory"))
#: Numbers in a `LINK` record.
NUMBERS = LINK.itemsize // 8
Thing = TypeVar("Thing")


class Same(Generic[Thing]):
    """A cache key that compares by identity: hashing a fish takes longer than what the cache saves."""

    def __init__(self, thing: Thing) -> None:
        """Hold a reference, so that the identity is not reused."""
        self.thing = thing

    def __hash__(self) -> int:
        return id(self.thing)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Same) and other.thing is self.thing


@functools.lru_cache(maxsize=64)
def _template(same: Same[Fish]) -> RecordArray:
    """Return the records of the links with every field set but the coefficients' values and the velocity."""
    fish = same.thing
    values = fish.values
    records = np.zeros(len(fish.links), dtype=LINK)
    for record, link, outline in zip(records, fish.links, outlines(fish), strict=True):
        for field in ("mass", "com", "inertia", "length"):
            record[field] = getattr(link, field)
        for field in LINK.names or ():
            if hasattr(outline, field):
                record[field] = getattr(outline, field)
        for kind in KINDS:
            record[kind] = values[f"{kind}.{link.group}"]
        record["density"] = fish.density
        record["munk"] = fish.munk_moment
    records[0]["first"] = records[-1]["last"] = 1.0
    records.flags.writeable = False
    return records


@functools.lru_cache(maxsize=64)
def _places(same: Same[Fish]) -> dict[str, tuple[str, Any]]:
    """Return the field and the links of each coefficient."""
    groups = np.array([link.group for link in same.thing.links])
    names = (name.partition(".") for name in same.thing.coefficient_names)
    return {f"{kind}.{group}": (kind, np.flatnonzero(groups == group)) for kind, _, group in names}


def link_records(fish: Fish, values: Mapping[str, float] | None = None) -> RecordArray:
    """Return one `LINK` record a link, nose first; `values` replaces coefficients by name (bounds are not checked).

    Raises:
        UnknownNameError: a name in `values` is no coefficient.
    """
    same = Same(fish)
    records, places = _template(same).copy(), _places(same)
    for name, value in (values or {}).items():
        if name not in places:
            raise UnknownNameError("coefficient", name, fish.coefficient_names)
        kind, links = places[name]
        records[kind][links] = value
    return records


def numbers_of(fish: Fish, values: Mapping[str, float] | None = None) -> FloatArray:
    """Return the link records as rows of numbers (links, NUMBERS)."""
    rows: FloatArray = link_records(fish, values).view(np.float64).reshape(-1, NUMBERS)
    return rows


def column(name: str) -> int:
    """Return where a field of `LINK` starts in a row of numbers."""
    fields: Any = LINK.fields
    return int(fields[name][1]) // 8
