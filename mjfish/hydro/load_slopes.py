"""Derivatives of loads: a load is compiled for real numbers and is nobody's to differentiate but by differences.

Central differences of second order: where the load is smooth, their error is about 1e-10 of the derivative. A load is
called once a side for each velocity, whatever the number of lanes, and for each lane that moves its parameters or what
it reads of its link; a special one also for place and memory.
"""

from __future__ import annotations

from typing import Any

from mjfish.arrays import FloatArray
from mjfish.compiled import compiled
from mjfish.hydro.load import AT_FIRST, AT_MEMORY, ROW, loads_on

#: Reach of a difference by parameters and constants, relative to what is moved.
REACH = 1e-5
#: By parameters of silent loads, to one side.
REACH_SILENT = 1e-8
#: And by velocities: shorter, for the second derivative of a power of |q| may be singular where a strip stops.
_STEP = 2e-6
_SLOWEST = 1e-3  # velocities below this are moved as if they were this [m/s]
_PLACE = 1e-6  # [m, rad]
_LEAST = 1e-2  # memories below this are moved as if they were this


@compiled
def _reach(link: Any, column: int, remembered: float) -> Any:
    """Return how far to move u, v, w, x, y, heading or a memory."""
    if column < 3:
        speed = max(abs(link.u), abs(link.v), abs(link.w) * link.length, _SLOWEST)
        return _STEP * speed if column < 2 else _STEP * speed / link.length
    return _PLACE if column < 6 else REACH * max(abs(remembered), _LEAST)


@compiled
def _move(link: Any, column: int, by: float) -> None:
    if column == 0:
        link.u += by
    elif column == 1:
        link.v += by
    elif column == 2:
        link.w += by
    elif column == 3:
        link.x += by
    elif column == 4:
        link.y += by
    else:
        link.heading += by


@compiled
def velocity_slopes(
    links: Any, index: int, addresses: Any, rows: FloatArray, plain: bool, force: FloatArray, state: FloatArray,
    rates: FloatArray, out: FloatArray,
) -> None:  # fmt: skip
    """Write into `out` (3, 3) the derivatives of all loads, or the plain ones: rows fx, fy, mz, columns u, v, w.

    Args:
        links, index, addresses, rows, plain, force, state: as in `mjfish.hydro.load.loads_on`.
        rates: scratch.
        out: written.
    """
    link = links[index]
    for column in range(3):
        h = _reach(link, column, 0.0)
        u, v, w = link.u, link.v, link.w
        _move(link, column, h)
        right_x, right_y, right_z = loads_on(links, index, index, addresses, rows, plain, force, state, rates)
        link.u, link.v, link.w = u, v, w
        _move(link, column, -h)
        left_x, left_y, left_z = loads_on(links, index, index, addresses, rows, plain, force, state, rates)
        link.u, link.v, link.w = u, v, w
        out[0, column] = (right_x - left_x) / (2.0 * h)
        out[1, column] = (right_y - left_y) / (2.0 * h)
        out[2, column] = (right_z - left_z) / (2.0 * h)


@compiled
def special_slopes(
    links: Any, index: int, one: Any, row: FloatArray, force: FloatArray, state: FloatArray, rates: FloatArray,
    out: FloatArray,
) -> None:  # fmt: skip
    """Write into `out` the derivatives of a special load on a link.

    Args:
        links, index, force: as in `mjfish.hydro.load.loads_on`.
        one, row: (1,), (1, ROW) address and row of the load.
        state: hidden states in it are moved and put back.
        rates: scratch.
        out: (ANSWER, 6 + MEMORY), written: rows fx, fy, mz and the rates of its memory, columns u, v, w, x, y, heading
            and its memory.
    """
    link = links[index]
    memory = int(row[0, AT_MEMORY])
    first = int(row[0, AT_FIRST]) + index * memory
    u, v, w, x, y, heading = link.u, link.v, link.w, link.x, link.y, link.heading
    for column in range(6 + memory):
        kept = state[first + column - 6] if column >= 6 else 0.0
        h = _reach(link, column, kept)
        for side in range(2):
            by = -h if side == 0 else h
            if column < 6:
                _move(link, column, by)
            else:
                state[first + column - 6] = kept + by
            loads_on(links, index, index, one, row, False, force, state, rates)
            for k in range(3 + memory):
                out[k, column] = force[k] if side == 0 else (force[k] - out[k, column]) / (2.0 * h)
            link.u, link.v, link.w, link.x, link.y, link.heading = u, v, w, x, y, heading
            if column >= 6:
                state[first + column - 6] = kept


@compiled
def moved_records(
    moved: Any, index: int, links: Any, link: int, addresses: Any, rows: FloatArray, reach: float, force: FloatArray,
    state: FloatArray, right: FloatArray, left: FloatArray,
) -> tuple[float, float, float]:  # fmt: skip
    """Return the derivative of all loads along a change of a link's record.

    Args:
        moved: records; the pair at 2 `index` is the link's, moved by + and - `reach` along the change.
        index: of the change.
        links, link: the records as they are, and which it is.
        addresses, rows, force, state: as in `mjfish.hydro.load.loads_on`.
        reach: see `moved`.
        right, left: rates of the memory are written in here, of both sides.
    """
    right_x, right_y, right_z = _moved(moved, 2 * index, links, link, addresses, rows, force, state, right)
    left_x, left_y, left_z = _moved(moved, 2 * index + 1, links, link, addresses, rows, force, state, left)
    scale = 0.5 / reach
    return scale * (right_x - left_x), scale * (right_y - left_y), scale * (right_z - left_z)


@compiled
def _moved(
    moved: Any, at: int, links: Any, index: int, addresses: Any, rows: FloatArray, force: FloatArray, state: FloatArray,
    rates: FloatArray,
) -> tuple[float, float, float]:  # fmt: skip
    """Return all loads on one of the moved records, at the velocity and place of the link."""
    one = moved[at]
    link = links[index]
    one.u, one.v, one.w = link.u, link.v, link.w
    one.x, one.y, one.heading = link.x, link.y, link.heading
    return loads_on(moved, at, index, addresses, rows, False, force, state, rates)


@compiled
def moved_parameters(
    links: Any, index: int, addresses: Any, moved: FloatArray, which: int, force: FloatArray, state: FloatArray,
    right: FloatArray, left: FloatArray,
) -> tuple[float, float, float]:  # fmt: skip
    """Return the derivative of one load along a change of its parameters.

    Args:
        links, index, force, state: as in `mjfish.hydro.load.loads_on`.
        addresses: (q,) of the loads that change.
        moved: (2 q, ROW + 2): rows moved to both sides along each change; lane; how far, negative where the load is
            silent: it exerts nothing where it is, and the one side is enough.
        which: of the q changes.
        right, left: rates of the memory are written in here, of both sides.
    """
    one = addresses[which : which + 1]
    at = 2 * which
    reach = moved[at, ROW + 1]
    right_x, right_y, right_z = loads_on(links, index, index, one, moved[at : at + 1], False, force, state, right)
    if reach < 0.0:
        return right_x / -reach, right_y / -reach, right_z / -reach
    left_x, left_y, left_z = loads_on(links, index, index, one, moved[at + 1 : at + 2], False, force, state, left)
    scale = 0.5 / reach
    return scale * (right_x - left_x), scale * (right_y - left_y), scale * (right_z - left_z)
