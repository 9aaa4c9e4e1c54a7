"""The swimmer by its momenta: P, H about the moving nose (and L of an elastic tail); compiled.

Link i has the axis e_i and normal n_i in world axes and its joint at p_i behind the nose. It turns at om_i = yaw' +
rho_i, rho_i the sum of the joint rates in front; its joint moves at V_i = v + yaw' z x p_i + g_i, g_i = sum L_k rho_k
n_k. Then

    P = sum B_i V_i + f_i om_i n_i      H = sum p_i x (..) + f_i n_i . V_i + J_i om_i       (generalised momenta)
    B_i = m_i + A0_i n_i n_i^T,  f_i = m_i c_i + A1_i,  J_i = I_i + m_i c_i^2 + A2_i

is solved for v, yaw' (and the tail's deflection rate), and P' = F, H' = M - v x P + (1 - kappa) sum u_i INT m_a q dr:
no acceleration appears, and where the joint rates jump the momenta simply go on. Kutta's third-order rule.
"""

from __future__ import annotations

import numpy as np

from studies.battery.generator.compiled import compiled
from studies.battery.generator.other_water import excess
from studies.battery.generator.water import W, across_changed, across_plain, along, near_wall, on_tail, spring

#: x, y, yaw of the nose, P_x, P_y, H, deflection of the tail, L of the last link, memories (force, moment) of links,
#: roll and its rate.
STATES = 20
_X, _PX, _H, _D, _L, _MEM, _ROLL = 0, 3, 5, 6, 7, 8, 18
#: Written at every node: velocity of the nose along and across the head, yaw rate, x, y, yaw, deflection of the tail,
#: side force, roll.
OUTPUTS = 9
_GRAVITY = 9.81
_KAPPA, _STIFF, _DAMP, _MEMORY, _MEMORY_TIME = (
    W[n] for n in ("kappa", "stiffness", "damping", "memory", "memory_time")
)
_TETHER, _TX, _TY, _TORQUE, _TYAW = (W[n] for n in ("tether", "tether_x", "tether_y", "torque", "torque_yaw"))
_CUBIC, _RP, _LINC, _LIFT, _SIDE, _RHO = (
    W[n] for n in ("cubic", "re_pressure", "linear_across", "lift", "tail_side", "density")
)
_SLIP, _SLIP_FREQUENCY, _SLIP_DAMPING, _FORM = (W[n] for n in ("slip_size", "slip_frequency", "slip_damping", "form"))


@compiled
def swim(links, r, k, side, height, ring, angle, rate, start, h, state, push, w, out):  # type: ignore[no-untyped-def]
    """Advance `state` over one stretch; write OUTPUTS at its steps + 1 nodes. Return whether it stayed finite.

    Args:
        links, r, k, side, height, ring: of `studies.battery.generator.body.Body`.
        angle, rate: (steps, 3, joints) at start, middle, end of each step.
        start, h: [s] of the stretch and of a step.
        state: (STATES,), changed.
        push: (2 steps + 1, 3) force and moment on the nose, world axes, at nodes and middles.
        w: the kernel's numbers.
        out: (steps + 1, OUTPUTS).
    """
    n = links.shape[0]
    work = np.empty((n, 16))
    k1 = np.zeros(STATES)
    k2 = np.zeros(STATES)
    k3 = np.zeros(STATES)
    trial = state.copy()
    seen = np.empty(OUTPUTS)
    steps = angle.shape[0]
    strips = (r, k, side, height, ring)
    for step in range(steps):
        t = start + step * h
        _rates(links, strips, angle[step, 0], rate[step, 0], t, state, push[2 * step], w, work, k1, out[step])
        for j in range(STATES):
            trial[j] = state[j] + 0.5 * h * k1[j]
        _rates(links, strips, angle[step, 1], rate[step, 1], t + 0.5 * h, trial, push[2 * step + 1], w, work, k2, seen)
        for j in range(STATES):
            trial[j] = state[j] + h * (2.0 * k2[j] - k1[j])
        _rates(links, strips, angle[step, 2], rate[step, 2], t + h, trial, push[2 * step + 2], w, work, k3, seen)
        for j in range(STATES):
            state[j] += h / 6.0 * (k1[j] + 4.0 * k2[j] + k3[j])
        if not abs(state[_H]) < 1e6:
            return False
    t = start + steps * h
    _rates(links, strips, angle[-1, 2], rate[-1, 2], t, state, push[2 * steps], w, work, k1, out[steps])
    return True


