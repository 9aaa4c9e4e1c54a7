"""Outline of the fish cut into links, and its integrals: the moments that the strip forces need.

Stations are measured from the nose; r is measured from the front joint of a link, both towards the tail [m].
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mjfish.fish import Fish, Section
from mjfish.numerics.arrays import FloatArray, readonly

#: Intervals of the table of cumulative height moments.
INTERVALS = 128
#: Strips a link for forces that have no closed form; and for a smooth factor on such a force.
STRIPS = 32
COARSE = 8
_GAUSS_POINTS, _GAUSS_WEIGHTS = np.polynomial.legendre.leggauss(24)


@dataclass(frozen=True, eq=False)
class LinkOutline:
    """Integrals over one link; see physics of the strip method in `mjfish.hydro.force`.

    Attributes:
        added: (3,) INT rho pi/4 h^2 r^k dr, k = 0, 1, 2, at c_m = 1 [kg, kg m, kg m2].
        added_width: (3,) the same of the width: water that moves with the link up and down.
        added_roll: INT rho pi/8 (a^2 - b^2)^2 dr, a = h/2, b = w/2: added roll inertia of ellipses [kg m2].
        roll_drag: INT (h^2 - w^2)^2 / 32 dr, see `mjfish.hydro.spatial_force` [m5].
        volume: INT pi/4 h w dr [m3].
        centroid: INT pi/4 h w r dr / volume [m].
        wetted: INT p dr [m2].
        height_moment: (INTERVALS + 1, 4) INT_0^r h r^k dr, k = 0..3, at r = length (j / INTERVALS)^2.
        node_height: (INTERVALS + 1,) h at the same r [m].
        width_moment, node_width: the same of the width.
        strip_r, strip_weight, strip_height, strip_width, strip_perimeter: (STRIPS,) Gauss strips [m].
        coarse_r, coarse_weight, coarse_height: (COARSE,) Gauss strips, fewer [m].
    """

    added: FloatArray
    added_width: FloatArray
    added_roll: float
    roll_drag: float
    volume: float
    centroid: float
    wetted: float
    height_moment: FloatArray
    node_height: FloatArray
    width_moment: FloatArray
    node_width: FloatArray
    strip_r: FloatArray
    strip_weight: FloatArray
    strip_height: FloatArray
    strip_width: FloatArray
    strip_perimeter: FloatArray
    coarse_r: FloatArray
    coarse_weight: FloatArray
    coarse_height: FloatArray


def perimeter(height: FloatArray, width: FloatArray) -> FloatArray:
    """Return the perimeter [m] of an ellipse, Ramanujan's first approximation, a = h/2 and b = w/2."""
    a, b = 0.5 * height, 0.5 * width
    return np.asarray(np.pi * (3.0 * (a + b) - np.sqrt((3.0 * a + b) * (a + 3.0 * b))))


