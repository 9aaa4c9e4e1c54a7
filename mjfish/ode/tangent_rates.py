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
)
from mjfish.hydro.load_derivatives import LoadChanges, gradient_on, loads_alone
from mjfish.numerics.arrays import FloatArray
from mjfish.numerics.compiled import merged, part
from mjfish.ode.equation import STATES, Joints, System
from mjfish.ode.linearisation import LENGTH, Linearisation, joint_trigonometry, linearise, solve, to_head

#: Rates of change, along one direction, of what the wrench of one link is linear in.
#: mass, first, added_0, added_1, second: mass, first moment, A_0, A_1, inertia about the joint.
#: munk, friction, crossflow, length: kappa, the factors of friction and of the drag across, the length.
#: direction, link: which; outline, record: where in `LinkChanges.outlines` and `.records`, -1 where nowhere.
#: step: how far the record is moved.
LINK_CHANGE = np.dtype(
    [(name, "f8") for name in ("mass", "first", "added_0", "added_1", "second", "munk", "friction", "crossflow")]
    + [("length", "f8"), ("step", "f8")]
    + [(name, "i8") for name in ("direction", "link", "outline", "record")]
)


class LinkChanges(NamedTuple):
    """What directions change of the links.

    Attributes:
        changes: (p,) `LINK_CHANGE` records, link by link.
        outlines: (g,) `LINK` records of rates, of the outlines that change.
        records: (r,) `LINK` records moved along their change, for loads.
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
        load_rates: (STATES + memory,) of the hidden states of loads.
        link_tangents: (links, PLACES, k) of u, v, w, x, y, heading, bend of the links; k = 0 where no load is stateful.
        wrench: (7, k) at the nose, torque of the tail, and wrench on one link.
        gradients: (links, ANSWER, SLOPES) of one load that does not act yet.
    """

    linear: Linearisation
    load_rates: FloatArray
    link_tangents: FloatArray
    wrench: FloatArray
    gradients: FloatArray

    @classmethod
    def empty(cls, joints: int, states: int, loads: int, directions: int, stateful: bool) -> TangentScratch:
        """Return scratch for a fish of so many joints, states and loads; `stateful`: whether any load is."""
        links = joints + 1
        moving = (links, PLACES, directions if stateful else 0)
        shapes = (states, moving, (7, directions), (links, ANSWER, SLOPES))
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
    there = LoadBuffers(linear.output, state, linear.load_rates)
    here = LoadBuffers(linear.output, state, scratch.load_rates)
    _by_links(system, directions.links, linear, there, here, out)
    if system.loads.addresses.shape[0] > 0 and scratch.link_tangents.shape[2] > 0:
        _write_link_tangents(system, state, tangents, directions, scratch)
        _by_stateful_loads(system, state, tangents, scratch, out)  # writes gradients that are needed below
    _by_loads(system, state, directions.loads, scratch, out)


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
    system: System, links: LinkChanges, linear: Linearisation, there: LoadBuffers, here: LoadBuffers, out: FloatArray
) -> None:
    """Add what changes of the links change: dF - dI V', and, of a length, the joints behind."""
    n = system.links.shape[0]
    flexible = system.tail[0] > 0.0
    last, base = -1, (0.0, 0.0, 0.0)  # the loads on the link of the last change
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
            if i != last:
                last, base = i, loads_alone(system.links, i, system.links, i, system.loads, here)
            moved = loads_alone(links.records, change.record, system.links, i, system.loads, there)
            fx += (moved[0] - base[0]) / change.step
            fy += (moved[1] - base[1]) / change.step
            mz += (moved[2] - base[2]) / change.step
            for k in range(system.loads.addresses.shape[0]):
                row = system.loads.rows[k]
                first = int(row[AT_FIRST]) + i * int(row[AT_STRIDE])
                for m in range(first, first + int(row[AT_MEMORY])):
                    out[m, direction] += (there.rates[m] - here.rates[m]) / change.step
        hx, hy, hz = to_head(motion, fx, fy, mz)
        _add_response(linear.solver, flexible, hx, hy, hz, mz if i == n - 1 else 0.0, direction, out)
        if change.length != 0.0 and i < n - 1:
            response = linear.by_joints[i, LENGTH]
            out[0, direction] += change.length * response[0]
            out[1, direction] += change.length * response[1]
            out[2, direction] += change.length * response[2]
            out[7, direction] += change.length * response[3]


