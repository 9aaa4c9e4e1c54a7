"""Derivatives of loads: a load is compiled for real numbers and is nobody's to differentiate but by differences.

Central differences of second order: where the load is smooth, their error is about 1e-10 of the derivative. A load is
called once a side for each velocity, whatever the number of lanes, and for each lane that moves its parameters or what
it reads of its link.
"""

from __future__ import annotations

from typing import Any

from mjfish.arrays import FloatArray
from mjfish.compiled import compiled
from mjfish.hydro.load import PARAMETERS, apply_loads

#: Reach of a difference by parameters and constants, relative to what is moved.
REACH = 1e-5
#: And by velocities: shorter, for the second derivative of a power of |q| may be singular where a strip stops.
_STEP = 2e-6
_SLOWEST = 1e-3  # velocities below this are moved as if they were this [m/s]


@compiled
def velocity_slopes(
    links: Any, index: int, addresses: Any, parameters: FloatArray, force: FloatArray, out: FloatArray
) -> None:
    """Write into `out` (3, 3) the derivatives of all loads on a link: rows fx, fy, mz, columns u, v, w.

    Args:
        links, index, addresses, parameters, force: as in `mjfish.hydro.load.apply_loads`.
        out: written.
    """
    link = links[index]
    speed = max(abs(link.u), abs(link.v), abs(link.w) * link.length, _SLOWEST)
    for column in range(3):
        h = _STEP * speed
        u = link.u
        v = link.v
        w = link.w
        if column == 0:
            link.u = u + h
        elif column == 1:
            link.v = v + h
        else:
            h /= link.length
            link.w = w + h
        right_x, right_y, right_z = apply_loads(links, index, addresses, parameters, force)
        link.u = u - (link.u - u)
        link.v = v - (link.v - v)
        link.w = w - (link.w - w)
        left_x, left_y, left_z = apply_loads(links, index, addresses, parameters, force)
        link.u = u
        link.v = v
        link.w = w
        out[0, column] = (right_x - left_x) / (2.0 * h)
        out[1, column] = (right_y - left_y) / (2.0 * h)
        out[2, column] = (right_z - left_z) / (2.0 * h)


@compiled
def moved_records(
    moved: Any, index: int, link: Any, addresses: Any, parameters: FloatArray, reach: float, force: FloatArray
) -> tuple[float, float, float]:
    """Return the derivative of all loads along a change of a link's record.

    Args:
        moved: records; the pair at 2 `index` is the link's, moved by + and - `reach` along the change.
        index: of the change.
        link: the record as it is, for its velocity.
        addresses, parameters, force: as in `mjfish.hydro.load.apply_loads`.
        reach: see `moved`.
    """
    right_x, right_y, right_z = _moved(moved, 2 * index, link, addresses, parameters, force)
    left_x, left_y, left_z = _moved(moved, 2 * index + 1, link, addresses, parameters, force)
    scale = 0.5 / reach
    return scale * (right_x - left_x), scale * (right_y - left_y), scale * (right_z - left_z)


@compiled
def _moved(
    moved: Any, index: int, link: Any, addresses: Any, parameters: FloatArray, force: FloatArray
) -> tuple[float, float, float]:
    """Return all loads on one of the moved records, at the velocity of the link."""
    one = moved[index]
    one.u = link.u
    one.v = link.v
    one.w = link.w
    return apply_loads(moved, index, addresses, parameters, force)


@compiled
def moved_parameters(
    links: Any, index: int, addresses: Any, moved: FloatArray, which: int, force: FloatArray
) -> tuple[float, float, float]:
    """Return the derivative of one load along a change of its parameters.

    Args:
        links, index, force: as in `mjfish.hydro.load.apply_loads`.
        addresses: (q,) of the loads that change.
        moved: (2 q, PARAMETERS + 2): parameters moved to both sides along each change; lane; how far.
        which: of the q changes.
    """
    one = addresses[which : which + 1]
    right_x, right_y, right_z = apply_loads(links, index, one, moved[2 * which : 2 * which + 1], force)
    left_x, left_y, left_z = apply_loads(links, index, one, moved[2 * which + 1 : 2 * which + 2], force)
    scale = 0.5 / moved[2 * which, PARAMETERS + 1]
    return scale * (right_x - left_x), scale * (right_y - left_y), scale * (right_z - left_z)
