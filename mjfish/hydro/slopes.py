"""Derivatives of the drag across one link: of `mjfish.hydro.force.crossflow` as it is computed, table and all.

Between sign changes INT h |q| q r^k dr is a quadratic form in (v, w). Where q changes sign at r* = -v/w, r* moves too:
the exact integral does not see that, for q is zero there, its interpolation in a table does, by its own small error.

[Squire1998] W. Squire, G. Trapp: Using complex variables to estimate derivatives of real functions, SIAM Review 40.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from mjfish.arrays import FloatArray
from mjfish.compiled import borrowing, merged
from mjfish.hydro.force import crossflow
from mjfish.hydro.outline import INTERVALS

Six = tuple[float, float, float, float, float, float]
Three = tuple[float, float, float]
_TINY = 1e-30


@merged
def crossflow_slopes(v: float, w: float, length: float, node: FloatArray, table: FloatArray) -> Six:
    """Return INT h |q| q dr and INT h |q| q r dr, and their derivatives by v and by w: F, G, F_v, F_w, G_v, G_w.

    Args:
        v, w, length, node, table: as in `mjfish.hydro.force.crossflow`.
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
        xi = INTERVALS * np.sqrt(r / length)
        left = min(int(xi), INTERVALS - 1)
        s = xi - left
        keep = (1.0 + 2.0 * s) * (1.0 - s) * (1.0 - s)
        turn = 6.0 * s * (1.0 - s)
        scale = 2.0 * length / (INTERVALS * INTERVALS)
        r_left = 0.5 * scale * left * left
        r_right = 0.5 * scale * (left + 1) * (left + 1)
        a = table[left]
        b = table[left + 1]
        p0 = scale * left * node[left]  # slopes of H_k by xi at both nodes
        q0 = scale * (left + 1) * node[left + 1]
        p1, q1 = p0 * r_left, q0 * r_right
        p2, q2 = p1 * r_left, q1 * r_right
        p3, q3 = p2 * r_left, q2 * r_right
        rise, fall = s * (1.0 - s) * (1.0 - s), s * s * (s - 1.0)
        rise_turn, fall_turn = (1.0 - s) * (1.0 - 3.0 * s), s * (3.0 * s - 2.0)
        h0 = keep * a[0] + (1.0 - keep) * b[0] + rise * p0 + fall * q0
        h1 = keep * a[1] + (1.0 - keep) * b[1] + rise * p1 + fall * q1
        h2 = keep * a[2] + (1.0 - keep) * b[2] + rise * p2 + fall * q2
        h3 = keep * a[3] + (1.0 - keep) * b[3] + rise * p3 + fall * q3
        d0 = turn * (b[0] - a[0]) + rise_turn * p0 + fall_turn * q0
        d1 = turn * (b[1] - a[1]) + rise_turn * p1 + fall_turn * q1
        d2 = turn * (b[2] - a[2]) + rise_turn * p2 + fall_turn * q2
        d3 = turn * (b[3] - a[3]) + rise_turn * p3 + fall_turn * q3
        moved = -xi / (r * w)  # 2 d xi / d v; d xi / d w is r times that
        off_force = moved * (vv * d0 + vw * d1 + ww * d2)
        off_moment = moved * (vv * d1 + vw * d2 + ww * d3)
        force -= 2.0 * (vv * h0 + vw * h1 + ww * h2)
        moment -= 2.0 * (vv * h1 + vw * h2 + ww * h3)
        force_v -= 4.0 * (v * h0 + w * h1) + off_force
        force_w -= 4.0 * (v * h1 + w * h2) + r * off_force
        moment_v -= 4.0 * (v * h1 + w * h2) + off_moment
        moment_w -= 4.0 * (v * h2 + w * h3) + r * off_moment
    return sign * force, sign * moment, sign * force_v, sign * force_w, sign * moment_v, sign * moment_w


@borrowing
def crossflow_along(
    v: float, w: float, length: float, node: FloatArray, table: FloatArray,
    longer: float, wider: FloatArray, more: FloatArray,
) -> tuple[float, float]:  # fmt: skip
    """Return the derivatives of F and G along a change of the outline.

    It is linear in the tables; by the length, a complex step: f(x + i e) = f(x) + i e f'(x) [Squire1998].

    Args:
        v, w, length, node, table: as in `mjfish.hydro.force.crossflow`.
        longer, wider, more: rates of change of length, node and table.
    """
    force, moment = crossflow(v, w, length, wider, more)
    if longer != 0.0:
        function: Any = crossflow
        f, g = function(v, w, complex(length, _TINY), node, table)
        force += longer * f.imag / _TINY
        moment += longer * g.imag / _TINY
    return force, moment