@merged
def _by_loads(system: System, state: FloatArray, loads: LoadChanges, scratch: TangentScratch, out: FloatArray) -> None:
    """Add what changes of the parameters of loads change; hidden states of inactive loads need no tangents."""
    linear, links, last = scratch.linear, system.links, -1
    for p in range(loads.changes.shape[0]):
        change = loads.changes[p]
        k, column, rate = change.load, change.column, change.rate
        row, active = system.loads.rows[k], k < loads.active
        if not active and k != last:
            for i in range(links.shape[0]):
                gradient_on(links, i, loads.addresses[k], row, False, state, linear.answers, scratch.gradients[i])
        last = k
        gx, gy, gz, torque = 0.0, 0.0, 0.0, 0.0
        for i in range(links.shape[0]):
            by = linear.load_gradients[i, k] if active else scratch.gradients[i]
            hx, hy, hz = to_head(linear.links[i], by[0, column], by[1, column], by[2, column])
            gx += rate * hx
            gy += rate * hy
            gz += rate * hz
            torque = rate * by[2, column]
            first = int(row[AT_FIRST]) + i * int(row[AT_STRIDE])
            for m in range(int(row[AT_MEMORY]) if active else 0):
                out[first + m, change.direction] += rate * by[3 + m, column]
        _add_response(linear.solver, system.tail[0] > 0.0, gx, gy, gz, torque, change.direction, out)


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
def _write_link_tangents(
    system: System, state: FloatArray, tangents: FloatArray, directions: Directions, scratch: TangentScratch
) -> None:
    """Write what each direction changes of velocity and pose of the links, nose to tail; loops as in `_by_state`."""
    links, motion, length_rate = scratch.linear.links, directions.motion, directions.length
    joints, width = links.shape[0] - 1, tangents.shape[1]
    flexible = system.tail[0] > 0.0
    heading_cos, heading_sin = np.cos(state[5]), np.sin(state[5])
    head = scratch.link_tangents[0]
    for k in range(width):
        head[0, k], head[1, k], head[2, k] = tangents[0, k], tangents[1, k], tangents[2, k]
    for k in range(width):
        head[3, k], head[4, k] = -tangents[3, k], -tangents[4, k]  # the forward frame's
        head[5, k], head[6, k] = tangents[5, k], 0.0
    for j in range(joints):
        front, behind = links[j], links[j + 1]
        cj, sj = joint_trigonometry(front, behind)
        c = heading_cos * front.cos - heading_sin * front.sin
        s = heading_sin * front.cos + heading_cos * front.sin
        length, w, u, v = system.links[j].length, front.w, behind.u, behind.v
        here, out = scratch.link_tangents[j], scratch.link_tangents[j + 1]
        for k in range(width):
            longer, turned = length_rate[j, k], here[5, k]
            out[3, k] = here[3, k] - longer * c + length * s * turned
            out[4, k] = here[4, k] - longer * s - length * c * turned
        for k in range(width):
            sway = here[1, k] + length * here[2, k] + length_rate[j, k] * w
            out[0, k], out[1, k] = cj * here[0, k] + sj * sway, cj * sway - sj * here[0, k]
        for k in range(width):
            out[2, k], out[5, k], out[6, k] = here[2, k], here[5, k], here[6, k]
        for k in range(motion.shape[1]):
            _turn(out, k, u, v, motion[j, k], motion[joints + j, k])
        if flexible and j == joints - 1:
            for k in range(width):
                _turn(out, k, u, v, tangents[6, k], tangents[7, k])


@merged
def _turn(out: FloatArray, k: int, u: float, v: float, angle: float, rate: float) -> None:
    """Add what angle and rate of the joint in front of a link, whose velocity is (u, v), change in direction k."""
    out[0, k] += v * angle
    out[1, k] -= u * angle
    out[2, k] += rate
    out[5, k] += angle
    out[6, k] += angle


@part
def _by_stateful_loads(
    system: System, state: FloatArray, tangents: FloatArray, scratch: TangentScratch, out: FloatArray
) -> None:
    """Add what stateful loads do in every direction: they depend on velocity, pose and hidden states of the links."""
    rows, wrench, linear = system.loads.rows, scratch.wrench, scratch.linear
    n, width = system.links.shape[0], tangents.shape[1]
    head, force = wrench[:4], wrench[4:]
    for k in range(width):
        head[0, k], head[1, k], head[2, k], head[3, k] = 0.0, 0.0, 0.0, 0.0
    for q in range(system.loads.addresses.shape[0]):
        if rows[q, AT_STATEFUL] != 1.0:
            continue
        memory = int(rows[q, AT_MEMORY])
        for i in range(n):
            first = int(rows[q, AT_FIRST]) + i * int(rows[q, AT_STRIDE])
            gradient = linear.load_gradients[i, q]
            gradient_on(system.links, i, system.loads.addresses[q], rows[q], True, state, linear.answers, gradient)
            for r in range(3):
                for k in range(width):
                    force[r, k] = 0.0
            for r in range(3 + memory):
                row = force[r] if r < 3 else out[first + r - 3]
                for j in range(PLACES):
                    _add(gradient[r, PARAMETERS + j], scratch.link_tangents[i, j], row)
                for j in range(memory):
                    _add(gradient[r, PARAMETERS + PLACES + j], tangents[first + j], row)
            link = linear.links[i]
            c, s, x, y = link.cos, link.sin, link.x, link.y
            for k in range(width):
                hx = c * force[0, k] - s * force[1, k]
                hy = s * force[0, k] + c * force[1, k]
                head[0, k] += hx
                head[1, k] += hy
                head[2, k] += force[2, k] + x * hy - y * hx
            if i == n - 1:
                _add(1.0, force[2], head[3])
    flexible = system.tail[0] > 0.0
    for k in range(width):
        _add_response(linear.solver, flexible, head[0, k], head[1, k], head[2, k], head[3, k], k, out)


@merged
def _add(factor: float, row: FloatArray, out: FloatArray) -> None:
    """Add a multiple of a row; most derivatives are zero."""
    if factor != 0.0:
        for k in range(row.shape[0]):
            out[k] += factor * row[k]
