"""The head-frame equation linearised at one instant: what a small change of anything does to the head's acceleration.

With the head's acceleration held, the equation of motion is a sum of wrenches that is zero,

    W_i = F_i(V_i) - I_i V_i' + X^T W_{i+1},   W_0 = 0,     V_{i+1} = X V_i + e_w theta',    F: water, loads, gamma

(X: velocity from a front joint to the next). Its differential is gathered from the tail to the nose, like a composite
body: dW_i = D_i dV_i - M_i dV_i' + (what changes in joints and links behind), so that M_0 is the inertia of the whole
fish, D_0 its slope by the head's velocity, and M_0 dV_0' = D_0 dV_0 + ... gives the change of the acceleration. A
flexible tail adds one row, its torque, and one unknown, the acceleration of its deflection.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from mjfish.arrays import FloatArray
from mjfish.compiled import borrowing, merged
from mjfish.hydro.load import AT_SPECIAL, loads_on
from mjfish.hydro.load_slopes import velocity_slopes
from mjfish.hydro.slopes import crossflow_slopes
from mjfish.ode.algebra import (
    ACCELERATION,
    ANGLE,
    LENGTH,
    RATE,
    Nine,
    Three,
    answer,
    bent,
    congruent,
    forward,
    solver_of,
    summed,
    turned,
)  # fmt: skip

#: What is kept of each link: V, V', direction (c, s) and place (x, y) in the head's frame, INT h|q|q dr and its moment.
KEPT = 12
#: Rows of a response: u', v', w' of the head, acceleration of the deflection.
ROWS = 4
#: Columns by the state: u, v, w, deflection and its rate.
STATE = 5


@borrowing
def travel(
    links: Any, cos: FloatArray, sin: FloatArray, rate: FloatArray, acceleration: FloatArray,
    angle_last: float, state: FloatArray, moved: FloatArray, flexible: bool, kept: FloatArray,
) -> None:  # fmt: skip
    """Write velocity, acceleration and place of every link, nose to tail, into `kept` (n, KEPT).

    Args:
        links ... state: as in `mjfish.ode.equation.derivative`.
        moved: (STATES,) its answer.
        flexible: whether the tail is.
        kept: written.
    """
    u, v, w = state[0], state[1], state[2]
    au, av, aw = moved[0], moved[1], moved[2]
    x, y, c, s = 0.0, 0.0, 1.0, 0.0
    n = links.shape[0]
    for i in range(n):
        if i > 0:
            cj, sj, turn, bend = cos[i - 1], sin[i - 1], rate[i - 1], acceleration[i - 1]
            if flexible and i == n - 1:
                cj = np.cos(angle_last + state[6])
                sj = np.sin(angle_last + state[6])
                turn += state[7]
                bend += moved[7]
            length = links[i - 1].length
            x += c * length
            y += s * length
            c, s = c * cj - s * sj, s * cj + c * sj
            vy = v + length * w
            u, v = cj * u + sj * vy, cj * vy - sj * u
            ay = av + length * aw
            au, av = cj * au + sj * ay + turn * v, cj * ay - sj * au - turn * u
            w += turn
            aw += bend
        kept[i, 0], kept[i, 1], kept[i, 2] = u, v, w
        kept[i, 3], kept[i, 4], kept[i, 5] = au, av, aw
        kept[i, 6], kept[i, 7] = c, s
        kept[i, 8], kept[i, 9] = x, y


@merged
def to_head(kept: FloatArray, i: int, x: float, y: float, z: float) -> Three:
    """Return a wrench on link `i`, at the nose in the head's frame."""
    hx = kept[i, 6] * x - kept[i, 7] * y
    hy = kept[i, 7] * x + kept[i, 6] * y
    return hx, hy, z + kept[i, 8] * hy - kept[i, 9] * hx


