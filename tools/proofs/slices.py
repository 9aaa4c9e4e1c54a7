"""Water as slices, a second time: no formula of `mjfish.hydro` or `mjfish.mujoco`, slow, differentiated numerically.

A slice at station r is a thin plate of water that only knows the momentum mu = m_y q_y e_y + m_z q_z e_z and the spin
j w_x e_x, seen from a frame that drifts with the water. Its force is minus their rate. With kappa = 0 each slice pushes
where it is; with kappa = 1 the moment is minus the rate of the impulse about a point fixed there (Lamb, art. 119).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from scipy import integrate

from mjfish.numerics.arrays import FloatArray

_POINTS, _WEIGHTS = np.polynomial.legendre.leggauss(8)
#: Sixth-order central difference.
_STENCIL = ((1, 0.75), (2, -0.15), (3, 1.0 / 60.0))
_DENSITY = 1000.0


@dataclass(frozen=True, eq=False)
class Strips:
    """Slices of one link.

    Attributes:
        length: [m].
        stations, heights, widths: the outline, linear in between [m].
        r, weight: (k,) Gauss stations, exact for what is a polynomial between stations [m].
        m_y, m_z, j: (k,) added mass per length across the height and across the width [kg/m], in roll [kg m].
        origin, frame: in the body: (3,), and (3, 3) with the axes as columns.
        c_d, c_f, kappa, roll_damping: coefficients.
    """

    length: float
    stations: FloatArray
    heights: FloatArray
    widths: FloatArray
    r: FloatArray
    weight: FloatArray
    m_y: FloatArray
    m_z: FloatArray
    j: FloatArray
    origin: FloatArray
    frame: FloatArray
    c_d: float
    c_f: float
    kappa: float
    roll_damping: float


def strips(link: Mapping[str, Any]) -> Strips:
    """Cut a link, as `StripLink` takes it, into slices."""
    stations = np.array(link.get("station", (0.0, link["length"])))
    heights, widths = (np.broadcast_to(link[key], stations.shape).astype(float) for key in ("height", "width"))
    r = np.concatenate([0.5 * (a + b) + 0.5 * (b - a) * _POINTS for a, b in pairwise(stations)])
    weight = np.concatenate([0.5 * (b - a) * _WEIGHTS for a, b in pairwise(stations)])
    a, b = 0.5 * np.interp(r, stations, heights), 0.5 * np.interp(r, stations, widths)
    x = np.array(link.get("axis", (-1.0, 0.0, 0.0)), dtype=float)
    x /= np.linalg.norm(x)
    y = np.cross(np.array(link.get("up", (0.0, 0.0, 1.0)), dtype=float), x)
    y /= np.linalg.norm(y)
    water = _DENSITY * link.get("c_m", 1.0) * np.pi
    return Strips(
        link["length"], stations, heights, widths, r, weight, water * a**2, water * b**2,
        water / 8.0 * (a**2 - b**2) ** 2, np.array(link.get("origin", (0.0, 0.0, 0.0))),
        np.column_stack([x, y, np.cross(x, y)]), link.get("c_d", 1.0), link.get("c_f", 0.01),
        link.get("munk_moment", 0.0), link.get("roll_damping", 1.0),
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class Motion:
    """Where a link's strips are and how they move, seen from the frame that drifts with the water.

    Attributes:
        point: (3,) the origin of the strips.
        axes: (3, 3) their axes, as columns.
        velocity, omega: (3,) of the origin; of the turning.
    """

    point: FloatArray
    axes: FloatArray
    velocity: FloatArray
    omega: FloatArray


def across(one: Strips, motion: Motion) -> tuple[FloatArray, FloatArray]:
    """Return q_y and q_z (k,) of the slices."""
    arms = one.r[:, None] * motion.axes[:, 0]
    moving = motion.velocity + np.cross(motion.omega, arms)
    return moving @ motion.axes[:, 1], moving @ motion.axes[:, 2]


def momenta(one: Strips, motion: Motion) -> FloatArray:
    """Return the momentum (k, 3) of each slice, its weight in it."""
    q_y, q_z = across(one, motion)
    parts = (one.m_y * q_y)[:, None] * motion.axes[:, 1] + (one.m_z * q_z)[:, None] * motion.axes[:, 2]
    return np.asarray(one.weight[:, None] * parts)


def spin(one: Strips, motion: Motion) -> FloatArray:
    """Return the angular momentum (3,) of the slices about their own middles."""
    along = motion.axes[:, 0]
    return float(one.weight @ one.j) * float(motion.omega @ along) * along


def impulse(one: Strips, motion: Motion) -> tuple[FloatArray, FloatArray]:
    """Return momentum, and angular momentum about the frame's zero point, of all slices."""
    parts = momenta(one, motion)
    places = motion.point + one.r[:, None] * motion.axes[:, 0]
    return parts.sum(axis=0), np.cross(places, parts).sum(axis=0) + spin(one, motion)


