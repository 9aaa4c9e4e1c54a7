"""Head-frame equation of motion, [Yu2016] eqs. (1)-(19) in the plane, solved for the head's acceleration.

    M V_0' = sum_i T_i^T [f_i - gamma_i - (M_i + M_ad,i) b_i],     M = sum_i T_i^T (M_i + M_ad,i) T_i

with V_i = T_i V_0 + (joint rates) and V_i' = T_i V_0' + b_i. The printed gamma_i lacks U x p; here it has it unless the
printed form is asked for, which exists only to show the disagreement (see docs/theory.md).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from mjfish.arrays import FloatArray
from mjfish.compiled import merged
from mjfish.fish import Fish
from mjfish.hydro.force import added_mass, drag_at, gyroscopic, magnitude, sign_change
from mjfish.hydro.load import ANSWER, AT_STATEFUL, LoadBuffers, LoadTable, loads_on

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


class Scratch(NamedTuple):
    """What `derivative` writes on the way, of each link; `posture` and `inertia` depend on the joints' angles alone.

    Attributes:
        posture: (n, 6) cosine and sine of the joint in front; cosine and sine of the link's direction, x and y [m] of
            its origin, in the head's frame.
        inertia: (10,) the inverse of M, row by row of its upper half; of a flexible tail, of M with the deflection
            eliminated, and then the column of the deflection (3,) and its own inertia [kg m2].
        bias: (n, 3) acceleration of the origin that joints and rotation cause, b_i.
        change: (n,) where the flow across changes sign, see `mjfish.hydro.force.sign_change`.
        drag: (n, 3).
        output: (ANSWER,) of a load.
    """

    posture: FloatArray
    inertia: FloatArray
    bias: FloatArray
    change: FloatArray
    drag: FloatArray
    output: FloatArray

    @classmethod
    def of(cls, links: int, kind: Any = np.float64) -> Scratch:
        """Return scratch for a fish of so many links; `kind` of numbers is real or complex."""
        posture, bias, drag = (np.zeros((links, width), dtype=kind) for width in (6, 3, 3))
        return cls(posture, np.zeros(10, dtype=kind), bias, np.zeros(links, dtype=kind), drag, np.zeros(ANSWER))


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
def derivative(system: System, joints: Joints, state: FloatArray, scratch: Scratch, out: FloatArray) -> None:
    """Write the time derivative of the state.

    Args:
        system: fish and loads; the records of the links get their velocities.
        joints: at this instant.
        state: (STATES + memory,), the hidden states of the loads behind those of the fish.
        scratch: overwritten.
        out: (STATES + memory,), written.
    """
    place(system, joints, state, scratch)
    accelerate(system, joints, state, scratch, out)


@merged
def place(system: System, joints: Joints, state: FloatArray, scratch: Scratch) -> None:
    """Write posture and inertia; of the state, only the deflection of a flexible tail has to do with them."""
    links = system.links
    n = links.shape[0]
    x, y, c, s = 0.0, 0.0, 1.0, 0.0
    m00, m01, m02, m11, m12, m22 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    gx, gy, j = 0.0, 0.0, 0.0
    flexible = system.tail[0].real > 0.0
    for i in range(n):
        here = scratch.posture[i]
        if i > 0:
            cj, sj = joints.cos[i - 1], joints.sin[i - 1]
            if flexible and i == n - 1:
                cj = np.cos(joints.angle_last + state[6])
                sj = np.sin(joints.angle_last + state[6])
            length = links[i - 1].length
            x += c * length
            y += s * length
            c, s = c * cj - s * sj, s * cj + c * sj
            here[0], here[1] = cj, sj
        here[2], here[3], here[4], here[5] = c, s, x, y
        mass, my, first, j = inertia_of(links[i])
        # Inertia of the link, turned into the head's frame and moved to the nose.
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
    k0, k1, k2 = 0.0, 0.0, 0.0
    if flexible:  # eliminate the deflection: row and column of the last link's own rotation
        k0, k1, k2 = gx, gy, j + x * gy - y * gx
        m00 -= k0 * k0 / j
        m01 -= k0 * k1 / j
        m02 -= k0 * k2 / j
        m11 -= k1 * k1 / j
        m12 -= k1 * k2 / j
        m22 -= k2 * k2 / j
    # Cramer's rule: M is 3 x 3, symmetric and positive definite.
    c00 = m11 * m22 - m12 * m12
    c01 = m02 * m12 - m01 * m22
    c02 = m01 * m12 - m02 * m11
    scale = 1.0 / (m00 * c00 + m01 * c01 + m02 * c02)
    inverse = scratch.inertia
    inverse[0], inverse[1], inverse[2] = scale * c00, scale * c01, scale * c02
    inverse[3] = scale * (m00 * m22 - m02 * m02)
    inverse[4] = scale * (m01 * m02 - m00 * m12)
    inverse[5] = scale * (m00 * m11 - m01 * m01)
    inverse[6], inverse[7], inverse[8], inverse[9] = k0, k1, k2, j


@merged
def inertia_of(link: Any) -> tuple[Any, Any, Any, Any]:
    """Return of body and added water: mass along and across, first and second moment about the origin of the link."""
    a0, a1, a2 = added_mass(link)
    mc = link.mass * link.com
    return link.mass, link.mass + a0, mc + a1, link.inertia + mc * link.com + a2


@merged
def accelerate(system: System, joints: Joints, state: FloatArray, scratch: Scratch, out: FloatArray) -> None:
    """Write the time derivative of the state of a fish that is placed; see `derivative`.

    Velocities first, then drag, then the rest: a processor then works on the roots and quotients of all links at once.
    """
    links, tail = system.links, system.tail
    n = links.shape[0]
    flexible = tail[0].real > 0.0
    _move(system, joints, state, scratch)
    for i in range(n):
        drag_on = scratch.drag[i]
        drag_on[0], drag_on[1], drag_on[2] = drag_at(links[i], scratch.change[i])
    g0, g1, g2, torque = 0.0, 0.0, 0.0, 0.0
    for i in range(n):
        link, drag_on, bias = links[i], scratch.drag[i], scratch.bias[i]
        u, v, w = link.u, link.v, link.w
        mass, my, first, j = inertia_of(link)
        mc = mass * link.com
        gyro_x, gyro_y, gyro_z = gyroscopic(link)
        fx = w * (mass * v + mc * w) + gyro_x + drag_on[0] - mass * bias[0]
        fy = -mass * w * u + gyro_y + drag_on[1] - my * bias[1] - first * bias[2]
        torque = gyro_z + drag_on[2] - first * bias[1] - j * bias[2]
        if not system.printed:
            torque -= mc * w * u
        hx, hy, hz = _at_nose(scratch.posture[i], fx, fy, torque)
        g0 += hx
        g1 += hy
        g2 += hz
    yaw = state[5].real
    yaw_change = state[5] - yaw  # of a complex state, its derivative; else 0
    heading_cos = np.cos(yaw) - np.sin(yaw) * yaw_change
    heading_sin = np.sin(yaw) + np.cos(yaw) * yaw_change
    if system.loads.addresses.shape[0] > 0:
        load_0, load_1, load_2, load_torque = _loads(
            system, scratch.posture, heading_cos, heading_sin, LoadBuffers(scratch.output, state, out)
        )
        g0 += load_0
        g1 += load_1
        g2 += load_2
        torque += load_torque
    inverse = scratch.inertia
    k0, k1, k2, j = inverse[6], inverse[7], inverse[8], inverse[9]
    if flexible:
        spring = tail[1] + tail[4] * magnitude(state[6]) + tail[3] * state[6] * state[6]
        torque -= spring * state[6] + tail[2] * state[7]
        g0 -= k0 * torque / j
        g1 -= k1 * torque / j
        g2 -= k2 * torque / j
    out[0] = inverse[0] * g0 + inverse[1] * g1 + inverse[2] * g2
    out[1] = inverse[1] * g0 + inverse[3] * g1 + inverse[4] * g2
    out[2] = inverse[2] * g0 + inverse[4] * g1 + inverse[5] * g2
    out[3] = heading_cos * state[0] - heading_sin * state[1]
    out[4] = heading_sin * state[0] + heading_cos * state[1]
    out[5] = state[2]
    out[6], out[7] = 0.0, 0.0
    if flexible:
        out[6] = state[7]
        out[7] = (torque - k0 * out[0] - k1 * out[1] - k2 * out[2]) / j


@merged
def _move(system: System, joints: Joints, state: FloatArray, scratch: Scratch) -> None:
    """Write velocities of the links, nose to tail, their b_i, and where the flow across them changes sign."""
    links = system.links
    n = links.shape[0]
    u, v, w = state[0], state[1], state[2]
    bu, bv, bw = 0.0, 0.0, 0.0
    for i in range(n):
        link, bias = links[i], scratch.bias[i]
        if i > 0:
            c, s = scratch.posture[i, 0], scratch.posture[i, 1]
            turn = joints.rate[i - 1]
            if i == n - 1 and system.tail[0].real > 0.0:
                turn += state[7]
            length = links[i - 1].length
            u, v = next_link(c, s, length, u, v, w)
            bu, bv = next_link(c, s, length, bu, bv, bw)
            bu, bv = bu + turn * v, bv - turn * u  # eq. (4)
            w += turn
            bw += joints.acceleration[i - 1]
        link.u, link.v, link.w = u, v, w
        bias[0], bias[1], bias[2] = bu, bv, bw
        scratch.change[i] = sign_change(v, w, link.length)


@merged
def _at_nose(place_of: FloatArray, fx: Any, fy: Any, mz: Any) -> tuple[Any, Any, Any]:
    """Return a wrench on a link, turned into the head's frame and moved to the nose."""
    c, s, x, y = place_of[2], place_of[3], place_of[4], place_of[5]
    hx = c * fx - s * fy
    hy = s * fx + c * fy
    return hx, hy, mz + x * hy - y * hx


@merged
def _loads(
    system: System, posture: FloatArray, heading_cos: Any, heading_sin: Any, buffers: LoadBuffers
) -> tuple[Any, Any, Any, Any]:
    """Return the wrench of the loads at the nose, and their moment on the last link."""
    links, loads, state = system.links, system.loads, buffers.state
    placed = False
    for k in range(loads.addresses.shape[0]):
        placed = placed or loads.rows[k, AT_STATEFUL] > 0.0
    g0, g1, g2, mz = 0.0, 0.0, 0.0, 0.0
    for i in range(links.shape[0]):
        link, here = links[i], posture[i]
        if placed:
            link.x = -(state[3] + heading_cos * here[4] - heading_sin * here[5])  # of the forward frame: half a turn
            link.y = -(state[4] + heading_sin * here[4] + heading_cos * here[5])
            link.bend = np.arctan2(here[3].real, here[2].real)
            link.heading = state[5] + link.bend
        fx, fy, mz = loads_on(links, i, i, loads, False, buffers)
        hx, hy, hz = _at_nose(here, fx, fy, mz)
        g0 += hx
        g1 += hy
        g2 += hz
    return g0, g1, g2, mz
