"""What is known of the numbers of a fish: ``mass = { value = 0.725, sd = 0.02 }`` in its file.

A number given as a table is free in a fit. With an ``sd`` it has a prior (`mjfish.parameters.Parameter.deviation`),
with ``low`` and ``high`` a range. Its parameter has the name of the number, then that of the link: ``mass.head``.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Annotated, Any

from pydantic import Field, ValidationError

from mjfish.files.tomlfile import Table, complaints
from mjfish.parameters import Parameter

#: Where a number stands in the table of a fish: keys, and places in lists.
Place = tuple[str | int, ...]
#: Where the numbers stand that may be free, with their units, and whether they cannot be negative.
_FREE = {
    ("links", int, "length"): ("m", True),
    ("links", int, "mass"): ("kg", True),
    ("links", int, "com"): ("m", False),
    ("links", int, "inertia"): ("kg m2", True),
    ("sections", int, "height", int): ("m", True),
    ("sections", int, "width", int): ("m", True),
    ("density",): ("kg/m3", True),
    ("munk_moment",): ("-", False),
}
_ENDS = ("front", "rear")
#: What may stand beside the value of a number.
_KEYS = ("mean", "sd", "low", "high")
#: Bounds of a number that has an sd and none of its own: so many sds from its value.
_REACH = 12.0

Positive = Annotated[float, Field(gt=0.0, le=1e9)]
Bound = Annotated[float, Field(ge=-1e9, le=1e9)]


class ParameterPrior(Table):
    """What is known of one number before a fit: an sd about a mean, or a range, or both; None: as declared."""

    mean: Bound | None = None
    sd: Positive | None = None
    low: Bound | None = None
    high: Bound | None = None

    def of(self, declared: Parameter) -> Parameter:
        """Return a parameter of which this is known: it starts at the mean, and its bounds hold twelve sds."""
        mean = declared.start if self.mean is None else self.mean
        low, high = (declared.low, declared.high) if self.sd is None else _reach(mean, self.sd, declared.low >= 0.0)
        low, high = low if self.low is None else self.low, high if self.high is None else self.high
        known = declared.rebound(low=low, high=high, start=min(max(mean, low), high))
        return known if self.sd is None else replace(known, sd=self.sd, mean=mean)


class FishParameterPrior(ParameterPrior):
    """What is known of a number of a fish; `place` is where it stands in the fish's table.

    A fish that was fitted has other values, and `mean` says what was known before.
    """

    place: Place


def split(raw: object) -> tuple[object, list[dict[str, Any]]]:
    """Return a fish's table with plain numbers, and what it says beside them: one table with a `place` each.

    Raises:
        ValueError: a number that may not be free, a table without value, or with neither sd nor range.
    """
    found: list[dict[str, Any]] = []
    if not isinstance(raw, Mapping):
        return raw, found
    plain = {key: part if key == "coefficients" else _plain(part, (key,), found) for key, part in raw.items()}
    return plain, found


def joined(table: dict[str, Any], known: Sequence[FishParameterPrior]) -> dict[str, Any]:
    """Return a fish's table with what is known beside its numbers: what `split` took apart."""
    for one in known:
        *path, last = one.place
        owner: Any = table
        for step in path:
            if isinstance(owner[step], tuple):
                owner[step] = list(owner[step])
            owner = owner[step]
        owner[last] = {"value": owner[last], **one.model_dump(include=set(_KEYS), exclude_none=True)}
    return table


def _plain(part: object, place: Place, found: list[dict[str, Any]]) -> object:
    if isinstance(part, Mapping):
        if "value" in part:
            return _number(part, place, found)
        return {key: _plain(value, (*place, key), found) for key, value in part.items()}
    if isinstance(part, (list, tuple)):
        return tuple(_plain(value, (*place, number), found) for number, value in enumerate(part))
    return part


def _number(table: Mapping[str, object], place: Place, found: list[dict[str, Any]]) -> object:
    where = ".".join(str(step + 1) if isinstance(step, int) else step for step in place)
    if _kind(place) not in _FREE:
        raise ValueError(
            f"{where}: this number cannot be free, expected one of length, mass, com, inertia of a link, height or "
            "width of a section, density, munk_moment; give it as a plain number"
        )
    unknown = set(table) - {"value", *_KEYS}
    if unknown:
        raise ValueError(f"{where}.{min(unknown)}: unknown key, expected value, {', '.join(_KEYS)}; remove it")
    if "sd" not in table and not ("low" in table and "high" in table):
        raise ValueError(f"{where}: neither sd nor low and high; add one of them, or give a plain number")
    given = {key: value for key, value in table.items() if key != "value"}
    try:
        ParameterPrior.model_validate(given, strict=True)
    except ValidationError as error:
        raise ValueError(complaints(where, error)) from None
    found.append({"place": place, **given})
    return table["value"]


def _kind(place: Place) -> tuple[str | type[int], ...]:
    """Return a place without the numbers of links, sections and ends, a key of `_FREE`."""
    return tuple(int if isinstance(step, int) else step for step in place)


def parameters(known: Sequence[FishParameterPrior], table: Any) -> Iterator[Parameter]:
    """Yield the parameter of every number of which something is known.

    Args:
        known: what.
        table: the fish, or its parts, by the keys of places as attributes.

    Raises:
        ParameterError: a range that is empty or does not hold the value, an sd that is not positive.
    """
    for one in known:
        name, (unit, positive) = _name(one.place, table), _FREE[_kind(one.place)]
        value = number_at(table, one.place)
        mean, low, high = value if one.mean is None else one.mean, one.low, one.high
        if one.sd is not None:
            least, most = _reach(mean, one.sd, positive)
            low, high = least if low is None else low, most if high is None else high
        if low is None or high is None:
            raise ValueError(f"{name}: neither sd nor low and high; add one of them")
        scale = max(0.3 * one.sd if one.sd is not None else 0.03 * (high - low), 1e-9 * abs(value), 1e-15)
        yield Parameter(name, unit, value, low, high, value, scale, about=_about(name), sd=one.sd, mean=one.mean)


def _reach(mean: float, sd: float, positive: bool) -> tuple[float, float]:
    """Return bounds that hold twelve sds about a mean, by factors where a number cannot be negative."""
    if positive and mean > 0.0:
        factor = (1.0 + sd / mean) ** _REACH
        return mean / factor, mean * factor
    return mean - _REACH * sd, mean + _REACH * sd


def number_at(table: Any, place: Place) -> float:
    """Return the number at a place of a fish."""
    for step in place:
        table = table[step] if isinstance(step, int) else getattr(table, step)
    return float(table)


def _name(place: Place, table: Any) -> str:
    """Return the name of the parameter of a number."""
    match place:
        case ("links", int() as number, str() as key):
            return f"{key}.{table.links[number].name}"
        case ("sections", int() as number, str() as key, int() as end):
            return f"{key}.section_{number + 1}_{_ENDS[end]}"
    return f"fish.{place[0]}"


def _about(name: str) -> str:
    kind, _, owner = name.partition(".")
    return f"{owner.replace('_', ' ')} of the fish" if kind == "fish" else f"{kind} of {owner.replace('_', ' ')}"
