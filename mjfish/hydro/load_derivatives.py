"""Derivatives of loads, by central differences of second order: a load is compiled for real numbers only.

Where a load is smooth, the error is about 1e-10 of the derivative. Derivatives by velocity, pose and hidden states are
taken once, whatever the number of tangent directions. Those along a direction that changes the parameters of a load, or
what it reads of its link, are taken for each such direction.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from mjfish.hydro.load import (
    AT_FIRST,
    AT_GRADIENT,
    AT_MEMORY,
    AT_STATEFUL,
    AT_STRIDE,
    PARAMETERS,
    PLACES,
    ROW,
    LoadBuffers,
    LoadTable,
    clear_shared,
    gradient_on,
    loads_on,
)
from mjfish.numerics.arrays import FloatArray
from mjfish.numerics.compiled import part

#: Step by parameters and constants, relative to their size.
RELATIVE_STEP = 1e-5
#: Step by parameters of inactive loads, to one side.
INACTIVE_STEP = 1e-8
#: Columns behind a row of `LoadTable` in `LoadChanges`.
AT_DIRECTION, AT_STEP, AT_PARAMETER, CHANGE = ROW, ROW + 1, ROW + 2, ROW + 3
#: Relative step by velocities: shorter, as the second derivative of a power of |q| may be singular where a strip stops.
_VELOCITY_STEP = 2e-6
_LEAST_SPEED = 1e-3  # the step is not shorter than that of this speed [m/s]
_POSE_STEP = 1e-6  # [m, rad]
_LEAST_MEMORY = 1e-2  # the step is not shorter than that of this hidden state


class LoadChanges(NamedTuple):
    """What tangent directions change of the parameters of loads: q changes.

    Attributes:
        addresses: (q,) of the loads that change.
        gradients: (q,) of their gradients; 0 where there is none, or the change is not of one parameter.
        acting: (q,) their rows in the table of the loads that act; -1 where they are not among them.
        rows: (2 q, CHANGE): pairs of rows moved forward and back along a change, the tangent direction, the step, and
            the parameter. The step is negative where the load is inactive: it exerts nothing at the row itself, and one
            side is enough.
    """

    addresses: Any
    gradients: Any
    acting: Any
    rows: FloatArray


@part
def _step_of(link: Any, column: int, memory_state: float) -> Any:
    """Return the step by u, v, w, x, y, heading, bend (columns 0 to 6) or a hidden state."""
    if column < 3:
        speed = max(abs(link.u), abs(link.v), abs(link.w) * link.length, _LEAST_SPEED)
        return _VELOCITY_STEP * speed if column < 2 else _VELOCITY_STEP * speed / link.length
    return _POSE_STEP if column < PLACES else RELATIVE_STEP * max(abs(memory_state), _LEAST_MEMORY)


@part
def _move(link: Any, column: int, by: float) -> None:
    link.u += by * (column == 0)
    link.v += by * (column == 1)
    link.w += by * (column == 2)
    link.x += by * (column == 3)
    link.y += by * (column == 4)
    link.heading += by * (column == 5)
    link.bend += by * (column == 6)


@part
def velocity_derivatives(
    links: Any, index: int, table: LoadTable, velocity_only: bool, buffers: LoadBuffers, gradients: FloatArray,
    out: FloatArray,
) -> None:  # fmt: skip
    """Write into `out` (3, 3) the derivatives of the loads on a link: rows fx, fy, mz, columns u, v, w.

    By the gradients of the loads that have one.

    Args:
        links, table, velocity_only, buffers: as in `mjfish.hydro.load.loads_on`.
        index: of the link.
        gradients: (k, ANSWER, SLOPES), written: of the loads that have one, by their parameters and the motion.
        out: written.
    """
    for row in range(3):
        for column in range(3):
            out[row, column] = 0.0
    for k in range(table.addresses.shape[0]):
        row = table.rows[k]
        if row[AT_GRADIENT] != 0.0:
            if row[AT_STATEFUL] == 0.0 or (row[AT_STATEFUL] == 1.0 and not velocity_only):
                gradient_on(links, index, np.uint64(row[AT_GRADIENT]), row, buffers.state, gradients[k])
                for i in range(3):
                    for column in range(3):
                        out[i, column] += gradients[k, i, PARAMETERS + column]
        else:
            one = LoadTable(table.addresses[k : k + 1], table.rows[k : k + 1])
            _add_velocity_differences(links, index, one, velocity_only, buffers, out)


@part
def _add_velocity_differences(
    links: Any, index: int, table: LoadTable, velocity_only: bool, buffers: LoadBuffers, out: FloatArray
) -> None:
    """Add the derivatives of one load by differences."""
    link = links[index]
    u, v, w = link.u, link.v, link.w
    for column in range(3):
        h = _step_of(link, column, 0.0)
        _move(link, column, h)
        right = loads_on(links, index, index, table, velocity_only, buffers)
        link.u, link.v, link.w = u, v, w
        _move(link, column, -h)
        left = loads_on(links, index, index, table, velocity_only, buffers)
        link.u, link.v, link.w = u, v, w
        for row in range(3):
            out[row, column] += (right[row] - left[row]) / (2.0 * h)


@part
def stateful_derivatives(links: Any, index: int, table: LoadTable, buffers: LoadBuffers, out: FloatArray) -> None:
    """Write into `out` the derivatives of a stateful load on a link by motion and hidden states.

    By its gradient, which writes those by the parameters, too, or else by differences.

    Args:
        links, buffers: as in `mjfish.hydro.load.loads_on`; hidden states are moved and put back.
        index: of the link.
        table: of this load alone.
        out: (ANSWER, SLOPES), written: rows fx, fy, mz, rates of the hidden states; see `mjfish.hydro.load.load`.
    """
    if table.rows[0, AT_GRADIENT] != 0.0:
        gradient_on(links, index, np.uint64(table.rows[0, AT_GRADIENT]), table.rows[0], buffers.state, out)
        return
    link = links[index]
    state = buffers.state
    memory = int(table.rows[0, AT_MEMORY])
    first = int(table.rows[0, AT_FIRST]) + index * int(table.rows[0, AT_STRIDE])
    u, v, w, x, y, heading, bend = link.u, link.v, link.w, link.x, link.y, link.heading, link.bend
    for column in range(PLACES + memory):
        memory_state = state[first + column - PLACES] if column >= PLACES else 0.0
        h = _step_of(link, column, memory_state)
        for side in range(2):
            by = -h if side == 0 else h
            if column < PLACES:
                _move(link, column, by)
            else:
                state[first + column - PLACES] = memory_state + by
            loads_on(links, index, index, table, False, buffers)
            at = PARAMETERS + column
            for k in range(3 + memory):
                out[k, at] = buffers.output[k] if side == 0 else (buffers.output[k] - out[k, at]) / (2.0 * h)
            link.u, link.v, link.w, link.x, link.y, link.heading, link.bend = u, v, w, x, y, heading, bend
            if column >= PLACES:
                state[first + column - PLACES] = memory_state


@part
def record_derivative(
    moved: Any, links: Any, index: int, table: LoadTable, step: float, right: LoadBuffers, left: LoadBuffers
) -> tuple[float, float, float]:
    """Return the derivative of all loads on a link along a change of its record.

    Args:
        moved: (2,) the link's record moved forward and back along the change; velocity and pose are written.
        links, table: as in `mjfish.hydro.load.loads_on`.
        index: of the link.
        step: how far the records are moved.
        right, left: buffers of both sides.
    """
    link = links[index]
    for side in range(2):
        record = moved[side]
        record.u, record.v, record.w = link.u, link.v, link.w
        record.x, record.y, record.heading, record.bend = link.x, link.y, link.heading, link.bend
    clear_shared(table.rows, right.rates)
    clear_shared(table.rows, left.rates)
    right_x, right_y, right_z = loads_on(moved, 0, index, table, False, right)
    left_x, left_y, left_z = loads_on(moved, 1, index, table, False, left)
    scale = 0.5 / step
    return scale * (right_x - left_x), scale * (right_y - left_y), scale * (right_z - left_z)


@part
def parameter_derivative(
    links: Any, index: int, changes: LoadChanges, change: int, right: LoadBuffers, left: LoadBuffers
) -> tuple[float, float, float]:
    """Return the derivative of one load on a link along a change of its parameters.

    Args:
        links: as in `mjfish.hydro.load.loads_on`.
        index: of the link.
        changes: of the parameters.
        change: which of them.
        right, left: buffers of both sides.
    """
    address, row = changes.addresses[change : change + 1], 2 * change
    step = changes.rows[row, AT_STEP]
    forward, back = LoadTable(address, changes.rows[row : row + 1]), LoadTable(address, changes.rows[row + 1 : row + 2])
    clear_shared(forward.rows, right.rates)
    clear_shared(forward.rows, left.rates)
    right_x, right_y, right_z = loads_on(links, index, index, forward, False, right)
    if step < 0.0:
        return right_x / -step, right_y / -step, right_z / -step
    left_x, left_y, left_z = loads_on(links, index, index, back, False, left)
    scale = 0.5 / step
    return scale * (right_x - left_x), scale * (right_y - left_y), scale * (right_z - left_z)
