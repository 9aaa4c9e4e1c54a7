"""Head-frame equation of motion, [Yu2016] eqs. (1)-(19) in the plane, solved for the head's acceleration.

    M V_0' = sum_i T_i^T [f_i - gamma_i - (M_i + M_ad,i) b_i],     M = sum_i T_i^T (M_i + M_ad,i) T_i

with V_i = T_i V_0 + (joint rates) and V_i' = T_i V_0' + b_i. The printed gamma_i lacks U x p; here it has it unless the
printed form is asked for, which exists only to show the disagreement (see docs/theory.md).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from mjfish.fish import Fish
from mjfish.hydro.force import added_mass, drag, gyroscopic, magnitude
from mjfish.hydro.load import AT_STATEFUL, LoadBuffers, LoadTable, loads_on
from mjfish.numerics.arrays import FloatArray
from mjfish.numerics.compiled import merged

#: u, v, w [m/s, m/s, rad/s] of the nose, x, y [m], yaw [rad], tail deflection [rad], its rate [rad/s]; model's frame.
STATES = 8
#: Numbers of a flexible tail: flexible (0 or 1), stiffness [N m/rad], damping [N m s/rad], cubic stiffness [N m/rad3],
#: stiffness by delta |delta| [N m/rad2].
TAIL = 5


class System(NamedTuple):
    """What does not change while the fish swims.

    Attributes:
        links: (n,) `mjfish.hydro.link.LINK` records; their velocities and poses are overwritten.
        tail: (TAIL,) of the last joint's deflection, see `tail_of`.
        printed: whether c m w u is dropped from the moments, as the paper prints gamma_i.
        loads: extra forces, of `mjfish.hydro.load.load_rows`.
    """

    links: Any
    tail: FloatArray
    printed: bool
    loads: LoadTable


class Joints(NamedTuple):
    """The joints at one instant; with (steps, 3) in front of all shapes, at start, middle and end of every step.

    Attributes:
        cos, sin: (joints,) of the angles.
        rate, acceleration: (joints,) [rad/s, rad/s2].
        angle_last: () angle of the last joint [rad], used where the tail is flexible.
    """

    cos: FloatArray
    sin: FloatArray
    rate: FloatArray
    acceleration: FloatArray
    angle_last: Any


def tail_of(fish: Fish) -> FloatArray:
    """Return the numbers (TAIL,) of the last joint's deflection, see `TAIL`."""
    flexible = fish.tail_compliance > 0.0
    stiffness = 1.0 / fish.tail_compliance if flexible else 0.0
    quadratic, cubic = stiffness * fish.tail_quadratic, stiffness * fish.tail_hardening
    return np.array([float(flexible), stiffness, fish.tail_damping, cubic, quadratic])


@merged
def next_link(c: Any, s: Any, length: Any, u: Any, v: Any, w: Any) -> tuple[Any, Any]:
    """Return u, v of a link's origin in its own frame, from those of the link in front; c, s of the joint's angle."""
    sway = v + length * w
    return c * u + s * sway, c * sway - s * u


