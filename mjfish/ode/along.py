"""Many directions at one instant: the rates of all lanes from one linearisation of the head-frame equation.

A lane is a direction in which a rollout is derived; arrays of lanes have it as their last axis. What a lane changes of
the links are `changes`, of the parameters of loads `probes`: lists, for a coefficient is a change of one to three links
in one lane.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from mjfish.arrays import FloatArray
from mjfish.compiled import borrowing, merged
from mjfish.hydro.load import AT_FIRST, AT_MEMORY, ROW
from mjfish.hydro.load_slopes import moved_parameters, moved_records
from mjfish.hydro.slopes import crossflow_along
from mjfish.ode.algebra import LENGTH, solve
from mjfish.ode.equation import STATES
from mjfish.ode.linear import gather, to_head, travel
from mjfish.ode.special import by_special, carry

#: Numbers of a change of a link: of mass, first moment, A_0, A_1, inertia about the joint, kappa, of the factors of
#: friction and of drag across, and of the length; lane, link, indices of outline and moved records (-1: none), reach.
MASS, FIRST, ADDED_0, ADDED_1, SECOND, MUNK, FRICTION, ACROSS, LONGER, LANE, LINK, OUTLINE, MOVED, REACH, CHANGE = (
    range(15)
)


@borrowing
def along(
    links: Any, cos: FloatArray, sin: FloatArray, rate: FloatArray, acceleration: FloatArray, angle_last: float,
    state: FloatArray, moved: FloatArray, lanes: FloatArray, moving: FloatArray, tail: FloatArray, slack: FloatArray,
    printed: bool, hooks: Any, hook_parameters: FloatArray, changes: FloatArray, outlines: FloatArray, records: Any,
    probes: FloatArray, probed: Any, right: FloatArray, left: FloatArray, force: FloatArray, solver: FloatArray,
    loaded: FloatArray, slopes: FloatArray, answers: FloatArray, columns: FloatArray, work: FloatArray,
    longer: FloatArray, carried: FloatArray, pushed: FloatArray, out: FloatArray,
) -> None:  # fmt: skip
    """Write the rates of change of all lanes at one instant.

    Args:
        links ... state: as in `mjfish.ode.equation.derivative`, called before: `links` have their velocities.
        moved: (STATES + hidden,) its answer.
        lanes: (STATES + hidden, k) of the state.
        moving: (3 joints, b) of angles, rates, accelerations of the joints in the first b lanes.
        tail: (3,) as in `derivative`; slack: (3, k) of it.
        printed, hooks, hook_parameters: as in `derivative`.
        changes ... probed: see `mjfish.ode.lanes`.
        right ... work: scratch; longer: see `mjfish.ode.special.carry`; carried, pushed: scratch.
        out: (STATES + hidden, k), written.
    """
    flexible = tail[0] > 0.0
    bending = moving.shape[1] > 0 or outlines.shape[0] > 0
    travel(links, cos, sin, rate, acceleration, angle_last, state, moved, flexible, work)
    gather(
        links, work, tail, printed, hooks, hook_parameters, bending, True, state, right, force, loaded, columns,
        answers, solver,
    )  # fmt: skip
    _by_state(state, lanes, flexible, answers, out)
    if flexible:
        _by_tail(state, slack, solver, out)
    if moving.shape[1] > 0:
        _by_joints(moving, flexible, columns, out)
    for row in range(STATES, out.shape[0]):
        for k in range(out.shape[1]):
            out[row, k] = 0.0
    _by_links(
        links, printed, hooks, hook_parameters, changes, outlines, records, work, flexible, columns, solver, force,
        state, right, left, out,
    )  # fmt: skip
    for q in range(probed.shape[0]):
        _by_load(links, probes, probed, q, work, flexible, solver, force, state, right, left, out)
    if hooks.shape[0] > 0 and carried.shape[2] > 0:
        carry(links, work, state, lanes, moving, longer, flexible, carried)
        by_special(
            links, hooks, hook_parameters, work, state, lanes, carried, flexible, solver, force, right, slopes, pushed,
            out,
        )  # fmt: skip


@merged
def _by_state(state: FloatArray, lanes: FloatArray, flexible: bool, a: FloatArray, out: FloatArray) -> None:
    """Write what the lanes of the state change, row by row: each is a loop of few streams, which LLVM vectorises."""
    width = lanes.shape[1]
    for r in range(3):
        a0, a1, a2 = a[0, r], a[1, r], a[2, r]
        for k in range(width):
            out[r, k] = a0 * lanes[0, k] + a1 * lanes[1, k] + a2 * lanes[2, k]
    c, s = np.cos(state[5]), np.sin(state[5])
    turned_x = -s * state[0] - c * state[1]
    turned_y = c * state[0] - s * state[1]
    for k in range(width):
        out[3, k] = c * lanes[0, k] - s * lanes[1, k] + turned_x * lanes[5, k]
    for k in range(width):
        out[4, k] = s * lanes[0, k] + c * lanes[1, k] + turned_y * lanes[5, k]
    for k in range(width):
        out[5, k] = lanes[2, k]
    if flexible:
        for r in range(3):
            a3, a4 = a[3, r], a[4, r]
            for k in range(width):
                out[r, k] += a3 * lanes[6, k] + a4 * lanes[7, k]
        a0, a1, a2, a3, a4 = a[0, 3], a[1, 3], a[2, 3], a[3, 3], a[4, 3]
        for k in range(width):
            out[6, k] = lanes[7, k]
        for k in range(width):
            out[7, k] = a0 * lanes[0, k] + a1 * lanes[1, k] + a2 * lanes[2, k]
        for k in range(width):
            out[7, k] += a3 * lanes[6, k] + a4 * lanes[7, k]


@merged
def _by_tail(state: FloatArray, slack: FloatArray, solver: FloatArray, out: FloatArray) -> None:
    """Add what a change of the tail's stiffness and damping changes."""
    a0, a1, a2, bend = solve(solver, True, 0.0, 0.0, 0.0, -1.0)
    for k in range(out.shape[1]):
        torque = slack[1, k] * state[6] + slack[2, k] * state[7]
        out[0, k] += a0 * torque
        out[1, k] += a1 * torque
        out[2, k] += a2 * torque
        out[7, k] += bend * torque


