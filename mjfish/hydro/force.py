"""Morison force on the strips of one link, [Yu2016] eqs. (7)-(13), in the plane; exact, compiled.

The forces are also compiled for complex numbers whose imaginary part is a derivative (a complex step [Squire1998]),
which is why signs and comparisons look at real parts.

In the link's frame (x towards the tail, origin at the front joint) a strip at r moves across at q = v + w r. With
m_a = c_m rho pi h^2 / 4 per length, added momentum is p_y = INT m_a q dr, and

    drag       fx = -1/2 rho c_f INT p dr |u| u,   fy = -1/2 rho c_d INT h |q| q dr,   mz = the same with r
    gyroscopic fx = w p_y,   mz = -kappa u p_y      (eq. (7), gamma_ad; kappa = 0 a Morison slice, 1 Kirchhoff)

The inertial part, -m_a q', is not here: it goes into the inertia matrix, solved and never lagged.

[Squire1998] W. Squire, G. Trapp: Using complex variables to estimate derivatives of real functions, SIAM Review 40.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from mjfish.fish.outline import INTERVALS
from mjfish.numerics.arrays import FloatArray
from mjfish.numerics.compiled import merged, part

Six = tuple[float, float, float, float, float, float]
#: Keulegan-Carpenter number at which c_d is the one given: of the beating tail of a fish it is about that.
KC_0 = 3.0


@merged
def added_mass(link: Any) -> tuple[float, float, float]:
    """Return A_0, A_1, A_2 = INT m_a r^k dr [kg, kg m, kg m2] of one link record, eq. (8) with c_m."""
    return link.c_m * link.added[0], link.c_m * link.added[1], link.c_m * link.added[2]


@merged
def gyroscopic(link: Any) -> tuple[float, float, float]:
    """Return (fx, fy, mz) [N, N, N m]: minus gamma_ad of eq. (13), with the share `munk` of the Munk moment."""
    a0, a1, _ = added_mass(link)
    momentum = a0 * link.v + a1 * link.w
    return link.w * momentum, 0.0, -link.munk * link.u * momentum


@merged
def drag(link: Any) -> tuple[float, float, float]:
    """Return (fx, fy, mz) [N, N, N m] of friction along and drag across one link, eqs. (9) and (10)."""
    force, moment = crossflow(link.v, link.w, link.length, link.node_height, link.height_moment)
    sway = -0.5 * link.density * link.c_d
    surge = -0.5 * link.density * link.c_f * link.wetted
    return surge * magnitude(link.u) * link.u, sway * force, sway * moment


@merged
def magnitude(x: Any) -> Any:
    """Return |x| of a real number, and its analytic continuation off the real line."""
    return x if x.real >= 0.0 else -x


@merged
def crossflow(v: float, w: float, length: float, node: FloatArray, table: FloatArray) -> tuple[float, float]:
    """Return INT h |q| q dr and INT h |q| q r dr, q = v + w r, exact.

    The integrand changes sign where q does, at r* = -v/w; between sign changes the integral is exact in the moments of
    h, INT h q^2 r^k dr = v^2 H_k + 2 v w H_{k+1} + w^2 H_{k+2}.

    Args:
        v: velocity of the strip at r = 0 [m/s].
        w: its slope along the link [1/s].
        length: of the link [m].
        node: (INTERVALS + 1,) h at the nodes [m], see `mjfish.fish.outline.LinkOutline.node_height`.
        table: (INTERVALS + 1, 4) H_0 .. H_3 up to the nodes.
    """
    vv = v * v
    vw = 2.0 * v * w
    ww = w * w
    full = table[INTERVALS]
    force = vv * full[0] + vw * full[1] + ww * full[2]
    moment = vv * full[1] + vw * full[2] + ww * full[3]
    sign = 1.0 if (v + 0.5 * w * length).real >= 0.0 else -1.0
    if v.real * (v + w * length).real < 0.0:
        h0, h1, h2, h3 = partial_moments(-v / w, length, node, table)
        sign = 1.0 if w.real > 0.0 else -1.0  # behind r* the strip moves with w
        force -= 2.0 * (vv * h0 + vw * h1 + ww * h2)
        moment -= 2.0 * (vv * h1 + vw * h2 + ww * h3)
    return sign * force, sign * moment


@merged
def partial_moments(r: float, length: float, node: FloatArray, table: FloatArray) -> tuple[float, float, float, float]:
    """Return H_k = INT_0^r h r'^k dr', k = 0..3, by Hermite interpolation between exact nodes.

    Nodes are equally spaced in xi = sqrt(r / length): at a blunt nose h goes as xi, and H_0 is then a cubic.
    """
    xi = INTERVALS * np.sqrt(r / length)
    left = min(int(xi.real), INTERVALS - 1)
    s = xi - left
    keep = (1.0 + 2.0 * s) * (1.0 - s) * (1.0 - s)
    slope_left = s * (1.0 - s) * (1.0 - s)
    slope_right = s * s * (s - 1.0)
    scale = length / (INTERVALS * INTERVALS)
    r_left = scale * left * left
    r_right = scale * (left + 1) * (left + 1)
    # dH_k/dxi = h r^k dr/dxi, dr/dxi = 2 scale xi
    p = slope_left * node[left] * 2.0 * scale * left
    q = slope_right * node[left + 1] * 2.0 * scale * (left + 1)
    a = table[left]
    b = table[left + 1]
    h0 = keep * a[0] + (1.0 - keep) * b[0] + p + q
    h1 = keep * a[1] + (1.0 - keep) * b[1] + p * r_left + q * r_right
    h2 = keep * a[2] + (1.0 - keep) * b[2] + p * r_left * r_left + q * r_right * r_right
    h3 = keep * a[3] + (1.0 - keep) * b[3] + p * r_left * r_left * r_left + q * r_right * r_right * r_right
    return h0, h1, h2, h3


@merged
def crossflow_derivatives(v: float, w: float, length: float, node: FloatArray, table: FloatArray) -> Six:
    """Return F = INT h |q| q dr and G = INT h |q| q r dr with their derivatives: F, G, F_v, F_w, G_v, G_w.

    They are the derivatives of `crossflow` as it is computed: where q changes sign at r* = -v/w, the exact integral is
    stationary in r* (q is zero there), but its interpolation in the table is not quite.

    Args:
        v, w, length, node, table: as in `crossflow`.
    """
    vv = v * v
    vw = 2.0 * v * w
    ww = w * w
    h = table[INTERVALS]
    force = vv * h[0] + vw * h[1] + ww * h[2]
    moment = vv * h[1] + vw * h[2] + ww * h[3]
    force_v = 2.0 * (v * h[0] + w * h[1])
    force_w = 2.0 * (v * h[1] + w * h[2])
    moment_v = force_w
    moment_w = 2.0 * (v * h[2] + w * h[3])
    sign = 1.0 if v + 0.5 * w * length >= 0.0 else -1.0
    if v * (v + w * length) < 0.0:
        sign = 1.0 if w > 0.0 else -1.0
        r = -v / w
        h0, h1, h2, h3 = partial_moments(r, length, node, table)
        d0, d1, d2, d3, xi = _partial_moment_rates(r, length, node, table)
        move = -xi / (r * w)  # 2 d xi / d v; d xi / d w is r times that
        force_move = move * (vv * d0 + vw * d1 + ww * d2)
        moment_move = move * (vv * d1 + vw * d2 + ww * d3)
        force -= 2.0 * (vv * h0 + vw * h1 + ww * h2)
        moment -= 2.0 * (vv * h1 + vw * h2 + ww * h3)
        force_v -= 4.0 * (v * h0 + w * h1) + force_move
        force_w -= 4.0 * (v * h1 + w * h2) + r * force_move
        moment_v -= 4.0 * (v * h1 + w * h2) + moment_move
        moment_w -= 4.0 * (v * h2 + w * h3) + r * moment_move
    return sign * force, sign * moment, sign * force_v, sign * force_w, sign * moment_v, sign * moment_w


@merged
def _partial_moment_rates(
    r: float, length: float, node: FloatArray, table: FloatArray
) -> tuple[float, float, float, float, float]:
    """Return d H_k / d xi of the interpolation in `partial_moments`, k = 0..3, and xi."""
    xi = INTERVALS * np.sqrt(r / length)
    left = min(int(xi), INTERVALS - 1)
    s = xi - left
    turn = 6.0 * s * (1.0 - s)
    scale = length / (INTERVALS * INTERVALS)
    r_left = scale * left * left
    r_right = scale * (left + 1) * (left + 1)
    p = (1.0 - s) * (1.0 - 3.0 * s) * node[left] * 2.0 * scale * left
    q = s * (3.0 * s - 2.0) * node[left + 1] * 2.0 * scale * (left + 1)
    a = table[left]
    b = table[left + 1]
    d0 = turn * (b[0] - a[0]) + p + q
    d1 = turn * (b[1] - a[1]) + p * r_left + q * r_right
    d2 = turn * (b[2] - a[2]) + p * r_left * r_left + q * r_right * r_right
    d3 = turn * (b[3] - a[3]) + p * r_left * r_left * r_left + q * r_right * r_right * r_right
    return d0, d1, d2, d3, xi


@part
def crossflow_tangent(link: Any, rate: Any) -> tuple[float, float]:
    """Return the derivatives of F and G of a link along a change of its outline.

    `crossflow` is linear in the tables; the length enters where q changes sign.

    Args:
        link: record, with its velocity.
        rate: record of the rates of change of length, node heights and height moments.
    """
    v, w = link.v, link.w
    force, moment = crossflow(v, w, link.length, rate.node_height, rate.height_moment)
    if rate.length != 0.0 and v * (v + w * link.length) < 0.0:
        h0, h1, h2, h3 = _partial_moments_by_length(-v / w, link.length, link.node_height, link.height_moment)
        scale = -2.0 * rate.length if w > 0.0 else 2.0 * rate.length
        force += scale * (v * v * h0 + 2.0 * v * w * h1 + w * w * h2)
        moment += scale * (v * v * h1 + 2.0 * v * w * h2 + w * w * h3)
    return force, moment


@merged
def _partial_moments_by_length(
    r: float, length: float, node: FloatArray, table: FloatArray
) -> tuple[float, float, float, float]:
    """Return d H_k / d length of the interpolation in `partial_moments`, r and the tables held.

    With xi held, what the heights add to H_k goes as length^(k + 1).
    """
    d0, d1, d2, d3, xi = _partial_moment_rates(r, length, node, table)
    left = min(int(xi), INTERVALS - 1)
    s = xi - left
    scale = length / (INTERVALS * INTERVALS)
    r_left = scale * left * left
    r_right = scale * (left + 1) * (left + 1)
    p = s * (1.0 - s) * (1.0 - s) * node[left] * 2.0 * scale * left
    q = s * s * (s - 1.0) * node[left + 1] * 2.0 * scale * (left + 1)
    move = -0.5 * xi
    return (
        (move * d0 + p + q) / length,
        (move * d1 + 2.0 * (p * r_left + q * r_right)) / length,
        (move * d2 + 3.0 * (p * r_left * r_left + q * r_right * r_right)) / length,
        (move * d3 + 4.0 * (p * r_left * r_left * r_left + q * r_right * r_right * r_right)) / length,
    )
