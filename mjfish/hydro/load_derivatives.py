"""Derivatives of loads: by the gradient that a load has, else by differences to one side.

A load is compiled for real numbers only. Where it is smooth, the error of a difference is about its step, 2e-8 of the
derivative. Only what the load reads is moved.
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
    AT_WANTED,
    PARAMETERS,
    PLACES,
    LoadBuffers,
    LoadTable,
    call,
    clear_shared,
    loads_on,
)
from mjfish.numerics.arrays import FloatArray
from mjfish.numerics.compiled import part

#: Steps relative to the size of what is moved, and by parameters of inactive loads.
RELATIVE_STEP, _INACTIVE_STEP = 2e-8, 1e-8
_POSE_STEP = 2e-8  # [m, rad]
_LEAST_PARAMETER = 0.1  # the step is not shorter than that of this parameter
_LEAST_SPEED = 1e-3  # nor than that of this speed [m/s],
_LEAST_MEMORY = 1e-2  # or of this hidden state
#: A change of one parameter of a load along a tangent direction: rate of change.
LOAD_CHANGE = np.dtype([("direction", "i8"), ("load", "i8"), ("column", "i8"), ("rate", "f8")])


class LoadChanges(NamedTuple):
    """What tangent directions change of the parameters of loads.

    Attributes:
        changes: (q,) `LOAD_CHANGE` records, load by load.
        addresses: (k,) of all loads.
        active: how many of them, the first, exert something.
    """

    changes: Any
    addresses: Any
    active: int


@part
def _move(link: Any, column: int) -> float:
    """Move one number of the motion, column of `mjfish.hydro.load.MOTION`, a step on; return the step."""
    h = _POSE_STEP
    if column < 3:
        speed = max(abs(link.u), abs(link.v), abs(link.w) * link.length, _LEAST_SPEED)
        h = RELATIVE_STEP * speed if column < 2 else RELATIVE_STEP * speed / link.length
    link.u += h * (column == 0)
    link.v += h * (column == 1)
    link.w += h * (column == 2)
    link.x += h * (column == 3)
    link.y += h * (column == 4)
    link.heading += h * (column == 5)
    link.bend += h * (column == 6)
    return h


@part
def gradient_on(
    links: Any, index: int, address: Any, row: FloatArray, active: bool, state: Any, answers: FloatArray,
    out: FloatArray,
) -> None:  # fmt: skip
    """Write the derivatives of what one load returns on a link by its parameters, the motion and its hidden states.

    Args:
        links: `LINK` records.
        index: of the link.
        address: of the load.
        row: of a `LoadTable`; moved and put back.
        active: whether it exerts something; else it returns no force at `row`, and derivatives by parameters alone are
            asked for.
        state: (STATES + hidden,) with the hidden states.
        answers: (2, ANSWER) scratch.
        out: (ANSWER, SLOPES), written as far as the load answers and as AT_WANTED asks; see `mjfish.hydro.load.load`.
    """
    link, memory = links[index], int(row[AT_MEMORY])
    first = int(row[AT_FIRST]) + index * int(row[AT_STRIDE])
    for m in range(memory):
        link.memory[m] = state[first + m]
    if row[AT_GRADIENT] != 0.0:
        call(np.uint64(row[AT_GRADIENT]), links, index, row, out)
        return
    base, there = answers[0], answers[1]
    for k in range(3 + memory):
        base[k] = 0.0
    if active:
        call(address, links, index, row, base)
    wanted = int(row[AT_WANTED])
    u, v, w, x, y, heading, bend = link.u, link.v, link.w, link.x, link.y, link.heading, link.bend
    for column in range(PARAMETERS + PLACES + memory if active else PARAMETERS):
        m = column - PARAMETERS - PLACES
        if m < 0 and not (wanted >> column) & 1:
            continue
        parameter = row[column]
        if column < PARAMETERS:
            h = RELATIVE_STEP * max(abs(parameter), _LEAST_PARAMETER) if active else _INACTIVE_STEP
            row[column] = parameter + h
        elif m < 0:
            h = _move(link, column - PARAMETERS)
        else:
            h = RELATIVE_STEP * max(abs(state[first + m]), _LEAST_MEMORY)
            link.memory[m] = state[first + m] + h
        call(address, links, index, row, there)
        for k in range(3 + memory):
            out[k, column] = (there[k] - base[k]) / h
        if column < PARAMETERS:
            row[column] = parameter
        elif m < 0:
            link.u, link.v, link.w, link.x, link.y, link.heading, link.bend = u, v, w, x, y, heading, bend
        else:
            link.memory[m] = state[first + m]


@part
def velocity_derivatives(
    links: Any, index: int, table: LoadTable, velocity_only: bool, state: Any, answers: FloatArray,
    gradients: FloatArray, out: FloatArray,
) -> None:  # fmt: skip
    """Write into `out` (3, 3) the derivatives of the loads on a link: rows fx, fy, mz, columns u, v, w.

    Args:
        links, table, velocity_only: as in `mjfish.hydro.load.loads_on`.
        index, state, answers: as in `gradient_on`.
        gradients: (k, ANSWER, SLOPES), written, as in `gradient_on`.
        out: written.
    """
    for row in range(3):
        for column in range(3):
            out[row, column] = 0.0
    for k in range(table.addresses.shape[0]):
        kind = table.rows[k, AT_STATEFUL]
        if kind == 0.0 or (kind == 1.0 and not velocity_only):
            gradient_on(links, index, table.addresses[k], table.rows[k], True, state, answers, gradients[k])
            for i in range(3):
                for column in range(3):
                    out[i, column] += gradients[k, i, PARAMETERS + column]


@part
def loads_alone(
    records: Any, record: int, links: Any, index: int, table: LoadTable, buffers: LoadBuffers
) -> tuple[float, float, float]:
    """Return all loads on a link by another record of it, and what this link alone adds to rates that are shared.

    Args:
        records: `LINK` records.
        record: index of that to use; velocity and pose are written.
        links, table, buffers: as in `mjfish.hydro.load.loads_on`.
        index: of the link.
    """
    link, moved = links[index], records[record]
    moved.u, moved.v, moved.w = link.u, link.v, link.w
    moved.x, moved.y, moved.heading, moved.bend = link.x, link.y, link.heading, link.bend
    clear_shared(table.rows, buffers.rates)
    return loads_on(records, record, index, table, False, buffers)