@merged
def slopes_of(links: Any, i: int, kept: FloatArray, printed: bool) -> tuple[Three, Nine, Nine]:
    """Return of link `i` the wrench F - I V' without loads, its slopes by V, and its inertia I, row by row."""
    link = links[i]
    u, v, w = kept[i, 0], kept[i, 1], kept[i, 2]
    mass = link.mass
    mc = mass * link.com
    a0 = link.c_m * link.added[0]
    a1 = link.c_m * link.added[1]
    p = a0 * v + a1 * w
    my = mass + a0
    first = mc + a1
    j = link.inertia + mc * link.com + link.c_m * link.added[2]
    across = -0.5 * link.density * link.c_d
    along = -0.5 * link.density * link.c_f * link.wetted
    f, g, f_v, f_w, g_v, g_w = crossflow_slopes(v, w, link.length, link.node_height, link.height_moment)
    kept[i, 10] = f
    kept[i, 11] = g
    kappa = link.munk
    coriolis = 0.0 if printed else mc
    wrench = (
        w * (mass * v + mc * w + p) + along * abs(u) * u - mass * kept[i, 3],
        -mass * w * u + across * f - my * kept[i, 4] - first * kept[i, 5],
        -u * (kappa * p + coriolis * w) + across * g - first * kept[i, 4] - j * kept[i, 5],
    )
    slopes = (
        2.0 * along * abs(u),
        w * my,
        mass * v + 2.0 * mc * w + p + w * a1,
        -mass * w,
        across * f_v,
        -mass * u + across * f_w,
        -kappa * p - coriolis * w,
        -kappa * u * a0 + across * g_v,
        -kappa * u * a1 - coriolis * u + across * g_w,
    )
    return wrench, slopes, (mass, 0.0, 0.0, 0.0, my, first, 0.0, first, j)


@borrowing
def gather(
    links: Any, kept: FloatArray, tail: FloatArray, printed: bool, hooks: Any, hook_parameters: FloatArray,
    bending: bool, plain: bool, state: FloatArray, rates: FloatArray, force: FloatArray, loaded: FloatArray,
    columns: FloatArray, answers: FloatArray, solver: FloatArray,
) -> None:  # fmt: skip
    """Gather slopes and inertia of the whole fish at the nose, and the columns of the joints, tail to nose.

    Args:
        links ... hook_parameters: as in `mjfish.ode.equation.derivative`; `kept` of `travel`.
        bending: whether anything changes angles, rates, accelerations or lengths; else only a flexible tail does.
        plain: leave out the slopes of special loads; else they are those by the velocity alone.
        state: (STATES + hidden,), for the memory of loads.
        rates, force, loaded: (STATES + hidden,), (ANSWER,), (3, 3) scratch.
        columns: (joints, 4, ROWS), written: response to angle, rate, acceleration of each joint and length of the link
            in front of it.
        answers: (STATE, ROWS), written: response to u, v, w, the deflection and its rate.
        solver: (SOLVER,), written, see `solve`.
    """
    n = links.shape[0]
    flexible = tail[0] > 0.0
    wx, wy, wz = 0.0, 0.0, 0.0
    d = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    m = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    t = (0.0, 0.0, 0.0)  # slopes of the torque of the tail by V, and by -V'
    q = (0.0, 0.0, 0.0)
    pushing = False
    sloping = False
    for k in range(hooks.shape[0]):
        special = hook_parameters[k, AT_SPECIAL]
        pushing = pushing or special <= 1.0
        sloping = sloping or special == 0.0 or (special <= 1.0 and not plain)
    for i in range(n - 1, -1, -1):
        if i < n - 1:
            cj = kept[i, 6] * kept[i + 1, 6] + kept[i, 7] * kept[i + 1, 7]
            sj = kept[i, 6] * kept[i + 1, 7] - kept[i, 7] * kept[i + 1, 6]
            turn = kept[i + 1, 2] - kept[i, 2]
            length = links[i].length
            d = turned(d, m, turn)
            wx, wy, wz = forward(cj, sj, length, wx, wy, wz)
            if bending or (flexible and i == n - 2):
                _columns(kept, i, cj, sj, turn, length, wx, wy, d, m, columns)
            if flexible:
                if i == n - 2:
                    t, q = (d[6], d[7], d[8]), (m[6], m[7], m[8])
                else:
                    t = (t[0] + turn * q[1], t[1] - turn * q[0], t[2])
                _torques(kept, i, cj, sj, turn, t, q, columns)
                t = forward(cj, sj, length, t[0], t[1], t[2])
                q = forward(cj, sj, length, q[0], q[1], q[2])
            d = congruent(d, cj, sj, length)
            m = congruent(m, cj, sj, length)
        wrench, slopes, inertia = slopes_of(links, i, kept, printed)
        wx += wrench[0]
        wy += wrench[1]
        wz += wrench[2]
        d = summed(d, slopes)
        m = summed(m, inertia)
        if pushing and (bending or flexible):
            load_x, load_y, load_z = loads_on(links, i, i, hooks, hook_parameters, False, force, state, rates)
            wx += load_x
            wy += load_y
            wz += load_z
        if sloping:
            velocity_slopes(links, i, hooks, hook_parameters, plain, force, state, rates, loaded)
            d = summed(
                d,
                (
                    loaded[0, 0], loaded[0, 1], loaded[0, 2], loaded[1, 0], loaded[1, 1], loaded[1, 2],
                    loaded[2, 0], loaded[2, 1], loaded[2, 2],
                ),
            )  # fmt: skip
    solver_of(m, columns, flexible, solver)
    if bending or flexible:
        for joint in range(0 if bending else n - 2, n - 1):
            for kind in range(4):
                answer(
                    solver, flexible, columns[joint, kind, 0], columns[joint, kind, 1], columns[joint, kind, 2],
                    columns[joint, kind, 3], columns[joint], kind,
                )  # fmt: skip
    answer(solver, flexible, d[0], d[3], d[6], t[0], answers, 0)
    answer(solver, flexible, d[1], d[4], d[7], t[1], answers, 1)
    answer(solver, flexible, d[2], d[5], d[8], t[2], answers, 2)
    if flexible:
        for i in range(2):
            answer(solver, True, 0.0, 0.0, 0.0, -tail[1 + i], answers, 3 + i)
            for row in range(ROWS):
                answers[3 + i, row] += columns[n - 2, ANGLE + i, row]