@merged
def derivative(system: System, joints: Joints, state: FloatArray, output: FloatArray, out: FloatArray) -> None:
    """Write the time derivative of the state.

    Args:
        system: fish and loads; the records of the links get their velocities.
        joints: at this instant.
        state: (STATES + memory,), the hidden states of the loads behind those of the fish.
        output: (ANSWER,) scratch.
        out: (STATES + memory,), written.
    """
    links, tail, loads = system.links, system.tail, system.loads
    n = links.shape[0]
    u, v, w = state[0], state[1], state[2]
    bu, bv, bw = 0.0, 0.0, 0.0  # acceleration of the link's origin that joints and rotation cause, b_i
    x, y, c, s = 0.0, 0.0, 1.0, 0.0  # origin of the link and its direction in the head's frame
    m00, m01, m02, m11, m12, m22 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    g0, g1, g2 = 0.0, 0.0, 0.0
    mz, gx, gy, j = 0.0, 0.0, 0.0, 0.0
    flexible = tail[0].real > 0.0
    yaw = state[5].real
    yaw_change = state[5] - yaw  # of a complex state, its derivative; else 0
    heading_cos = np.cos(yaw) - np.sin(yaw) * yaw_change
    heading_sin = np.sin(yaw) + np.cos(yaw) * yaw_change
    placed = False
    for i in range(loads.addresses.shape[0]):
        placed = placed or loads.rows[i, AT_STATEFUL] > 0.0
    for i in range(n):
        if i > 0:
            cj, sj, turn = joints.cos[i - 1], joints.sin[i - 1], joints.rate[i - 1]
            if flexible and i == n - 1:
                cj = np.cos(joints.angle_last + state[6])
                sj = np.sin(joints.angle_last + state[6])
                turn += state[7]
            length = links[i - 1].length
            x += c * length
            y += s * length
            c, s = c * cj - s * sj, s * cj + c * sj
            u, v = next_link(cj, sj, length, u, v, w)
            bu, bv = next_link(cj, sj, length, bu, bv, bw)
            bu, bv = bu + turn * v, bv - turn * u  # eq. (4)
            w += turn
            bw += joints.acceleration[i - 1]
        link = links[i]
        link.u, link.v, link.w = u, v, w
        a0, a1, a2 = added_mass(link)
        mass = link.mass
        mc = mass * link.com
        my = mass + a0
        first = mc + a1
        j = link.inertia + mc * link.com + a2
        gyro_x, gyro_y, gyro_z = gyroscopic(link)
        drag_x, drag_y, drag_z = drag(link)
        fx = w * (mass * v + mc * w) + gyro_x + drag_x
        fy = -mass * w * u + gyro_y + drag_y
        mz = gyro_z + drag_z
        if not system.printed:
            mz -= mc * w * u
        if loads.addresses.shape[0] > 0:
            if placed:
                link.x = -(state[3] + heading_cos * x - heading_sin * y)  # of the forward frame: half a turn away
                link.y = -(state[4] + heading_sin * x + heading_cos * y)
                link.bend = np.arctan2(s.real, c.real)
                link.heading = state[5] + link.bend
            load_x, load_y, load_z = loads_on(links, i, i, loads, False, LoadBuffers(output, state, out))
            fx += load_x
            fy += load_y
            mz += load_z
        fx -= mass * bu
        fy -= my * bv + first * bw
        mz -= first * bv + j * bw
        # Force and inertia of the link, turned into the head's frame and moved to the nose.
        hx = c * fx - s * fy
        hy = s * fx + c * fy
        g0 += hx
        g1 += hy
        g2 += mz + x * hy - y * hx
        bxx = mass * c * c + my * s * s
        bxy = (mass - my) * c * s
        byy = mass * s * s + my * c * c
        gx = -first * s
        gy = first * c
        px = -y * bxx + x * bxy
        py = -y * bxy + x * byy
        m00 += bxx
        m01 += bxy
        m11 += byy
        m02 += gx + px
        m12 += gy + py
        m22 += j + 2.0 * (x * gy - y * gx) + x * py - y * px
    k0, k1, k2, torque = 0.0, 0.0, 0.0, 0.0
    if flexible:  # eliminate the deflection: row and column of the last link's own rotation
        k0, k1, k2 = gx, gy, j + x * gy - y * gx
        spring = tail[1] + tail[4] * magnitude(state[6]) + tail[3] * state[6] * state[6]
        torque = mz - spring * state[6] - tail[2] * state[7]
        m00 -= k0 * k0 / j
        m01 -= k0 * k1 / j
        m02 -= k0 * k2 / j
        m11 -= k1 * k1 / j
        m12 -= k1 * k2 / j
        m22 -= k2 * k2 / j
        g0 -= k0 * torque / j
        g1 -= k1 * torque / j
        g2 -= k2 * torque / j
    # Cramer's rule: M is 3 x 3, symmetric and positive definite.
    c00 = m11 * m22 - m12 * m12
    c01 = m02 * m12 - m01 * m22
    c02 = m01 * m12 - m02 * m11
    c11 = m00 * m22 - m02 * m02
    c12 = m01 * m02 - m00 * m12
    c22 = m00 * m11 - m01 * m01
    scale = 1.0 / (m00 * c00 + m01 * c01 + m02 * c02)
    out[0] = scale * (c00 * g0 + c01 * g1 + c02 * g2)
    out[1] = scale * (c01 * g0 + c11 * g1 + c12 * g2)
    out[2] = scale * (c02 * g0 + c12 * g1 + c22 * g2)
    out[3] = heading_cos * state[0] - heading_sin * state[1]
    out[4] = heading_sin * state[0] + heading_cos * state[1]
    out[5] = state[2]
    out[6], out[7] = 0.0, 0.0
    if flexible:
        out[6] = state[7]
        out[7] = (torque - k0 * out[0] - k1 * out[1] - k2 * out[2]) / j
