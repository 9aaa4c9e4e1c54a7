"""The head-frame equation linearised at one instant: what a small change of anything does to the head's acceleration.

With the head's acceleration held, the equation of motion is a sum of wrenches that is zero,

    W_i = F_i(V_i) - I_i V_i' + X^T W_{i+1},   W_0 = 0,     V_{i+1} = X V_i + e_w theta',    F: water, loads, gamma

(X: velocity from a front joint to the next). Its differential is gathered from the tail to the nose, like a composite
body: dW_i = D_i dV_i - M_i dV_i' + (what changes in joints and links behind), so that M_0 is the inertia of the whole
fish, D_0 its derivative by the head's velocity, and M_0 dV_0' = D_0 dV_0 + ... gives the change of the acceleration. A
flexible tail adds one row, its torque, and one unknown, the acceleration of its deflection.

Matrices and wrenches are plain numbers, which stay in registers.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from mjfish.hydro.force import crossflow_derivatives
from mjfish.hydro.load import ANSWER, AT_STATEFUL, SLOPES, LoadBuffers, loads_on
from mjfish.hydro.load_derivatives import velocity_derivatives
from mjfish.numerics.arrays import FloatArray
from mjfish.numerics.compiled import merged, part
from mjfish.ode.equation import Joints, System, next_link

Three = tuple[float, float, float]
Nine = tuple[float, float, float, float, float, float, float, float, float]
#: Columns by a joint: its angle, rate, acceleration, and the length of the link in front of it.
ANGLE, RATE, ACCELERATION, LENGTH = range(4)
#: Numbers of a solver: the inverse of the inertia (6), and of a flexible tail k (3) and j.
SOLVER = 10
#: Rows of a response: u', v', w' of the head, acceleration of the deflection.
ROWS = 4
#: Columns by the state: u, v, w, deflection and its rate.
STATE = 5
#: Motion of a link: velocity and acceleration of its origin, direction and place in the head's frame; INT h |q| q dr
#: and its moment.
LINK_MOTION = np.dtype(
    [(name, "f8") for name in ("u", "v", "w", "au", "av", "aw", "cos", "sin", "x", "y", "drag_force", "drag_moment")]
)


class Linearisation(NamedTuple):
    """The equation of motion linearised at one instant; with scratch of its own.

    Attributes:
        links: (n,) `LINK_MOTION` records.
        by_joints: (joints, 4, ROWS) responses to angle, rate, acceleration of each joint and length of the link in
            front of it.
        by_state: (STATE, ROWS) responses to u, v, w, the deflection and its rate.
        solver: (SOLVER,), see `solve`.
        load_gradients: (n, loads, ANSWER, SLOPES) of the loads, as far as they are known, see `mjfish.hydro.load.load`.
        output, answers, load_rates, load_matrix: (ANSWER,), (2, ANSWER), (STATES + memory,), (3, 3) scratch for loads.
    """

    links: Any
    by_joints: FloatArray
    by_state: FloatArray
    solver: FloatArray
    load_gradients: FloatArray
    output: FloatArray
    answers: FloatArray
    load_rates: FloatArray
    load_matrix: FloatArray

    @classmethod
    def empty(cls, joints: int, states: int, loads: int) -> Linearisation:
        """Return room for a fish of so many joints, with so many states and loads."""
        gradients = (joints + 1, loads, ANSWER, SLOPES)
        shapes = ((joints, 4, ROWS), (STATE, ROWS), SOLVER, gradients, ANSWER, (2, ANSWER), states, (3, 3))
        return cls(np.zeros(joints + 1, dtype=LINK_MOTION), *(np.zeros(shape) for shape in shapes))


@part
def linearise(
    system: System, joints: Joints, state: FloatArray, derivative: FloatArray, all_joints: bool, velocity_only: bool,
    out: Linearisation,
) -> None:  # fmt: skip
    """Linearise the equation of motion.

    Args:
        system, joints, state: as in `mjfish.ode.equation.derivative`.
        derivative: (STATES + memory,) of the state, of `mjfish.ode.equation.derivative`.
        all_joints: whether responses to all joints are asked for; else only to that of a flexible tail.
        velocity_only: leave out stateful loads; else they change with the velocity alone.
        out: written.
    """
    _write_motion(system, joints, state, derivative, out.links)
    _gather(system, state, all_joints, velocity_only, out)


@merged
def _write_motion(system: System, joints: Joints, state: FloatArray, derivative: FloatArray, motion: Any) -> None:
    """Write velocity, acceleration and place of every link, nose to tail."""
    links, flexible = system.links, system.tail[0] > 0.0
    u, v, w = state[0], state[1], state[2]
    au, av, aw = derivative[0], derivative[1], derivative[2]
    x, y, c, s = 0.0, 0.0, 1.0, 0.0
    n = links.shape[0]
    for i in range(n):
        if i > 0:
            cj, sj = joints.cos[i - 1], joints.sin[i - 1]
            turn, turn_rate = joints.rate[i - 1], joints.acceleration[i - 1]
            if flexible and i == n - 1:
                cj = np.cos(joints.angle_last + state[6])
                sj = np.sin(joints.angle_last + state[6])
                turn += state[7]
                turn_rate += derivative[7]
            length = links[i - 1].length
            x += c * length
            y += s * length
            c, s = c * cj - s * sj, s * cj + c * sj
            u, v = next_link(cj, sj, length, u, v, w)
            au, av = next_link(cj, sj, length, au, av, aw)
            au, av = au + turn * v, av - turn * u
            w += turn
            aw += turn_rate
        link = motion[i]
        link.u, link.v, link.w = u, v, w
        link.au, link.av, link.aw = au, av, aw
        link.cos, link.sin, link.x, link.y = c, s, x, y


@merged
def joint_trigonometry(front: Any, behind: Any) -> tuple[float, float]:
    """Return cosine and sine of the angle between two links, given by their motion."""
    return front.cos * behind.cos + front.sin * behind.sin, front.cos * behind.sin - front.sin * behind.cos


@merged
def to_head(link: Any, x: float, y: float, z: float) -> Three:
    """Return a wrench on a link, given by its motion, at the nose in the head's frame."""
    hx = link.cos * x - link.sin * y
    hy = link.sin * x + link.cos * y
    return hx, hy, z + link.x * hy - link.y * hx


