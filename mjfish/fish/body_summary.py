"""What a fish is made of: masses, water that moves with it, a drawing, and what is odd about its numbers."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from mjfish.fish import Fish
from mjfish.fish.outline import outlines, section_at

#: Mass over that of the displaced water below and above which a fish, or a link, is odd.
_FISH, _LINK = (0.8, 1.25), (0.15, 6.0)
#: Inertia about the centre of mass over that of a uniform block of the same mass, length and width.
_INERTIA = (0.1, 3.0)
#: Added mass across over the mass of a link above which the fish is mostly water there.
_WATER = 30.0


@dataclass(frozen=True)
class LinkSummary:
    """What follows of one link from its section and the fish.

    Attributes:
        width: of its widest section [m].
        displaced: mass of the water that it displaces [kg].
        added: added mass across at the fish's c_m [kg].
        added_inertia: added inertia about the front joint at the fish's c_m [kg m2].
    """

    width: float
    displaced: float
    added: float
    added_inertia: float


@dataclass(frozen=True)
class BodySummary:
    """A fish in numbers.

    Attributes:
        links: nose first.
        odd: what is odd about its numbers, a sentence each.
        drawing: its side, as lines of text, nose to the left; joints are bars.
    """

    links: tuple[LinkSummary, ...]
    odd: tuple[str, ...]
    drawing: tuple[str, ...]


def summarise(fish: Fish, columns: int = 72) -> BodySummary:
    """Return what a fish is made of.

    Added mass is c_m INT rho pi/4 h^2 dr of the strips, see `mjfish.fish.outline`.

    Args:
        fish: the fish.
        columns: width of the drawing in letters.

    Example:
        >>> import mjfish
        >>> from mjfish.fish.body_summary import summarise
        >>> found = summarise(mjfish.load_fish("pike"))
        >>> [f"{own.displaced:.2f}" for link in found.links]
        ['1.46', '0.31', '0.23', '0.16', '0.08']
    """
    parts = [(fish.values[f"c_m.{link.group}"], own) for link, own in zip(fish.links, outlines(fish), strict=True)]
    links = tuple(
        LinkSummary(
            width=float(own.strip_width.max()),
            displaced=fish.density * own.volume,
            added=c_m * float(own.added[0]),
            added_inertia=c_m * float(own.added[2]),
        )
        for c_m, own in parts
    )
    return BodySummary(links, tuple(_odd(fish, links)), tuple(_drawing(fish, columns)))


def _odd(fish: Fish, links: tuple[LinkSummary, ...]) -> Iterator[str]:
    mass, displaced = sum(link.mass for link in fish.links), sum(own.displaced for own in links)
    if not _FISH[0] <= mass / displaced <= _FISH[1]:
        yield (
            f"The fish weighs {mass:.3g} kg and displaces {displaced:.3g} kg of water: it would "
            f"{'sink' if mass > displaced else 'float'}. Check masses, heights and widths."
        )
    for link, own in zip(fish.links, links, strict=True):
        if not _LINK[0] <= link.mass / own.displaced <= _LINK[1]:
            yield (
                f"{link.name} weighs {link.mass:.3g} kg and displaces {own.displaced:.3g} kg of water. "
                "Check its mass and its sections."
            )
        if not 0.0 <= link.com <= link.length:
            yield (
                f"The centre of mass of {link.name} is {link.com:.3g} m behind its front, its length is "
                f"{link.length:.3g} m. Check com: it is measured from the front joint."
            )
        block = link.mass * (link.length**2 + own.width**2) / 12.0
        if not _INERTIA[0] <= link.inertia / block <= _INERTIA[1]:
            yield (
                f"The inertia of {link.name} is {link.inertia:.3g} kg m2, that of a block of its mass and size "
                f"{block:.3g}. Check it: it is about the centre of mass."
            )
        if own.added > _WATER * link.mass:
            yield (
                f"{link.name} moves {own.added:.3g} kg of water with it and weighs {link.mass:.3g} kg. "
                "Check its height and its mass."
            )
    fin = max(fish.sections[-1].width)
    for number, section in enumerate(fish.sections[:-1], start=1):
        if max(section.width) < fin:
            yield (
                f"Section {number}, {section.start:.3g} to {section.end:.3g} m, is {max(section.width):.3g} m wide, "
                f"thinner than the fin behind it ({fin:.3g} m). Check the widths of both."
            )
    for p in fish.parameters:
        if p.default in (p.low, p.high):
            yield f"{p.name} = {p.default:g} lies on its bound. It cannot move that way in a fit."


def _drawing(fish: Fish, columns: int) -> Iterator[str]:
    """Yield the side of the fish; a letter is twice as high as it is wide."""
    width = fish.length / columns
    stations = np.asarray((np.arange(columns) + 0.5) * width, dtype=np.float64)
    height, _ = section_at(fish.sections, stations)
    joints = {int(s / width) for s in itertools.accumulate(link.length for link in fish.links[:-1])}
    rows = int(np.ceil(0.5 * float(height.max()) / (2.0 * width) - 0.5))
    for row in range(-rows, rows + 1):
        inside = abs(row * 2.0 * width) <= np.maximum(0.5 * height, width)
        yield "".join(("|" if at in joints else "#") if shown else " " for at, shown in enumerate(inside)).rstrip()
