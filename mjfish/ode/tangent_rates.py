"""Rates of all tangents at one instant, from one linearisation of the head-frame equation.

A tangent is the derivative of a rollout's state along one direction in the space of its inputs; arrays of tangents have
the direction as their last axis. What directions change of the links and of the parameters of loads are lists of
changes, for a coefficient is a change of one to three links in one direction.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from mjfish.hydro.force import crossflow_tangent
from mjfish.hydro.load import (
    ANSWER,
    AT_FIRST,
    AT_MEMORY,
    AT_STATEFUL,
    AT_STRIDE,
    PARAMETERS,
    PLACES,
    SLOPES,
    LoadBuffers,
    LoadTable,
    gradient_on,
)
from mjfish.hydro.load_derivatives import (
    AT_DIRECTION,
    AT_PARAMETER,
    AT_STEP,
    LoadChanges,
    parameter_derivative,
    record_derivative,
    stateful_derivatives,
)
from mjfish.numerics.arrays import FloatArray
from mjfish.numerics.compiled import merged, part
from mjfish.ode.equation import STATES, Joints, System
from mjfish.ode.linearisation import LENGTH, Linearisation, joint_trigonometry, linearise, solve, to_head

#: Rates of change, along one direction, of what the wrench of one link is linear in.
#: mass, first, added_0, added_1, second: mass, first moment, A_0, A_1, inertia about the joint.
#: munk, friction, crossflow, length: kappa, the factors of friction and of the drag across, the length.
#: direction, link: which; outline, record: where in `LinkChanges.outlines` and `.records`, -1 where nowhere.
#: step: how far the records are moved.
LINK_CHANGE = np.dtype(
    [(name, "f8") for name in ("mass", "first", "added_0", "added_1", "second", "munk", "friction", "crossflow")]
    + [("length", "f8"), ("step", "f8")]
    + [(name, "i8") for name in ("direction", "link", "outline", "record")]
)


class LinkChanges(NamedTuple):
    """What directions change of the links.

    Attributes:
        changes: (p,) `LINK_CHANGE` records.
        outlines: (g,) `LINK` records of rates, of the outlines that change.
        records: (2 r,) `LINK` records moved forward and back along their change, for loads.
    """

    changes: Any
    outlines: Any
    records: Any


class Directions(NamedTuple):
    """What k tangent directions change.

    Attributes:
        tail: (TAIL, k) of the flexible tail.
        motion: (3 joints, b) of angles, rates, accelerations of the joints in the first b directions, at one instant;
            of a run, (steps, 3, 3 joints, b).
        links: of the links.
        loads: of the parameters of loads.
        length: (links, k) of the lengths of the links.
    """

    tail: FloatArray
    motion: FloatArray
    links: LinkChanges
    loads: LoadChanges
    length: FloatArray


class TangentScratch(NamedTuple):
    """Scratch of `tangent_rates`.

    Attributes:
        linear: of the equation of motion.
        left_rates: (STATES + memory,) of the hidden states of loads.
        link_tangents: (links, PLACES, k) of u, v, w, x, y, heading, bend of the links; k = 0 where no load is stateful.
        wrench: (4, k) at the nose, and torque of the tail.
        gradients: (links, ANSWER, SLOPES) of one load that does not act yet.
    """

    linear: Linearisation
    left_rates: FloatArray
    link_tangents: FloatArray
    wrench: FloatArray
    gradients: FloatArray

    @classmethod
    def empty(cls, joints: int, states: int, loads: int, directions: int, stateful: bool) -> TangentScratch:
        """Return scratch for a fish of so many joints, states and loads; `stateful`: whether any load is."""
        links = joints + 1
        moving = (links, PLACES, directions if stateful else 0)
        shapes = (states, moving, (4, directions), (links, ANSWER, SLOPES))
        return cls(Linearisation.empty(joints, states, loads), *(np.zeros(shape) for shape in shapes))


@part
def tangent_rates(
    system: System, joints: Joints, state: FloatArray, derivative: FloatArray, tangents: FloatArray,
    directions: Directions, scratch: TangentScratch, out: FloatArray,
) -> None:  # fmt: skip
    """Write the rates of change of all tangents at one instant.

    Args:
        system, joints, state: as in `mjfish.ode.equation.derivative`, called before: the links have their velocities.
        derivative: (STATES + memory,) its answer.
        tangents: (STATES + memory, k) of the state.
        directions: at this instant.
        scratch: overwritten.
        out: (STATES + memory, k), written.
    """
    flexible = system.tail[0] > 0.0
    all_joints = directions.motion.shape[1] > 0 or directions.links.outlines.shape[0] > 0
    linear = scratch.linear
    linearise(system, joints, state, derivative, all_joints, True, linear)
    _by_state(state, tangents, flexible, linear.by_state, out)
    if flexible:
        _by_tail(state, directions.tail, linear.solver, out)
    if directions.motion.shape[1] > 0:
        _by_joints(directions.motion, flexible, linear.by_joints, out)
    for row in range(STATES, out.shape[0]):
        for k in range(out.shape[1]):
            out[row, k] = 0.0
    right = LoadBuffers(linear.output, state, linear.load_rates)
    left = LoadBuffers(linear.output, state, scratch.left_rates)
    _by_links(system, directions.links, linear, right, left, out)
    if system.loads.addresses.shape[0] > 0 and scratch.link_tangents.shape[2] > 0:
        _write_link_tangents(system, state, tangents, directions, scratch)
        _by_stateful_loads(system, state, tangents, scratch, out)  # writes gradients that are needed below
    for change in range(directions.loads.addresses.shape[0]):
        _by_load(system, directions.loads, change, scratch, right, left, out)


@merged
def _by_state(state: FloatArray, tangents: FloatArray, flexible: bool, a: FloatArray, out: FloatArray) -> None:
    """Write what tangents of the state change, row by row: each is a loop of few streams, which LLVM vectorises."""
    width = tangents.shape[1]
    for r in range(3):
        a0, a1, a2 = a[0, r], a[1, r], a[2, r]
        for k in range(width):
            out[r, k] = a0 * tangents[0, k] + a1 * tangents[1, k] + a2 * tangents[2, k]
    c, s = np.cos(state[5]), np.sin(state[5])
    turned_x = -s * state[0] - c * state[1]
    turned_y = c * state[0] - s * state[1]
    for k in range(width):
        out[3, k] = c * tangents[0, k] - s * tangents[1, k] + turned_x * tangents[5, k]
    for k in range(width):
        out[4, k] = s * tangents[0, k] + c * tangents[1, k] + turned_y * tangents[5, k]
    for k in range(width):
        out[5, k] = tangents[2, k]
    if flexible:
        for r in range(3):
            a3, a4 = a[3, r], a[4, r]
            for k in range(width):
                out[r, k] += a3 * tangents[6, k] + a4 * tangents[7, k]
        a0, a1, a2, a3, a4 = a[0, 3], a[1, 3], a[2, 3], a[3, 3], a[4, 3]
        for k in range(width):
            out[6, k] = tangents[7, k]
        for k in range(width):
            out[7, k] = a0 * tangents[0, k] + a1 * tangents[1, k] + a2 * tangents[2, k]
        for k in range(width):
            out[7, k] += a3 * tangents[6, k] + a4 * tangents[7, k]


@merged
def _by_tail(state: FloatArray, tail: FloatArray, solver: FloatArray, out: FloatArray) -> None:
    """Add what changes of the tail's stiffness and damping change."""
    a0, a1, a2, bend = solve(solver, True, 0.0, 0.0, 0.0, -1.0)
    for k in range(out.shape[1]):
        spring = tail[1, k] + tail[4, k] * abs(state[6]) + tail[3, k] * state[6] * state[6]
        torque = spring * state[6] + tail[2, k] * state[7]
        out[0, k] += a0 * torque
        out[1, k] += a1 * torque
        out[2, k] += a2 * torque
        out[7, k] += bend * torque