@merged
def _link_derivatives(link: Any, motion: Any, printed: bool) -> tuple[Three, Nine, Nine]:
    """Return of a link the wrench F - I V' without loads, its derivatives by V, and its inertia I, row by row."""
    u, v, w = motion.u, motion.v, motion.w
    mass = link.mass
    mc = mass * link.com
    a0 = link.c_m * link.added[0]
    a1 = link.c_m * link.added[1]
    p = a0 * v + a1 * w
    my = mass + a0
    first = mc + a1
    j = link.inertia + mc * link.com + link.c_m * link.added[2]
    sway = -0.5 * link.density * link.c_d
    surge = -0.5 * link.density * link.c_f * link.wetted
    f, g, f_v, f_w, g_v, g_w = crossflow_derivatives(v, w, link.length, link.node_height, link.height_moment)
    motion.drag_force, motion.drag_moment = f, g
    kappa = link.munk
    coriolis = 0.0 if printed else mc
    wrench = (
        w * (mass * v + mc * w + p) + surge * abs(u) * u - mass * motion.au,
        -mass * w * u + sway * f - my * motion.av - first * motion.aw,
        -u * (kappa * p + coriolis * w) + sway * g - first * motion.av - j * motion.aw,
    )
    derivatives = (
        2.0 * surge * abs(u),
        w * my,
        mass * v + 2.0 * mc * w + p + w * a1,
        -mass * w,
        sway * f_v,
        -mass * u + sway * f_w,
        -kappa * p - coriolis * w,
        -kappa * u * a0 + sway * g_v,
        -kappa * u * a1 - coriolis * u + sway * g_w,
    )
    return wrench, derivatives, (mass, 0.0, 0.0, 0.0, my, first, 0.0, first, j)