@compiled
def rest(links, angle, rate, state):  # type: ignore[no-untyped-def]
    """Give `state` the momenta of moving joints and a nose at rest."""
    n = links.shape[0]
    work = np.empty((n, 16))
    m = np.empty((4, 5))
    _assemble(links, angle, rate, state, work, m)
    for row in range(3):
        state[_PX + row] = m[row, 4]
    state[_L] = m[3, 4]


@compiled
def _assemble(links, angle, rate, state, work, m):  # type: ignore[no-untyped-def]
    """Fill `work` (e, n, p, rho, g of every link) and `m`: momenta = m[:, :4] (v, yaw', delta') + m[:, 4]."""
    n = links.shape[0]
    for a in range(4):
        for b in range(5):
            m[a, b] = 0.0
    heading = state[2]
    rho = 0.0
    px = 0.0
    py = 0.0
    gx = 0.0
    gy = 0.0
    for i in range(n):
        if i > 0:
            length = links[i - 1, 0]
            px += length * work[i - 1, 0]
            py += length * work[i - 1, 1]
            gx -= length * rho * work[i - 1, 1]
            gy += length * rho * work[i - 1, 0]
            heading += angle[i - 1]
            rho += rate[i - 1]
            if i == n - 1:
                heading += state[_D]
        ex = np.cos(heading)
        ey = np.sin(heading)
        work[i, 0] = ex
        work[i, 1] = ey
        work[i, 2] = px
        work[i, 3] = py
        work[i, 4] = rho
        work[i, 5] = gx
        work[i, 6] = gy
        nx = -ey
        ny = ex
        mass = links[i, 1]
        f = mass * links[i, 2] + links[i, 5]
        j = links[i, 3] + mass * links[i, 2] ** 2 + links[i, 6]
        bxx = mass + links[i, 4] * nx * nx
        bxy = links[i, 4] * nx * ny
        byy = mass + links[i, 4] * ny * ny
        # Columns: momentum of a unit of v_x, v_y, of yaw', of delta' (last link), and of the joints' own motion.
        cx = -py * bxx + px * bxy + f * nx
        cy = -py * bxy + px * byy + f * ny
        arm = -py * nx + px * ny  # (z x p) . n
        ox = bxx * gx + bxy * gy + f * rho * nx
        oy = bxy * gx + byy * gy + f * rho * ny
        m[0, 0] += bxx
        m[0, 1] += bxy
        m[1, 1] += byy
        m[0, 2] += cx
        m[1, 2] += cy
        m[2, 2] += -py * cx + px * cy + f * arm + j
        m[0, 4] += ox
        m[1, 4] += oy
        m[2, 4] += -py * ox + px * oy + f * (nx * gx + ny * gy) + j * rho
        if i == n - 1:
            m[0, 3] = f * nx
            m[1, 3] = f * ny
            m[2, 3] = f * arm + j
            m[3, 3] = j
            m[3, 4] = f * (nx * gx + ny * gy) + j * rho
    m[1, 0] = m[0, 1]
    m[2, 0] = m[0, 2]
    m[2, 1] = m[1, 2]
    for a in range(3):
        m[3, a] = m[a, 3]


@compiled
def _solve(m, size, state, q):  # type: ignore[no-untyped-def]
    """Solve m[:, :4] q = momenta - m[:, 4] for v_x, v_y, yaw' (, delta') by elimination; m is overwritten."""
    for a in range(size):
        held = state[_PX + a] if a < 3 else state[_L]
        m[a, 4] = held - m[a, 4]
    for a in range(size):
        for b in range(a + 1, size):
            factor = m[b, a] / m[a, a]
            for c in range(a + 1, size):
                m[b, c] -= factor * m[a, c]
            m[b, 4] -= factor * m[a, 4]
    for a in range(size - 1, -1, -1):
        total = m[a, 4]
        for c in range(a + 1, size):
            total -= m[a, c] * q[c]
        q[a] = total / m[a, a]