def section_at(sections: Sequence[Section], station: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return height and width [m] at stations (m,) from the nose; at a step of the outline, of the piece in front."""
    ends = np.array([section.end for section in sections])
    index = np.minimum(np.searchsorted(ends + 1e-12, station), len(ends) - 1)
    height, width = np.empty_like(station), np.empty_like(station)
    for piece, section in enumerate(sections):
        here = index == piece
        s = np.clip((station[here] - section.start) / (section.end - section.start), 0.0, 1.0)
        shape = np.sqrt(1.0 - (1.0 - s) ** 2) if section.profile == "elliptic" else s
        height[here], width[here] = (a + (b - a) * shape for a, b in (section.height, section.width))
    return height, width


def outlines(fish: Fish) -> tuple[LinkOutline, ...]:
    """Return the integrals of every link, nose first."""
    return _outlines(tuple(link.length for link in fish.links), fish.sections, fish.density)


@functools.lru_cache(maxsize=64)
def _outlines(lengths: tuple[float, ...], sections: tuple[Section, ...], density: float) -> tuple[LinkOutline, ...]:
    starts = np.concatenate([[0.0], np.cumsum(lengths)])
    return tuple(outline(sections, density, a, b) for a, b in itertools.pairwise(starts))


@functools.lru_cache(maxsize=1024)
def outline(sections: tuple[Section, ...], density: float, start: float, end: float) -> LinkOutline:
    """Integrate one link between two stations [m], exact on both sides of every edge of the outline."""
    length = end - start
    nodes = length * (np.arange(INTERVALS + 1) / INTERVALS) ** 2
    inside = [section.end for section in sections if start + 1e-9 < section.end < end - 1e-9]
    edges = np.array([start, *inside, end]) - start
    breaks = np.unique(np.concatenate([nodes, edges]))
    breaks = breaks[np.concatenate([[True], np.diff(breaks) > 1e-12])]
    # Gauss points and weights (cells, points) in t with r = left + width t^2: exact at a blunt nose.
    t, width = 0.5 * (_GAUSS_POINTS + 1.0), np.diff(breaks)[:, None]
    r, weight = breaks[:-1, None] + width * t**2, width * 2.0 * t * (0.5 * _GAUSS_WEIGHTS)
    height, width = section_at(sections, start + r)
    powers = r[..., None] ** np.arange(4)
    at_nodes = np.searchsorted(breaks, nodes - 1e-12)
    node_height, node_width = section_at(sections, start + nodes)
    area = np.pi / 4.0 * weight * height * width
    volume = float(np.sum(area))
    elongation = float(np.sum(weight * (height**2 - width**2) ** 2))

    def moments(extent: FloatArray) -> FloatArray:
        cells = np.einsum("cg,cg,cgk->ck", weight, extent, powers)
        return readonly(np.concatenate([np.zeros((1, 4)), np.cumsum(cells, axis=0)])[at_nodes])

    def added(extent: FloatArray) -> FloatArray:
        return readonly(density * np.pi / 4.0 * np.einsum("cg,cg,cgk->k", weight, extent**2, powers[..., :3]))

    strip_r, strip_weight = _strips(edges, STRIPS)
    strip_height, strip_width = section_at(sections, start + strip_r)
    coarse_r, coarse_weight = _strips(edges, COARSE)
    coarse_height, _ = section_at(sections, start + coarse_r)
    return LinkOutline(
        added=added(height),
        added_width=added(width),
        added_roll=density * np.pi / 128.0 * elongation,
        roll_drag=elongation / 32.0,
        volume=volume,
        centroid=float(np.sum(area * r)) / volume,
        wetted=float(np.sum(weight * perimeter(height, width))),
        height_moment=moments(height),
        node_height=readonly(node_height),
        width_moment=moments(width),
        node_width=readonly(node_width),
        strip_r=readonly(strip_r),
        strip_weight=readonly(strip_weight),
        strip_height=readonly(strip_height),
        strip_width=readonly(strip_width),
        strip_perimeter=readonly(perimeter(strip_height, strip_width)),
        coarse_r=readonly(coarse_r),
        coarse_weight=readonly(coarse_weight),
        coarse_height=readonly(coarse_height),
    )


def _strips(edges: FloatArray, strips: int) -> tuple[FloatArray, FloatArray]:
    """Spread Gauss points over the pieces between `edges`, as evenly as they go; over all where too many."""
    if len(edges) > strips:
        edges = edges[[0, -1]]
    pieces = len(edges) - 1
    counts = [strips // pieces + (1 if piece < strips % pieces else 0) for piece in range(pieces)]
    r, weight = [], []
    for count, a, b in zip(counts, edges[:-1], edges[1:], strict=True):
        points, weights = np.polynomial.legendre.leggauss(count)
        r.append(0.5 * (a + b) + 0.5 * (b - a) * points)
        weight.append(0.5 * (b - a) * weights)
    return np.concatenate(r), np.concatenate(weight)