@merged
def _gather(system: System, state: FloatArray, all_joints: bool, velocity_only: bool, out: Linearisation) -> None:
    """Gather derivatives and inertia of the whole fish at the nose, tail to nose, and solve for the responses."""
    links, tail, loads, motion = system.links, system.tail, system.loads, out.links
    n = links.shape[0]
    flexible = tail[0] > 0.0
    buffers = LoadBuffers(out.output, state, out.load_rates)
    wx, wy, wz = 0.0, 0.0, 0.0
    d = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    m = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    t = (0.0, 0.0, 0.0)  # derivatives of the torque of the tail by V, and by -V'
    q = (0.0, 0.0, 0.0)
    loaded = False  # whether any load exerts a force, and whether any changes with the velocity
    damped = False
    for k in range(loads.addresses.shape[0]):
        kind = loads.rows[k, AT_STATEFUL]
        loaded = loaded or kind <= 1.0
        damped = damped or kind == 0.0 or (kind <= 1.0 and not velocity_only)
    for i in range(n - 1, -1, -1):
        if i < n - 1:
            cj, sj = joint_trigonometry(motion[i], motion[i + 1])
            turn = motion[i + 1].w - motion[i].w
            length = links[i].length
            d = _turned(d, m, turn)
            wx, wy, wz = _to_front(cj, sj, length, wx, wy, wz)
            if all_joints or (flexible and i == n - 2):
                _write_joint(out, i, cj, sj, length, wx, wy, d, m)
            if flexible:
                if i == n - 2:
                    t, q = (d[6], d[7], d[8]), (m[6], m[7], m[8])
                else:
                    t = (t[0] + turn * q[1], t[1] - turn * q[0], t[2])
                _write_torque(out, i, cj, sj, t, q)
                t = _to_front(cj, sj, length, t[0], t[1], t[2])
                q = _to_front(cj, sj, length, q[0], q[1], q[2])
            d = _congruent(d, cj, sj, length)
            m = _congruent(m, cj, sj, length)
        wrench, derivatives, inertia = _link_derivatives(links[i], motion[i], system.printed)
        wx += wrench[0]
        wy += wrench[1]
        wz += wrench[2]
        d = _sum(d, derivatives)
        m = _sum(m, inertia)
        if loaded and (all_joints or flexible):
            load_x, load_y, load_z = loads_on(links, i, i, loads, False, buffers)
            wx += load_x
            wy += load_y
            wz += load_z
        if damped:
            b = out.load_matrix
            velocity_derivatives(links, i, loads, velocity_only, state, out.answers, out.load_gradients[i], b)
            d = _sum(d, (b[0, 0], b[0, 1], b[0, 2], b[1, 0], b[1, 1], b[1, 2], b[2, 0], b[2, 1], b[2, 2]))
    _write_solver(m, flexible, out)
    for joint in range(0 if all_joints else (n - 2 if flexible else n - 1), n - 1):
        columns = out.by_joints[joint]
        for kind in range(4):
            _write_response(
                out.solver, flexible, columns[kind, 0], columns[kind, 1], columns[kind, 2], columns[kind, 3],
                columns[kind],
            )  # fmt: skip
    _write_response(out.solver, flexible, d[0], d[3], d[6], t[0], out.by_state[0])
    _write_response(out.solver, flexible, d[1], d[4], d[7], t[1], out.by_state[1])
    _write_response(out.solver, flexible, d[2], d[5], d[8], t[2], out.by_state[2])
    if flexible:
        stiffness = tail[1] + 2.0 * tail[4] * abs(state[6]) + 3.0 * tail[3] * state[6] * state[6]
        for i in range(2):
            _write_response(out.solver, True, 0.0, 0.0, 0.0, -(stiffness if i == 0 else tail[2]), out.by_state[3 + i])
            for row in range(ROWS):
                out.by_state[3 + i, row] += out.by_joints[n - 2, ANGLE + i, row]


