"""Morison force on the strips of one link that moves in space: `mjfish.hydro.force` with both axes of a section.

In the link's frame (x along the strips, z along their height, origin where r = 0) a strip at r moves across its link at
q_y = v_y + w_z r and q_z = v_z - w_y r. Added mass per length is m_y = c_m rho pi h^2 / 4 across the height and
m_z = c_m rho pi w^2 / 4 across the width (h, w: axes of the ellipse), j = c_m rho pi (h^2 - w^2)^2 / 128 in roll. With
mu = (0, m_y q_y, m_z q_z), p = INT mu dr and pi = INT r e_x x mu dr + INT j dr w_x e_x, the force of the water is

    inertial    -(p', pi')                            into the inertia matrix, solved and never lagged
    gyroscopic  f = -w x p,   m_y, m_z of -w x pi         each slice for itself has no moment about e_x
    Munk        m = -kappa INT (v + w x r e_x) x mu dr    kappa = 0 Morison slices, 1 Kirchhoff [Lamb, art. 124]
    drag        f_y = -1/2 rho c_d INT h |q| q_y dr,   f_z = -1/2 rho c_d INT w |q| q_z dr,   |q|^2 = q_y^2 + q_z^2
                f_x = -1/2 rho c_f INT p_s dr |v_x| v_x,    m_x = -1/2 rho c_d d INT (h^2 - w^2)^2 / 32 dr |w_x| w_x

with the moments of f_y, f_z about the origin. m_x is the drag of a plate of height h that turns about its middle, and
nothing for a circle. In the plane all of it is `mjfish.hydro.force`.
"""

from __future__ import annotations

from typing import Any

from mjfish.fish.outline import STRIPS
from mjfish.hydro.force import crossflow
from mjfish.numerics.compiled import inlined

Vector = tuple[float, float, float]
Wrench = tuple[float, float, float, float, float, float]


@inlined
def spatial_drag(link: Any, vx: float, vy: float, vz: float, wx: float, wy: float, wz: float) -> Wrench:
    """Return force [N] and moment about the origin [N m] of friction and drag, at the velocity relative to the water.

    |q| q_y = |q_y| q_y + (|q| - |q_y|) q_y: the first part is exact, the second, which is smooth where it is large, is
    summed over Gauss strips, and is absent in the plane.
    """
    fy, mz = crossflow(vy, wz, link.length, link.node_height, link.height_moment)
    fz = 0.0
    mz_vertical = 0.0
    if vz != 0.0 or wy != 0.0:
        fz, mz_vertical = crossflow(vz, -wy, link.length, link.node_width, link.width_moment)
        for k in range(STRIPS):
            r = link.strip_r[k]
            qy = vy + wz * r
            qz = vz - wy * r
            speed = (qy * qy + qz * qz) ** 0.5
            dy = link.strip_weight[k] * link.strip_height[k] * (speed - abs(qy)) * qy
            dz = link.strip_weight[k] * link.strip_width[k] * (speed - abs(qz)) * qz
            fy += dy
            mz += r * dy
            fz += dz
            mz_vertical += r * dz
    sway = -0.5 * link.density * link.c_d
    surge = -0.5 * link.density * link.c_f * link.wetted
    roll = sway * link.roll_damping * link.roll_drag
    return surge * abs(vx) * vx, sway * fy, sway * fz, roll * abs(wx) * wx, -sway * mz_vertical, sway * mz


@inlined
def added_momentum(
    link: Any, vy: float, vz: float, wx: float, wy: float, wz: float
) -> tuple[float, float, float, float, float]:
    """Return p_y, p_z [N s] and pi_x, pi_y, pi_z [N m s]; with accelerations in place of velocities, their rates."""
    y = link.added
    z = link.added_width
    c = link.c_m
    return (
        c * (y[0] * vy + y[1] * wz),
        c * (z[0] * vz - z[1] * wy),
        c * link.added_roll * wx,
        -c * (z[1] * vz - z[2] * wy),
        c * (y[1] * vy + y[2] * wz),
    )


@inlined
def spatial_gyroscopic(link: Any, vy: float, vz: float, wx: float, wy: float, wz: float) -> Wrench:
    """Return force [N] and moment [N m] of the added momentum that turns with the link; the Munk part is not in it."""
    py, pz, lx, ly, lz = added_momentum(link, vy, vz, wx, wy, wz)
    return wz * py - wy * pz, wx * pz, -wx * py, 0.0, wx * lz - wz * lx, wy * lx - wx * ly


@inlined
def spatial_munk(link: Any, vx: float, vy: float, vz: float, wy: float, wz: float) -> Vector:
    """Return the Munk moment [N m]: slices that do not move along their momentum are turned broadside.

    About e_x it is -kappa INT (m_z - m_y) q_y q_z dr.
    """
    py, pz, _, _, _ = added_momentum(link, vy, vz, 0.0, wy, wz)
    y = link.added
    z = link.added_width
    roll = vy * vz * (z[0] - y[0]) + (wz * vz - vy * wy) * (z[1] - y[1]) - wy * wz * (z[2] - y[2])
    return -link.munk * link.c_m * roll, link.munk * vx * pz, -link.munk * vx * py
