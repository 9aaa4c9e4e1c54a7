"""The fish as the generator sees it: strips of its outline by the midpoint rule, and masses."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from mjfish.fish import Fish, Section
from mjfish.numerics.arrays import FloatArray

#: Midpoint strips a link: fine (three times those of the solver), and coarse for sensitivities.
FINE, COARSE = 96, 24


@dataclass(frozen=True, eq=False)
class Outline:
    """Midpoint strips (links, strips): station behind the joint, length, height, width [m]."""

    r: FloatArray
    dr: FloatArray
    height: FloatArray
    width: FloatArray


@dataclass(frozen=True, eq=False)
class Body:
    """Numbers of all links for the kernel.

    Attributes:
        links: (links, 11) length, mass, com, inertia about the com, A0, A1, A2 = INT m_a r^k dr,
            1/2 rho c_f INT p dr, INT p dr, INT h dr, m_a at the rear end.
        r: (links, strips) [m].
        across: (links, strips) 1/2 rho c_d h dr [kg/m].
        side: (links, strips) h dr [m2].
        height: (links, strips) h [m].
        ring: (links, strips) p dr [m2].
    """

    links: FloatArray
    r: FloatArray
    across: FloatArray
    side: FloatArray
    height: FloatArray
    ring: FloatArray


@functools.lru_cache(maxsize=16)
def outline(sections: tuple[Section, ...], lengths: tuple[float, ...], strips: int) -> Outline:
    """Cut every link into `strips`; those of the blunt nose are graded, r = L xi^2, where h goes as the root of r."""
    rows = []
    start = 0.0
    for number, length in enumerate(lengths):
        edges = [start, *(s.end for s in sections if start + 1e-9 < s.end < start + length - 1e-9), start + length]
        pieces = np.diff(edges)
        counts = np.maximum(np.round(strips * pieces / length).astype(int), 4)
        counts[np.argmax(counts)] += strips - counts.sum()
        parts = [
            _piece(a, b, int(n), number == 0 and a == 0.0) for a, b, n in zip(edges, edges[1:], counts, strict=False)
        ]
        station, dr = (np.concatenate(column) for column in zip(*parts, strict=True))
        rows.append((station - start, dr, *_axes(sections, station)))
        start += length
    return Outline(*(np.array(column) for column in zip(*rows, strict=True)))


def _piece(a: float, b: float, count: int, graded: bool) -> tuple[FloatArray, FloatArray]:
    xi = (np.arange(count) + 0.5) / count
    if graded:
        return a + (b - a) * xi**2, 2.0 * (b - a) * xi / count
    return a + (b - a) * xi, np.full(count, (b - a) / count)


def _axes(sections: tuple[Section, ...], station: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return height and width of the elliptic sections [m]."""
    height, width = np.empty_like(station), np.empty_like(station)
    for section in sections:
        here = (station >= section.start) & (station <= section.end)
        s = (station[here] - section.start) / (section.end - section.start)
        s = np.sqrt(s * (2.0 - s)) if section.profile == "elliptic" else s
        height[here] = section.height[0] + s * (section.height[1] - section.height[0])
        width[here] = section.width[0] + s * (section.width[1] - section.width[0])
    return height, width


def body(fish: Fish, theta: Mapping[str, float], psi: Mapping[str, float], strips: int) -> Body:
    """Return the fish with coefficients `theta`, changed by the body effects in `psi`."""
    cut = outline(fish.sections, tuple(link.length for link in fish.links), strips)
    height = cut.height * (1.0 + psi.get("section_height.error", 0.0))
    half = 0.5 * fish.density
    a, b = 0.5 * height, 0.5 * cut.width
    ring = np.pi * (3.0 * (a + b) - np.sqrt((3.0 * a + b) * (a + 3.0 * b)))
    c_m, c_d, c_f = (np.array([theta[f"{kind}.{link.group}"] for link in fish.links]) for kind in ("c_m", "c_d", "c_f"))
    water = 0.25 * np.pi * fish.density * c_m[:, None] * height**2 * cut.dr
    added = [np.sum(water * cut.r**k, axis=1) for k in range(3)]
    own = [np.array([getattr(link, name) for link in fish.links]) for name in ("length", "mass", "com", "inertia")]
    own[2][0] += psi.get("com_offset.shift", 0.0)
    own[1] = own[1] * (1.0 + psi.get("mass_error.error", 0.0))
    own[3] = own[3] * (1.0 + psi.get("mass_error.error", 0.0)) * (1.0 + psi.get("inertia_error.error", 0.0))
    wetted = np.sum(ring * cut.dr, axis=1)
    sides = np.sum(height * cut.dr, axis=1)
    ends = _axes(fish.sections, np.cumsum(own[0]))[0] * (1.0 + psi.get("section_height.error", 0.0))
    edges = 0.25 * np.pi * fish.density * c_m * ends**2
    rows = [*own, *added, half * c_f * wetted, wetted, sides, edges]
    across = half * c_d[:, None] * height * cut.dr
    return Body(np.stack(rows, axis=1), cut.r, across, height * cut.dr, height, ring * cut.dr)