@merged
def _write_joint(
    out: Linearisation, i: int, c: float, s: float, length: float, wx: float, wy: float, d: Nine, m: Nine
) -> None:
    """Write the wrench at the nose by what joint `i` changes; `d` is D - M N, (wx, wy) the force it passes forward."""
    front, behind, columns = out.links[i], out.links[i + 1], out.by_joints[i]
    u, v, turn = behind.u, behind.v, behind.w - front.w
    w, aw = front.w, front.aw
    wrench = _applied(d, m, v, -u, 0.0, behind.av + turn * u, turn * v - behind.au, 0.0)
    x, y, z = _to_front(c, s, length, wrench[0], wrench[1], wrench[2])
    _write_column(front, x - wy, y + wx, z + length * wx, columns[ANGLE])  # what comes from behind turns
    wrench = _applied(d, m, 0.0, 0.0, 1.0, v, -u, 0.0)
    x, y, z = _to_front(c, s, length, wrench[0], wrench[1], wrench[2])
    _write_column(front, x, y, z, columns[RATE])
    x, y, z = _to_front(c, s, length, -m[2], -m[5], -m[8])
    _write_column(front, x, y, z, columns[ACCELERATION])
    wrench = _applied(d, m, s * w, c * w, 0.0, s * aw, c * aw, 0.0)
    x, y, z = _to_front(c, s, length, wrench[0], wrench[1], wrench[2])
    _write_column(front, x, y, z + wy, columns[LENGTH])


@merged
def _write_column(link: Any, x: float, y: float, z: float, column: FloatArray) -> None:
    column[0], column[1], column[2] = to_head(link, x, y, z)


@merged
def _write_torque(out: Linearisation, i: int, c: float, s: float, t: Three, q: Three) -> None:
    """Write the torque of the tail by what joint `i` changes; `t`, `q`: by V and by -V' behind it."""
    front, behind, columns = out.links[i], out.links[i + 1], out.by_joints[i]
    u, v, turn = behind.u, behind.v, behind.w - front.w
    w, aw = front.w, front.aw
    columns[ANGLE, 3] = t[0] * v - t[1] * u - q[0] * (behind.av + turn * u) - q[1] * (turn * v - behind.au)
    columns[RATE, 3] = t[2] - q[0] * v + q[1] * u
    columns[ACCELERATION, 3] = -q[2]
    columns[LENGTH, 3] = (t[0] * w - q[0] * aw) * s + (t[1] * w - q[1] * aw) * c


@merged
def _to_front(c: float, s: float, length: float, x: float, y: float, z: float) -> Three:
    """Return X^T (x, y, z): a wrench at a joint, at the front joint of the link in front; c, s of the joint's angle."""
    sway = s * x + c * y
    return c * x - s * y, sway, z + length * sway


@merged
def _congruent(m: Nine, c: float, s: float, length: float) -> Nine:
    """Return X^T m X of a matrix given row by row."""
    m00, m01, m02, m10, m11, m12, m20, m21, m22 = m
    m00, m01 = c * m00 - s * m01, s * m00 + c * m01
    m10, m11 = c * m10 - s * m11, s * m10 + c * m11
    m20, m21 = c * m20 - s * m21, s * m20 + c * m21
    m02 += length * m01
    m12 += length * m11
    m22 += length * m21
    m00, m10, m20 = _to_front(c, s, length, m00, m10, m20)
    m01, m11, m21 = _to_front(c, s, length, m01, m11, m21)
    m02, m12, m22 = _to_front(c, s, length, m02, m12, m22)
    return m00, m01, m02, m10, m11, m12, m20, m21, m22


