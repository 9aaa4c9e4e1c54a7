"""The water on one link in MuJoCo's world, compiled: forces at the state of mjData, added inertia."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
from numba import carray

from mjfish.arrays import FloatArray
from mjfish.compiled import compiled, inlined
from mjfish.hydro.load import apply_loads
from mjfish.hydro.spatial_force import added_momentum, spatial_drag, spatial_gyroscopic, spatial_munk
from mjfish.mujoco.kinematics import resolve
from mjfish.mujoco.layout import floats

_NO_GRAVITY = int(mujoco.mjtDisableBit.mjDSBL_GRAVITY)


@inlined
def current(model: Any, frame: FloatArray) -> tuple[float, float, float]:
    """Return the velocity of the water, MuJoCo's opt.wind, in the strips' frame [m/s]."""
    x, y, z = model.wind[0], model.wind[1], model.wind[2]
    return (
        frame[0] * x + frame[1] * y + frame[2] * z,
        frame[3] * x + frame[4] * y + frame[5] * z,
        frame[6] * x + frame[7] * y + frame[8] * z,
    )


@inlined
def relative_velocity(
    model: Any, data: Any, link: Any, frame: FloatArray
) -> tuple[float, float, float, float, float, float]:
    """Return the velocity of the strips' origin relative to the water, and the angular velocity, in their frame."""
    vx, vy, vz, wx, wy, wz = resolve(carray(floats(data.cvel + 48 * int(link.body)), 6), frame)
    cx, cy, cz = current(model, frame)
    return vx - cx, vy - cy, vz - cz, wx, wy, wz


@compiled
def other(model: Any, data: Any, link: Any, frame: FloatArray, wrench: FloatArray) -> None:
    """Set `wrench` (6,) to all but the inertial force: drag, gyroscopic, Munk, buoyancy; strips' frame, its origin."""
    vx, vy, vz, wx, wy, wz = relative_velocity(model, data, link, frame)
    fx, fy, fz, mx, my, mz = spatial_drag(link, vx, vy, vz, wx, wy, wz)
    gx, gy, gz, nx, ny, nz = spatial_gyroscopic(link, vy, vz, wx, wy, wz)
    kx, ky, kz = spatial_munk(link, vx, vy, vz, wy, wz)
    bx, by, bz, ox, oy, oz = buoyancy(model, link, frame)
    wrench[0] = fx + gx + bx
    wrench[1] = fy + gy + by
    wrench[2] = fz + gz + bz
    wrench[3] = mx + nx + kx + ox
    wrench[4] = my + ny + ky + oy
    wrench[5] = mz + nz + kz + oz


@compiled
def load(
    model: Any, data: Any, link: Any, frame: FloatArray, seen: Any, hooks: Any, parameters: FloatArray,
    wrench: FloatArray,
) -> None:  # fmt: skip
    """Add to `wrench` (6,) the loads on a link: they see its motion in its plane of x and y, and push in it.

    Args:
        model, data, link, frame: as above.
        seen: (1,) `LINK` record of the link, of this thread's own: its velocity is overwritten.
        hooks, parameters: addresses (k,) and parameters (k, PARAMETERS) of the loads.
        wrench: strips' frame and origin.
    """
    vx, vy, _, _, _, wz = relative_velocity(model, data, link, frame)
    seen[0].u = vx
    seen[0].v = vy
    seen[0].w = wz
    fx, fy, mz = apply_loads(seen, 0, hooks, parameters, np.empty(3))
    wrench[0] += fx
    wrench[1] += fy
    wrench[5] += mz


@inlined
def buoyancy(model: Any, link: Any, frame: FloatArray) -> tuple[float, float, float, float, float, float]:
    """Return force -rho V g [N] at the centre of buoyancy, and its moment about the strips' origin [N m]."""
    weight = -link.density * link.volume
    if model.disableflags & _NO_GRAVITY:
        weight = 0.0
    x, y, z = weight * model.gravity[0], weight * model.gravity[1], weight * model.gravity[2]
    bx = frame[0] * x + frame[1] * y + frame[2] * z
    by = frame[3] * x + frame[4] * y + frame[5] * z
    bz = frame[6] * x + frame[7] * y + frame[8] * z
    dx = link.center[0] - link.origin[0]
    dy = link.center[1] - link.origin[1]
    dz = link.center[2] - link.origin[2]
    rx = link.turn[0] * dx + link.turn[1] * dy + link.turn[2] * dz
    ry = link.turn[3] * dx + link.turn[4] * dy + link.turn[5] * dz
    rz = link.turn[6] * dx + link.turn[7] * dy + link.turn[8] * dz
    return bx, by, bz, ry * bz - rz * by, rz * bx - rx * bz, rx * by - ry * bx


@compiled
def inertial(model: Any, data: Any, link: Any, frame: FloatArray, acceleration: FloatArray, wrench: FloatArray) -> None:
    """Take the rate of the added momentum from `wrench` (6,), at a spatial acceleration of the body.

    What counts is the acceleration relative to the water: in the turning frame a steady current changes as -w x c.
    """
    _, ay, az, dwx, dwy, dwz = resolve(acceleration, frame)
    _, _, _, wx, wy, wz = resolve(carray(floats(data.cvel + 48 * int(link.body)), 6), frame)
    cx, cy, cz = current(model, frame)
    ay += wz * cx - wx * cz
    az += wx * cy - wy * cx
    py, pz, lx, ly, lz = added_momentum(link, ay, az, dwx, dwy, dwz)
    wrench[1] -= py
    wrench[2] -= pz
    wrench[3] -= lx
    wrench[4] -= ly
    wrench[5] -= lz


@compiled
def added_inertia(link: Any, frame: FloatArray, inertia: FloatArray) -> None:
    """Add the added mass of a link to a spatial inertia (36,), about the tree's point.

    A strip at r moves across, along e, by (g + r g')^T of a spatial motion, g = (s x e; e), g' = (e_x x e; 0), s the
    strips' origin: the inertia is the sum over both axes of A_0 g g^T + A_1 (g g'^T + g' g^T) + A_2 g' g'^T, and roll.
    """
    sx, sy, sz = frame[9], frame[10], frame[11]
    c = link.c_m
    for axis in range(2):
        moments = link.added if axis == 0 else link.added_width
        e = 3 + 3 * axis  # y across the height, z across the width
        t = 6 - 3 * axis  # e_x x e_y = e_z, e_x x e_z = -e_y
        sign = 1.0 - 2.0 * axis
        ex, ey, ez = frame[e], frame[e + 1], frame[e + 2]
        g = (sy * ez - sz * ey, sz * ex - sx * ez, sx * ey - sy * ex, ex, ey, ez)
        d = (sign * frame[t], sign * frame[t + 1], sign * frame[t + 2], 0.0, 0.0, 0.0)
        a0, a1, a2 = c * moments[0], c * moments[1], c * moments[2]
        for j in range(6):
            p = a0 * g[j] + a1 * d[j]
            q = a1 * g[j] + a2 * d[j]
            for k in range(6):
                inertia[6 * j + k] += p * g[k] + q * d[k]
    for j in range(3):
        for k in range(3):
            inertia[6 * j + k] += c * link.added_roll * frame[j] * frame[k]
