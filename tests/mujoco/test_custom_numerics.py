"""Sections as custom numerics: one outline for all links, one of a link's own, and ways to say it badly."""

from __future__ import annotations

from typing import Any

import pytest
from wet_models import with_custom

from mjfish.errors import InputError, UnknownNameError
from mjfish.fish import Section
from mjfish.mujoco import StripFluid, StripLink
from mjfish.mujoco.custom_numerics import numerics_of

_NOSE = [0.0, 0.1, 0.0, 0.12, 0.0, 0.08, 1.0]
_REST = [0.1, 0.6, 0.12, 0.06, 0.08, 0.03, 0.0]
_LENGTHS = {"strip_fluid/trunk/length": 0.4, "strip_fluid/tail/length": 0.2, "strip_fluid/tail/start": 0.4}
_SECTIONS = (
    Section(start=0.0, end=0.1, profile="elliptic", height=(0.0, 0.12), width=(0.0, 0.08)),
    Section(start=0.1, end=0.6, height=(0.12, 0.06), width=(0.08, 0.03)),
)


def test_one_outline_serves_all_links() -> None:
    """Catches ends that are swapped, and a height read as a width."""
    fluid = StripFluid(with_custom({"strip_fluid/sections": _NOSE + _REST, **_LENGTHS}))
    assert fluid.links == (
        StripLink(body="trunk", length=0.4, sections=_SECTIONS),
        StripLink(body="tail", length=0.2, start=0.4, sections=_SECTIONS),
    )


def test_what_a_link_says_itself_goes_before_the_shared_outline() -> None:
    tail = [0.0, 0.2, 0.05, 0.12, 0.004, 0.004, 0.0]
    own = {"strip_fluid/trunk/length": 0.4, "strip_fluid/tail/length": 0.2, "strip_fluid/tail/sections": tail}
    fluid = StripFluid(with_custom({"strip_fluid/sections": _NOSE + _REST, **own}))
    assert fluid.links[1].sections == (Section(start=0.0, end=0.2, height=(0.05, 0.12), width=(0.004, 0.004)),)
    plain = {f"strip_fluid/tail/{key}": value for key, value in (("start", 0.0), ("height", 0.05), ("width", 0.004))}
    fluid = StripFluid(with_custom({"strip_fluid/sections": _NOSE + _REST, **_LENGTHS, **plain}))
    assert (fluid.links[0].sections, fluid.links[1].sections, fluid.links[1].height) == (_SECTIONS, (), 0.05)


_TRUNK: dict[str, Any] = {"body": "trunk", "length": 0.6, "sections": _SECTIONS}
_TAIL: dict[str, Any] = {"body": "tail", "length": 0.2, "start": 0.4, "sections": _SECTIONS}
_PLAIN: dict[str, Any] = {"body": "tail", "length": 0.2, "height": (0.1, 0.2), "width": 0.004}
LINKS = {
    "shared": [
        {**_TRUNK, "c_m": 0.3, "kc": 7.0, "kc_power": 0.1},
        {**_TAIL, "volume": 0.0, "buoyancy_center": (0.1, 0.2, 0.3)},
    ],
    "own": [{**_TRUNK, "origin": (0.1, 0.0, 0.0)}, {**_TAIL, "start": 0.0, "sections": _SECTIONS[:1], "length": 0.1}],
    "stations": [{**_PLAIN, "station": (0.0, 0.1, 0.2), "height": (0.1, 0.2, 0.1), "up": (0.0, 0.1, 1.0)}],
    "ends": [_PLAIN, {**_PLAIN, "body": "trunk", "height": 0.1}],
}


@pytest.mark.parametrize("links", LINKS.values(), ids=LINKS)
def test_described_links_are_read_back(links: list[dict[str, Any]]) -> None:
    made = tuple(StripLink(**link) for link in links)
    fluid = StripFluid(with_custom(numerics_of(made, 998.0)))
    assert fluid.links == made
    assert fluid.density == 998.0


def test_two_links_on_one_body_cannot_be_told_apart() -> None:
    link = StripLink(body="tail", length=0.2, height=0.1, width=0.004)
    with pytest.raises(InputError, match="two links share the body 'tail', an MJCF describes one a body; use a TOML"):
        numerics_of([link, link], 1000.0)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"strip_fluid/sections": _NOSE[:-1]},
            "custom numeric strip_fluid/sections: 6 numbers, expected rows of 7: .*; complete the last row",
        ),
        (
            {"strip_fluid/sections": [*_NOSE[:-1], 2.0, *_REST]},
            r"strip_fluid/sections: profile 2 in row 1, expected 0 \(linear\), 1 \(elliptic\); correct it",
        ),
        (
            {"strip_fluid/tail/sections": [*_REST[:-1], 0.5]},
            "strip_fluid/tail/sections: profile 0.5 in row 1, expected 0 ",
        ),
        ({"strip_fluid/sections": _NOSE}, "sections are given from 0 to 0.1 m, the link runs from 0 to 0.4 m"),
        ({"strip_fluid/tail/height": 0.1}, "link 'tail': 'start' is a station of 'sections'; without these, stations"),
    ],
)
def test_bad_sections_are_refused_by_place_and_remedy(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        StripFluid(with_custom({"strip_fluid/sections": _NOSE + _REST, **_LENGTHS, **changes}))


def test_an_unknown_key_of_the_water_lists_those_there_are() -> None:
    with pytest.raises(UnknownNameError, match=r"strip_fluid/outline'; known: .*strip_fluid/sections"):
        StripFluid(with_custom({"strip_fluid/outline": _NOSE, **_LENGTHS}))