@merged
def _turned(d: Nine, m: Nine, turn: float) -> Nine:
    """Return D - M N with N V = turn (v, -u, 0), by which V enters V'."""
    return (
        d[0] + turn * m[1], d[1] - turn * m[0], d[2],
        d[3] + turn * m[4], d[4] - turn * m[3], d[5],
        d[6] + turn * m[7], d[7] - turn * m[6], d[8],
    )  # fmt: skip


@merged
def _sum(a: Nine, b: Nine) -> Nine:
    """Return a + b."""
    return (
        a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3], a[4] + b[4], a[5] + b[5], a[6] + b[6], a[7] + b[7],
        a[8] + b[8],
    )  # fmt: skip


@merged
def _applied(d: Nine, m: Nine, u: float, v: float, w: float, au: float, av: float, aw: float) -> Three:
    """Return D dV - M dV'."""
    return (
        d[0] * u + d[1] * v + d[2] * w - m[0] * au - m[1] * av - m[2] * aw,
        d[3] * u + d[4] * v + d[5] * w - m[3] * au - m[4] * av - m[5] * aw,
        d[6] * u + d[7] * v + d[8] * w - m[6] * au - m[7] * av - m[8] * aw,
    )


@merged
def _write_solver(m: Nine, flexible: bool, linear: Linearisation) -> None:
    """Write the numbers of `solve`; the acceleration of the deflection acts like that of the last joint."""
    k0, k1, k2, j = 0.0, 0.0, 0.0, 1.0
    if flexible:
        last = linear.by_joints[linear.by_joints.shape[0] - 1, ACCELERATION]
        k0, k1, k2, j = -last[0], -last[1], -last[2], -last[3]
    out = linear.solver
    m00 = m[0] - k0 * k0 / j
    m01 = m[1] - k0 * k1 / j
    m02 = m[2] - k0 * k2 / j
    m11 = m[4] - k1 * k1 / j
    m12 = m[5] - k1 * k2 / j
    m22 = m[8] - k2 * k2 / j
    c00 = m11 * m22 - m12 * m12
    c01 = m02 * m12 - m01 * m22
    c02 = m01 * m12 - m02 * m11
    scale = 1.0 / (m00 * c00 + m01 * c01 + m02 * c02)
    out[0], out[1], out[2] = scale * c00, scale * c01, scale * c02
    out[3] = scale * (m00 * m22 - m02 * m02)
    out[4] = scale * (m01 * m02 - m00 * m12)
    out[5] = scale * (m00 * m11 - m01 * m01)
    out[6], out[7], out[8], out[9] = k0, k1, k2, j


@merged
def solve(
    solver: FloatArray, flexible: bool, g0: float, g1: float, g2: float, torque: float
) -> tuple[float, float, float, float]:
    """Return the change of u', v', w' and of the deflection's acceleration that balances a change of the wrench."""
    if flexible:
        share = torque / solver[9]
        g0 -= solver[6] * share
        g1 -= solver[7] * share
        g2 -= solver[8] * share
    a0 = solver[0] * g0 + solver[1] * g1 + solver[2] * g2
    a1 = solver[1] * g0 + solver[3] * g1 + solver[4] * g2
    a2 = solver[2] * g0 + solver[4] * g1 + solver[5] * g2
    bend = 0.0
    if flexible:
        bend = (torque - solver[6] * a0 - solver[7] * a1 - solver[8] * a2) / solver[9]
    return a0, a1, a2, bend


@merged
def _write_response(
    solver: FloatArray, flexible: bool, g0: float, g1: float, g2: float, torque: float, out: FloatArray
) -> None:
    """Write what `solve` returns."""
    out[0], out[1], out[2], out[3] = solve(solver, flexible, g0, g1, g2, torque)