@merged
def _by_joints(moving: FloatArray, flexible: bool, columns: FloatArray, out: FloatArray) -> None:
    """Add what angles, rates and accelerations of the joints change."""
    joints = columns.shape[0]
    width = moving.shape[1]
    for r in range(4 if flexible else 3):
        row = 7 if r == 3 else r
        for q in range(3 * joints):
            a = columns[q % joints, q // joints, r]
            for k in range(width):
                out[row, k] += a * moving[q, k]


@merged
def _by_links(
    links: Any, printed: bool, hooks: Any, hook_parameters: FloatArray, changes: FloatArray, outlines: FloatArray,
    records: Any, kept: FloatArray, flexible: bool, columns: FloatArray, solver: FloatArray, force: FloatArray,
    state: FloatArray, right: FloatArray, left: FloatArray, out: FloatArray,
) -> None:  # fmt: skip
    """Add what changes of the links change: dF - dI V', and, of a length, the joints behind."""
    n = links.shape[0]
    for p in range(changes.shape[0]):
        i = int(changes[p, LINK])
        link = links[i]
        u, v, w = kept[i, 0], kept[i, 1], kept[i, 2]
        au, av, aw = kept[i, 3], kept[i, 4], kept[i, 5]
        across = changes[p, ADDED_0] * v + changes[p, ADDED_1] * w
        mass = changes[p, MASS]
        coriolis = 0.0 if printed else changes[p, FIRST]
        first = changes[p, FIRST] + changes[p, ADDED_1]
        fx = w * (mass * v + changes[p, FIRST] * w + across) - changes[p, FRICTION] * abs(u) * u - mass * au
        fy = -mass * w * u - changes[p, ACROSS] * kept[i, 10] - (mass + changes[p, ADDED_0]) * av - first * aw
        mz = -u * (link.munk * across + coriolis * w) - changes[p, ACROSS] * kept[i, 11]
        mz -= first * av + changes[p, SECOND] * aw
        if changes[p, MUNK] != 0.0:
            mz -= changes[p, MUNK] * u * link.c_m * (link.added[0] * v + link.added[1] * w)
        if changes[p, OUTLINE] >= 0.0:
            k = int(changes[p, OUTLINE])
            more = outlines[k]
            f, g = crossflow_along(
                v, w, link.length, link.node_height, link.height_moment, changes[p, LONGER], more[:, 0], more[:, 1:]
            )  # fmt: skip
            fy -= 0.5 * link.density * link.c_d * f
            mz -= 0.5 * link.density * link.c_d * g
        if hooks.shape[0] > 0 and changes[p, MOVED] >= 0.0:
            dx, dy, dz = moved_records(
                records, int(changes[p, MOVED]), links, i, hooks, hook_parameters, changes[p, REACH], force, state,
                right, left,
            )  # fmt: skip
            fx += dx
            fy += dy
            mz += dz
            for k in range(hooks.shape[0]):
                _remember(hook_parameters, k, i, changes[p, REACH], right, left, int(changes[p, LANE]), out)
        hx, hy, hz = to_head(kept, i, fx, fy, mz)
        a0, a1, a2, bend = solve(solver, flexible, hx, hy, hz, mz if i == n - 1 else 0.0)
        longer = changes[p, LONGER]
        if longer != 0.0 and i < n - 1:
            a0 += longer * columns[i, LENGTH, 0]
            a1 += longer * columns[i, LENGTH, 1]
            a2 += longer * columns[i, LENGTH, 2]
            bend += longer * columns[i, LENGTH, 3]
        lane = int(changes[p, LANE])
        out[0, lane] += a0
        out[1, lane] += a1
        out[2, lane] += a2
        out[7, lane] += bend


@merged
def _by_load(
    links: Any, probes: FloatArray, probed: Any, q: int, kept: FloatArray, flexible: bool, solver: FloatArray,
    force: FloatArray, state: FloatArray, right: FloatArray, left: FloatArray, out: FloatArray,
) -> None:  # fmt: skip
    """Add what a change of the parameters of a load changes."""
    gx, gy, gz, torque = 0.0, 0.0, 0.0, 0.0
    for i in range(links.shape[0]):
        fx, fy, mz = moved_parameters(links, i, probed, probes, q, force, state, right, left)
        if probes[2 * q, ROW + 1] > 0.0:
            _remember(probes, 2 * q, i, probes[2 * q, ROW + 1], right, left, int(probes[2 * q, ROW]), out)
        hx, hy, hz = to_head(kept, i, fx, fy, mz)
        gx += hx
        gy += hy
        gz += hz
        torque = mz
    a0, a1, a2, bend = solve(solver, flexible, gx, gy, gz, torque)
    lane = int(probes[2 * q, ROW])
    out[0, lane] += a0
    out[1, lane] += a1
    out[2, lane] += a2
    out[7, lane] += bend


@merged
def _remember(
    rows: FloatArray, row: int, link: int, reach: float, right: FloatArray, left: FloatArray, lane: int, out: FloatArray
) -> None:
    """Add the difference of the rates of a load's memory on a link."""
    memory = int(rows[row, AT_MEMORY])
    first = int(rows[row, AT_FIRST]) + link * memory
    for k in range(first, first + memory):
        out[k, lane] += (right[k] - left[k]) / (2.0 * reach)