@merged
def _columns(
    kept: FloatArray, i: int, cj: float, sj: float, turn: float, length: float, wx: float, wy: float, d: Nine, m: Nine,
    columns: FloatArray,
) -> None:  # fmt: skip
    """Write the wrench at the nose by what a joint changes; `d` is D - M N, (wx, wy) the force it passes forward."""
    u, v = kept[i + 1, 0], kept[i + 1, 1]
    p, q = kept[i + 1, 4] + turn * u, turn * v - kept[i + 1, 3]
    wrench = bent(d, m, v, -u, 0.0, p, q, 0.0)
    x, y, z = forward(cj, sj, length, wrench[0], wrench[1], wrench[2])
    x, y, z = to_head(kept, i, x - wy, y + wx, z + length * wx)  # what comes from behind turns
    columns[i, ANGLE, 0], columns[i, ANGLE, 1], columns[i, ANGLE, 2] = x, y, z
    wrench = bent(d, m, 0.0, 0.0, 1.0, v, -u, 0.0)
    x, y, z = forward(cj, sj, length, wrench[0], wrench[1], wrench[2])
    x, y, z = to_head(kept, i, x, y, z)
    columns[i, RATE, 0], columns[i, RATE, 1], columns[i, RATE, 2] = x, y, z
    x, y, z = forward(cj, sj, length, -m[2], -m[5], -m[8])
    x, y, z = to_head(kept, i, x, y, z)
    columns[i, ACCELERATION, 0], columns[i, ACCELERATION, 1], columns[i, ACCELERATION, 2] = x, y, z
    w, aw = kept[i, 2], kept[i, 5]
    wrench = bent(d, m, sj * w, cj * w, 0.0, sj * aw, cj * aw, 0.0)
    x, y, z = forward(cj, sj, length, wrench[0], wrench[1], wrench[2])
    x, y, z = to_head(kept, i, x, y, z + wy)
    columns[i, LENGTH, 0], columns[i, LENGTH, 1], columns[i, LENGTH, 2] = x, y, z


@merged
def _torques(
    kept: FloatArray, i: int, cj: float, sj: float, turn: float, t: Three, q: Three, columns: FloatArray
) -> None:
    """Write the torque of the tail by what a joint changes; `t`, `q`: by V and by -V' behind it."""
    u, v = kept[i + 1, 0], kept[i + 1, 1]
    w, aw = kept[i, 2], kept[i, 5]
    columns[i, ANGLE, 3] = t[0] * v - t[1] * u - q[0] * (kept[i + 1, 4] + turn * u) - q[1] * (turn * v - kept[i + 1, 3])
    columns[i, RATE, 3] = t[2] - q[0] * v + q[1] * u
    columns[i, ACCELERATION, 3] = -q[2]
    columns[i, LENGTH, 3] = (t[0] * w - q[0] * aw) * sj + (t[1] * w - q[1] * aw) * cj