@merged
def _by_joints(motion: FloatArray, flexible: bool, responses: FloatArray, out: FloatArray) -> None:
    """Add what angles, rates and accelerations of the joints change."""
    joints = responses.shape[0]
    for r in range(4 if flexible else 3):
        row = 7 if r == 3 else r
        for q in range(3 * joints):
            a = responses[q % joints, q // joints, r]
            for k in range(motion.shape[1]):
                out[row, k] += a * motion[q, k]


@merged
def _by_links(
    system: System, links: LinkChanges, linear: Linearisation, right: LoadBuffers, left: LoadBuffers, out: FloatArray
) -> None:
    """Add what changes of the links change: dF - dI V', and, of a length, the joints behind."""
    n = system.links.shape[0]
    flexible = system.tail[0] > 0.0
    for p in range(links.changes.shape[0]):
        change = links.changes[p]
        i = change.link
        direction = change.direction
        link = system.links[i]
        motion = linear.links[i]
        u, v, w = motion.u, motion.v, motion.w
        au, av, aw = motion.au, motion.av, motion.aw
        momentum = change.added_0 * v + change.added_1 * w
        mass = change.mass
        coriolis = 0.0 if system.printed else change.first
        first = change.first + change.added_1
        fx = w * (mass * v + change.first * w + momentum) - change.friction * abs(u) * u - mass * au
        fy = -mass * w * u - change.crossflow * motion.drag_force - (mass + change.added_0) * av - first * aw
        mz = -u * (link.munk * momentum + coriolis * w) - change.crossflow * motion.drag_moment
        mz -= first * av + change.second * aw
        if change.munk != 0.0:
            mz -= change.munk * u * link.c_m * (link.added[0] * v + link.added[1] * w)
        if change.outline >= 0:
            outline = links.outlines[change.outline]
            f, g = crossflow_tangent(link, outline)
            fy -= 0.5 * link.density * link.c_d * f
            mz -= 0.5 * link.density * link.c_d * g
        if system.loads.addresses.shape[0] > 0 and change.record >= 0:
            moved = links.records[2 * change.record : 2 * change.record + 2]
            dx, dy, dz = record_derivative(moved, system.links, i, system.loads, change.step, right, left)
            fx += dx
            fy += dy
            mz += dz
            for k in range(system.loads.addresses.shape[0]):
                _add_memory_rates(system.loads.rows[k], i, change.step, right, left, direction, out)
        hx, hy, hz = to_head(motion, fx, fy, mz)
        _add_response(linear.solver, flexible, hx, hy, hz, mz if i == n - 1 else 0.0, direction, out)
        if change.length != 0.0 and i < n - 1:
            response = linear.by_joints[i, LENGTH]
            out[0, direction] += change.length * response[0]
            out[1, direction] += change.length * response[1]
            out[2, direction] += change.length * response[2]
            out[7, direction] += change.length * response[3]


@merged
def _by_load(
    system: System, loads: LoadChanges, change: int, scratch: TangentScratch, right: LoadBuffers, left: LoadBuffers,
    out: FloatArray,
) -> None:  # fmt: skip
    """Add what a change of the parameters of a load changes."""
    row, linear = loads.rows[2 * change], scratch.linear
    gradient, acting = loads.gradients[change], loads.acting[change]
    column = int(row[AT_PARAMETER])
    if gradient != 0 and acting < 0 and (change == 0 or loads.gradients[change - 1] != gradient):
        for i in range(system.links.shape[0]):
            gradient_on(system.links, i, gradient, row, right.state, scratch.gradients[i])
    direction = int(row[AT_DIRECTION])
    gx, gy, gz, torque = 0.0, 0.0, 0.0, 0.0
    for i in range(system.links.shape[0]):
        if gradient != 0:
            by = scratch.gradients[i] if acting < 0 else linear.load_gradients[i, acting]
            fx, fy, mz = by[0, column], by[1, column], by[2, column]
            for m in range(int(row[AT_MEMORY])):
                out[int(row[AT_FIRST]) + i * int(row[AT_STRIDE]) + m, direction] += by[3 + m, column]
        else:
            fx, fy, mz = parameter_derivative(system.links, i, loads, change, right, left)
        if row[AT_STEP] > 0.0 and gradient == 0:
            _add_memory_rates(row, i, row[AT_STEP], right, left, direction, out)
        hx, hy, hz = to_head(linear.links[i], fx, fy, mz)
        gx += hx
        gy += hy
        gz += hz
        torque = mz
    _add_response(linear.solver, system.tail[0] > 0.0, gx, gy, gz, torque, direction, out)


@merged
def _add_response(
    solver: FloatArray, flexible: bool, g0: float, g1: float, g2: float, torque: float, direction: int, out: FloatArray
) -> None:
    """Add, in one direction, the acceleration that balances a wrench at the nose and a torque of the tail."""
    a0, a1, a2, bend = solve(solver, flexible, g0, g1, g2, torque)
    out[0, direction] += a0
    out[1, direction] += a1
    out[2, direction] += a2
    out[7, direction] += bend


@merged
def _add_memory_rates(
    row: FloatArray, link: int, step: float, right: LoadBuffers, left: LoadBuffers, direction: int, out: FloatArray
) -> None:
    """Add the difference of the rates of a load's hidden states on a link."""
    memory = int(row[AT_MEMORY])
    first = int(row[AT_FIRST]) + link * int(row[AT_STRIDE])
    for k in range(first, first + memory):
        out[k, direction] += (right.rates[k] - left.rates[k]) / (2.0 * step)


@merged
def _write_link_tangents(
    system: System, state: FloatArray, tangents: FloatArray, directions: Directions, scratch: TangentScratch
) -> None:
    """Write what each direction changes of velocity and pose of the links, nose to tail."""
    links, motion, length_rate = scratch.linear.links, directions.motion, directions.length
    joints = links.shape[0] - 1
    flexible = system.tail[0] > 0.0
    heading_cos, heading_sin = np.cos(state[5]), np.sin(state[5])
    for k in range(tangents.shape[1]):
        du, dv, dw = tangents[0, k], tangents[1, k], tangents[2, k]
        dx, dy, turned = tangents[3, k], tangents[4, k], tangents[5, k]
        for i in range(joints + 1):
            if i > 0:
                j = i - 1
                front, behind = links[j], links[i]
                cj, sj = joint_trigonometry(front, behind)
                c = heading_cos * front.cos - heading_sin * front.sin
                s = heading_sin * front.cos + heading_cos * front.sin
                length, longer = system.links[j].length, length_rate[j, k]
                angle, rate = 0.0, 0.0
                if k < motion.shape[1]:
                    angle, rate = motion[j, k], motion[joints + j, k]
                if flexible and i == joints:
                    angle += tangents[6, k]
                    rate += tangents[7, k]
                dx += longer * c - length * s * turned
                dy += longer * s + length * c * turned
                sway = dv + length * dw + longer * front.w
                du, dv = cj * du + sj * sway + behind.v * angle, cj * sway - sj * du - behind.u * angle
                dw += rate
                turned += angle
            out = scratch.link_tangents[i]
            out[0, k], out[1, k], out[2, k] = du, dv, dw
            out[3, k], out[4, k], out[5, k] = -dx, -dy, turned  # the forward frame's
            out[6, k] = turned - tangents[5, k]


@part
def _by_stateful_loads(
    system: System, state: FloatArray, tangents: FloatArray, scratch: TangentScratch, out: FloatArray
) -> None:
    """Add what stateful loads do in every direction: they depend on velocity, pose and hidden states of the links."""
    rows, wrench, linear = system.loads.rows, scratch.wrench, scratch.linear
    buffers = LoadBuffers(linear.output, state, linear.load_rates)
    n = system.links.shape[0]
    width = tangents.shape[1]
    for r in range(4):
        for k in range(width):
            wrench[r, k] = 0.0
    for q in range(system.loads.addresses.shape[0]):
        if rows[q, AT_STATEFUL] != 1.0:
            continue
        memory = int(rows[q, AT_MEMORY])
        table = LoadTable(system.loads.addresses[q : q + 1], rows[q : q + 1])
        for i in range(n):
            first = int(rows[q, AT_FIRST]) + i * int(rows[q, AT_STRIDE])
            stateful_derivatives(system.links, i, table, buffers, linear.load_gradients[i, q])
            jacobian = linear.load_gradients[i, q, :, PARAMETERS:]
            link = linear.links[i]
            c, s, x, y = link.cos, link.sin, link.x, link.y
            for k in range(width):
                fx, fy, mz = 0.0, 0.0, 0.0
                for j in range(PLACES):
                    change = scratch.link_tangents[i, j, k]
                    fx += jacobian[0, j] * change
                    fy += jacobian[1, j] * change
                    mz += jacobian[2, j] * change
                    for m in range(memory):
                        out[first + m, k] += jacobian[3 + m, j] * change
                for j in range(memory):
                    change = tangents[first + j, k]
                    fx += jacobian[0, PLACES + j] * change
                    fy += jacobian[1, PLACES + j] * change
                    mz += jacobian[2, PLACES + j] * change
                    for m in range(memory):
                        out[first + m, k] += jacobian[3 + m, PLACES + j] * change
                hx = c * fx - s * fy
                hy = s * fx + c * fy
                wrench[0, k] += hx
                wrench[1, k] += hy
                wrench[2, k] += mz + x * hy - y * hx
                if i == n - 1:
                    wrench[3, k] += mz
    for k in range(width):
        flexible = system.tail[0] > 0.0
        _add_response(linear.solver, flexible, wrench[0, k], wrench[1, k], wrench[2, k], wrench[3, k], k, out)