@compiled
def _rates(links, strips, angle, rate, t, state, push, w, work, out, seen):  # type: ignore[no-untyped-def]
    """Write the rates of `state` into `out`, and what a camera would see into `seen`."""
    n = links.shape[0]
    r, k, side, height, ring = strips
    m = np.empty((4, 5))
    q = np.zeros(4)
    flexible = w[_STIFF] > 0.0
    _assemble(links, angle, rate, state, work, m)
    _solve(m, 4 if flexible else 3, state, q)
    vx, vy, yaw_rate, bend = q[0], q[1], q[2], q[3]
    changed = w[_RP] != 0.0 or w[_CUBIC] != 0.0 or w[_LINC] != 0.0
    force_x = push[0] - w[_TETHER] * (state[0] - w[_TX])
    force_y = push[1] - w[_TETHER] * (state[1] - w[_TY])
    turn = push[2] - w[_TORQUE] * np.sin(state[2] - w[_TYAW]) - (vx * state[_PX + 1] - vy * state[_PX])
    own = 0.0
    wall = near_wall(state[0], state[1], w)
    leant = np.cos(state[_ROLL]) ** 2
    weight = 0.0
    for i in range(n):
        ex, ey, px, py = work[i, 0], work[i, 1], work[i, 2], work[i, 3]
        jx = vx - yaw_rate * py + work[i, 5]
        jy = vy + yaw_rate * px + work[i, 6]
        om = yaw_rate + work[i, 4]
        if i == n - 1:
            om += bend
        u = jx * ex + jy * ey
        v = jy * ex - jx * ey
        if changed:
            fy, mz = across_changed(r[i], k[i], side[i], v, om, w)
        else:
            fy, mz = across_plain(r[i], k[i], v, om)
        fx = wall * along(links[i, 7], links[i, 8], u, t, w)
        fy *= wall
        mz *= wall
        if w[_MEMORY] != 0.0:  # a share of the crossflow drag follows with a lag
            late, late_turn = state[_MEM + 2 * i], state[_MEM + 2 * i + 1]
            out[_MEM + 2 * i] = (fy - late) / w[_MEMORY_TIME]
            out[_MEM + 2 * i + 1] = (mz - late_turn) / w[_MEMORY_TIME]
            fy += w[_MEMORY] * (late - fy)
            mz += w[_MEMORY] * (late_turn - mz)
        if w[_SLIP] != 0.0:
            fy *= leant
            mz *= leant
            weight += _GRAVITY * links[i, 1]
        if w[_FORM] != 0.0:
            own_form, numbers = int(w[_FORM]), w[_FORM + 1 :]
            more_x, more, turned = excess(
                i == n - 1, links[i], w[_RHO], r[i], k[i], height[i], ring[i], u, v, om, own_form, numbers
            )
            fx += more_x
            fy += more
            mz += turned
        if i == n - 1 and (w[_SIDE] != 0.0 or w[_LIFT] != 0.0):
            more, turned = on_tail(links[i], w[_RHO], u, v, om, w)
            fy += more
            mz += turned
        water = u * (links[i, 4] * v + links[i, 5] * om)
        hx = fx * ex - fy * ey
        hy = fx * ey + fy * ex
        force_x += hx
        force_y += hy
        turn += px * hy - py * hx + mz + (1.0 - w[_KAPPA]) * water
        if i == n - 1:
            own = mz - u * links[i, 1] * links[i, 2] * om - w[_KAPPA] * water
    out[0] = vx
    out[1] = vy
    out[2] = yaw_rate
    out[_PX] = force_x
    out[_PX + 1] = force_y
    out[_H] = turn
    if flexible:
        out[_D] = bend
        out[_L] = own - spring(state[_D], w) - w[_DAMP] * bend
    c = np.cos(state[2])
    s = np.sin(state[2])
    seen[0] = c * vx + s * vy
    seen[1] = c * vy - s * vx
    seen[2] = yaw_rate
    seen[3] = state[0]
    seen[4] = state[1]
    seen[5] = state[2]
    seen[6] = state[_D]
    seen[7] = c * force_y - s * force_x
    seen[8] = state[_ROLL]
    if w[_SLIP] != 0.0:
        frequency = w[_SLIP_FREQUENCY]
        out[_ROLL] = state[_ROLL + 1]
        out[_ROLL + 1] = frequency**2 * (w[_SLIP] * seen[7] / weight - state[_ROLL])
        out[_ROLL + 1] -= 2.0 * w[_SLIP_DAMPING] * frequency * state[_ROLL + 1]
