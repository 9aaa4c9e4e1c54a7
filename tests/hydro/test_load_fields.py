"""What a load reads of a link: what it does not read needs no derivative of it."""

from __future__ import annotations

from typing import Any

import numpy as np

from mjfish.hydro.link import LINK, column
from mjfish.hydro.load import fields_read, load


@load
def plain(link: Any, parameters: Any) -> tuple[float, float, float]:
    """Read two fields by name."""
    return parameters[0] * link.c_d * link.u, 0.0, link.strip_height[2]


def _handed_on(link: Any) -> float:
    return float(link.mass)


def test_fields_named_are_the_fields_read() -> None:
    assert plain.fields == {"c_d", "u", "strip_height"}
    assert np.flatnonzero(plain.reads)[0] == column("c_d")
    assert plain.reads.sum() == 1 + LINK["strip_height"].shape[0]


def test_a_field_is_read_beside_another_name() -> None:
    """Python 3.13 and later load or store two names in one instruction."""

    def beside(link: Any, parameters: Any) -> tuple[float, float, float]:
        scale = parameters[0]
        doubled = 2.0 * scale
        force = link.u
        return scale * link.c_d, doubled * link.v, force * link.w

    def both(link: Any, parameters: Any) -> tuple[float, float, float]:
        scale = parameters[0]
        return max(scale, link), max(link, scale), link.u

    assert fields_read(beside) == {"u", "v", "w", "c_d"}
    assert fields_read(both) == frozenset(LINK.names or ())


def test_a_link_that_is_handed_on_may_be_read_whole() -> None:
    """A helper, another name or a closure may read anything: derivatives must not be left out."""

    def handing(link: Any, parameters: Any) -> tuple[float, float, float]:
        return _handed_on(link), link.u, 0.0

    def renaming(link: Any, parameters: Any) -> tuple[float, float, float]:
        other = link
        return other.mass, link.u, 0.0

    def closing(link: Any, parameters: Any) -> tuple[float, float, float]:
        return sum(link.mass for _ in range(2)), 0.0, 0.0

    every = frozenset(LINK.names or ())
    assert fields_read(handing) == fields_read(renaming) == fields_read(closing) == every
