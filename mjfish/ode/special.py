"""Lanes through special loads: forces that depend on the place of their link, or on a memory of their own.

What a lane does to velocity and place of each link is carried from the nose to the tail; the load's derivatives by all
of these, taken once, give forces and rates of the memory in every lane.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from mjfish.arrays import FloatArray
from mjfish.compiled import borrowing, merged
from mjfish.hydro.load import AT_FIRST, AT_MEMORY, AT_SPECIAL
from mjfish.hydro.load_slopes import special_slopes
from mjfish.ode.algebra import solve


@merged
def carry(
    links: Any, kept: FloatArray, state: FloatArray, lanes: FloatArray, moving: FloatArray, longer: FloatArray,
    flexible: bool, carried: FloatArray,
) -> None:  # fmt: skip
    """Write what each lane changes of velocity and place of the links: (n, 6, k), u, v, w, x, y, heading.

    Args:
        links, kept, state: as in `mjfish.ode.linear.gather`.
        lanes, moving, flexible: as in `mjfish.ode.along.along`.
        longer: (n, k) of the lengths of the links.
        carried: written.
    """
    n = links.shape[0]
    joints = n - 1
    bent = moving.shape[1]
    heading_cos, heading_sin = np.cos(state[5]), np.sin(state[5])
    for k in range(lanes.shape[1]):
        du, dv, dw = lanes[0, k], lanes[1, k], lanes[2, k]
        dx, dy, turned = lanes[3, k], lanes[4, k], lanes[5, k]
        for i in range(n):
            if i > 0:
                j = i - 1
                cj = kept[j, 6] * kept[i, 6] + kept[j, 7] * kept[i, 7]
                sj = kept[j, 6] * kept[i, 7] - kept[j, 7] * kept[i, 6]
                c = heading_cos * kept[j, 6] - heading_sin * kept[j, 7]
                s = heading_sin * kept[j, 6] + heading_cos * kept[j, 7]
                length = links[j].length
                angle, rate = 0.0, 0.0
                if k < bent:
                    angle, rate = moving[j, k], moving[joints + j, k]
                if flexible and i == joints:
                    angle += lanes[6, k]
                    rate += lanes[7, k]
                dx += longer[j, k] * c - length * s * turned
                dy += longer[j, k] * s + length * c * turned
                across = dv + length * dw + longer[j, k] * kept[j, 2]
                du, dv = (
                    cj * du + sj * across + kept[i, 1] * angle,
                    cj * across - sj * du - kept[i, 0] * angle,
                )
                dw += rate
                turned += angle
            carried[i, 0, k], carried[i, 1, k], carried[i, 2, k] = du, dv, dw
            carried[i, 3, k], carried[i, 4, k], carried[i, 5, k] = -dx, -dy, turned  # the forward frame's


@borrowing
def by_special(
    links: Any, hooks: Any, rows: FloatArray, kept: FloatArray, state: FloatArray, lanes: FloatArray,
    carried: FloatArray, flexible: bool, solver: FloatArray, force: FloatArray, rates: FloatArray, slopes: FloatArray,
    pushed: FloatArray, out: FloatArray,
) -> None:  # fmt: skip
    """Add what the special loads do in every lane.

    Args:
        links, hooks, rows, kept, state: as in `mjfish.ode.linear.gather`.
        lanes: (STATES + hidden, k).
        carried: (n, 6, k) of `carry`.
        flexible, solver: of `mjfish.ode.algebra.solve`.
        force, rates, slopes, pushed: (ANSWER,), (STATES + hidden,), (ANSWER, 6 + MEMORY), (4, k) scratch.
        out: (STATES + hidden, k), added to.
    """
    n = links.shape[0]
    width = lanes.shape[1]
    for r in range(4):
        for k in range(width):
            pushed[r, k] = 0.0
    for q in range(hooks.shape[0]):
        if rows[q, AT_SPECIAL] != 1.0:
            continue
        memory = int(rows[q, AT_MEMORY])
        for i in range(n):
            first = int(rows[q, AT_FIRST]) + i * memory
            special_slopes(links, i, hooks[q : q + 1], rows[q : q + 1], force, state, rates, slopes)
            c, s, x, y = kept[i, 6], kept[i, 7], kept[i, 8], kept[i, 9]
            for k in range(width):
                fx, fy, mz = 0.0, 0.0, 0.0
                for j in range(6):
                    moved = carried[i, j, k]
                    fx += slopes[0, j] * moved
                    fy += slopes[1, j] * moved
                    mz += slopes[2, j] * moved
                    for m in range(memory):
                        out[first + m, k] += slopes[3 + m, j] * moved
                for j in range(memory):
                    moved = lanes[first + j, k]
                    fx += slopes[0, 6 + j] * moved
                    fy += slopes[1, 6 + j] * moved
                    mz += slopes[2, 6 + j] * moved
                    for m in range(memory):
                        out[first + m, k] += slopes[3 + m, 6 + j] * moved
                hx = c * fx - s * fy
                hy = s * fx + c * fy
                pushed[0, k] += hx
                pushed[1, k] += hy
                pushed[2, k] += mz + x * hy - y * hx
                if i == n - 1:
                    pushed[3, k] += mz
    for k in range(width):
        a0, a1, a2, bend = solve(solver, flexible, pushed[0, k], pushed[1, k], pushed[2, k], pushed[3, k])
        out[0, k] += a0
        out[1, k] += a1
        out[2, k] += a2
        out[7, k] += bend