def energy(one: Strips, motion: Motion) -> float:
    """Return the kinetic energy of the water [J]."""
    q_y, q_z = across(one, motion)
    turning = float(motion.omega @ motion.axes[:, 0])
    return 0.5 * float(one.weight @ (one.m_y * q_y**2 + one.m_z * q_z**2 + one.j * turning**2))


def rate(of: Callable[[float], FloatArray], step: float = 2e-3) -> FloatArray:
    """Return the derivative at zero of a function of time, sixth order."""
    return np.asarray(sum(c * (of(k * step) - of(-k * step)) for k, c in _STENCIL) / step)


def inertial_wrench(one: Strips, motion: Callable[[float], Motion], kappa: float) -> FloatArray:
    """Return force and moment (6,) of the added mass about the strips' origin at time zero, in `motion`'s axes."""
    pushes = -rate(lambda t: momenta(one, motion(t)))
    now = motion(0.0)
    arms = one.r[:, None] * now.axes[:, 0]
    sliced = np.cross(arms, pushes).sum(axis=0) - rate(lambda t: spin(one, motion(t)))
    ideal = -rate(lambda t: impulse(one, _seen_from(now.point, motion(t)))[1])
    return np.concatenate([pushes.sum(axis=0), (1.0 - kappa) * sliced + kappa * ideal])


def _seen_from(point: FloatArray, motion: Motion) -> Motion:
    return Motion(motion.point - point, motion.axes, motion.velocity, motion.omega)


def drag_wrench(one: Strips, motion: Motion) -> FloatArray:
    """Return force and moment (6,) of friction and drag about the strips' origin, by adaptive quadrature."""
    v, w = motion.axes.T @ motion.velocity, motion.axes.T @ motion.omega
    kinks = [*one.stations[1:-1], *(-a / b for a, b in ((v[1], w[2]), (v[2], -w[1])) if b)]
    inside = sorted({float(k) for k in kinks if 0.0 < k < one.length})

    def summed(extent: FloatArray, axis: int, power: int) -> float:
        def integrand(r: float) -> float:
            q = (v[1] + w[2] * r, v[2] - w[1] * r)
            return float(np.interp(r, one.stations, extent) * np.hypot(*q) * q[axis] * r**power)

        ends = [0.0, *inside, one.length]
        return sum(integrate.quad(integrand, a, b, epsabs=1e-13, epsrel=1e-11, limit=200)[0] for a, b in pairwise(ends))

    k = -0.5 * _DENSITY * one.c_d
    a, b = 0.5 * np.interp(one.r, one.stations, one.heights), 0.5 * np.interp(one.r, one.stations, one.widths)
    wetted = one.weight @ (np.pi * (3 * (a + b) - np.sqrt((3 * a + b) * (a + 3 * b))))
    plate = one.weight @ ((a**2 - b**2) ** 2 / 2.0)  # INT |s|^3 ds over a plate of height 2a, a^4 -> (a^2 - b^2)^2
    local = (
        -0.5 * _DENSITY * one.c_f * wetted * abs(v[0]) * v[0],
        k * summed(one.heights, 0, 0),
        k * summed(one.widths, 1, 0),
        k * one.roll_damping * plate * abs(w[0]) * w[0],
        -k * summed(one.widths, 1, 1),
        k * summed(one.heights, 0, 1),
    )
    return np.concatenate([motion.axes @ local[:3], motion.axes @ local[3:]])
