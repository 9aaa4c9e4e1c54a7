"""Force of the water on a blunt body, by its added mass as a matrix [Lamb, art. 124].

In the body's frame, with v the velocity of its origin relative to the water, w its turning, A the added mass (6, 6),
and the impulses (p, l) = c_m A (v, w), the force and moment of the water are

    inertial    -(p', l')                             into the inertia matrix, solved and never lagged
    gyroscopic  f = -w x p,   m = -w x l
    Munk        m = -kappa v x p                      kappa = 1 Kirchhoff
    drag        f_i = -1/2 rho c_d S_i |v| v_i,   m_i = -1/2 rho c_d T_i |w_i| w_i

with S the areas that the body shows to the water along its axes [m2], and T what turns about them [m5].

An ellipsoid of semi-axes a, b, c has A diagonal [Lamb, art. 114, 115]. With m = 4/3 pi rho a b c, and

    alpha = a b c INT_0^oo ds / ((a^2 + s) sqrt((a^2 + s) (b^2 + s) (c^2 + s)))     beta, gamma alike

it is m alpha / (2 - alpha) along a, and about a, with e = b^2 - c^2,

    m / 5  e^2 (gamma - beta) / (2 e + (b^2 + c^2) (beta - gamma))
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.special import elliprd

from mjfish.numerics.arrays import FloatArray
from mjfish.numerics.compiled import inlined

Vector = tuple[float, float, float]
Six = tuple[float, float, float, float, float, float]

_ROUND = 1e-6  # ellipses whose axes differ by less turn like circles: they move no water


@inlined
def momentum(link: Any, v: Vector, w: Vector) -> Six:
    """Return the impulses p [N s] and l [N m s]; with accelerations in place of velocities, their rates."""
    a = link.matrix
    c = link.c_m
    return (
        c * (a[0] * v[0] + a[1] * v[1] + a[2] * v[2] + a[3] * w[0] + a[4] * w[1] + a[5] * w[2]),
        c * (a[6] * v[0] + a[7] * v[1] + a[8] * v[2] + a[9] * w[0] + a[10] * w[1] + a[11] * w[2]),
        c * (a[12] * v[0] + a[13] * v[1] + a[14] * v[2] + a[15] * w[0] + a[16] * w[1] + a[17] * w[2]),
        c * (a[18] * v[0] + a[19] * v[1] + a[20] * v[2] + a[21] * w[0] + a[22] * w[1] + a[23] * w[2]),
        c * (a[24] * v[0] + a[25] * v[1] + a[26] * v[2] + a[27] * w[0] + a[28] * w[1] + a[29] * w[2]),
        c * (a[30] * v[0] + a[31] * v[1] + a[32] * v[2] + a[33] * w[0] + a[34] * w[1] + a[35] * w[2]),
    )


@inlined
def blunt_drag(link: Any, v: Vector, w: Vector) -> Six:
    """Return force [N] and moment [N m] of the drag."""
    s = link.area
    t = link.turning
    turn = -0.5 * link.density * link.c_d
    push = turn * (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]) ** 0.5
    return (
        push * s[0] * v[0],
        push * s[1] * v[1],
        push * s[2] * v[2],
        turn * t[0] * abs(w[0]) * w[0],
        turn * t[1] * abs(w[1]) * w[1],
        turn * t[2] * abs(w[2]) * w[2],
    )


def ellipsoid_added_mass(semiaxes: Sequence[float], density: float) -> FloatArray:
    """Return the diagonal (6,) of the added mass of an ellipsoid about its middle [kg, kg m2].

    Args:
        semiaxes: (3,) [m].
        density: of the water [kg/m3].
    """
    squares = np.square(semiaxes)
    volume = np.prod(semiaxes)
    mass = 4.0 / 3.0 * np.pi * density * volume
    diagonal = np.zeros(6)
    one, other = np.roll(squares, -1), np.roll(squares, -2)
    share = 2.0 / 3.0 * volume * elliprd(one, other, squares)
    for k in range(3):
        diagonal[k] = mass * share[k] / (2.0 - share[k])
        i, j = (k + 1) % 3, (k + 2) % 3
        e, total = squares[i] - squares[j], squares[i] + squares[j]
        if abs(e) > _ROUND * total:
            change = share[j] - share[i]
            diagonal[3 + k] = mass / 5.0 * e**2 * change / (2.0 * e - total * change)
    return diagonal


def ellipsoid_turning(semiaxes: Sequence[float]) -> FloatArray:
    """Return T (3,) of an ellipsoid [m5]: that of the elliptic plate which a long one is, and nothing for a sphere.

    A plate of semi-axes a, c turns about its c with INT 2 c sqrt(1 - x^2 / a^2) |x|^3 dx = 8 / 15 c a^4; with b^2 taken
    off a^2, as for the roll of strips.
    """
    return np.array(
        [8.0 / 15.0 * semiaxes[k] * (semiaxes[(k + 1) % 3] ** 2 - semiaxes[(k + 2) % 3] ** 2) ** 2 for k in range(3)]
    )
