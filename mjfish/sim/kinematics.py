"""Kinematics of a link from MuJoCo's data, compiled: velocity, Jacobian, and where its wrench goes.

The link's frame sits at the body's origin; its x and y are minus the body's, which is half a turn about z, as in
`mjfish.frames`. Velocities, accelerations and forces of a link are those of its plane: u, v along x, y and w about z.
"""

from __future__ import annotations

from typing import Any

from numba import carray

from mjfish.arrays import FloatArray
from mjfish.compiled import compiled
from mjfish.sim.layout import floats, integers


@compiled
def _frame(data: Any, body: int, root: int) -> tuple[float, float, float, FloatArray]:
    """Return the link's origin seen from the centre of mass of its tree, where cdof and cvel speak, and its axes."""
    origin = carray(floats(data.xpos + 24 * body), 3)
    com = carray(floats(data.subtree_com + 24 * root), 3)
    return origin[0] - com[0], origin[1] - com[1], origin[2] - com[2], carray(floats(data.xmat + 72 * body), 9)


@compiled
def _project(motion: FloatArray, x: float, y: float, z: float, axes: FloatArray) -> tuple[float, float, float]:
    """Return (u, v, w) at the link's origin of a spatial motion; the link's x and y are minus the body's (`frames`)."""
    vx = motion[3] + motion[1] * z - motion[2] * y
    vy = motion[4] + motion[2] * x - motion[0] * z
    vz = motion[5] + motion[0] * y - motion[1] * x
    u = -(axes[0] * vx + axes[3] * vy + axes[6] * vz)
    v = -(axes[1] * vx + axes[4] * vy + axes[7] * vz)
    return u, v, axes[2] * motion[0] + axes[5] * motion[1] + axes[8] * motion[2]


@compiled
def velocity_of(model: Any, data: Any, body: int) -> tuple[float, float, float]:
    """Return the velocity of the link's origin in the link's frame."""
    root = carray(integers(model.body_rootid + 4 * body), 1)[0]
    x, y, z, axes = _frame(data, body, root)
    return _project(carray(floats(data.cvel + 48 * body), 6), x, y, z, axes)


@compiled
def jacobian_of(model: Any, data: Any, body: int, jacobian: FloatArray, chain: Any, state: FloatArray) -> int:
    """Fill the Jacobian of a link and b = J' q' of v and w (state[3:]); return the number of dofs above it."""
    counts = carray(integers(model.body_dofnum), body + 1)
    first = carray(integers(model.body_dofadr), body + 1)
    parents = carray(integers(model.body_parentid), body + 1)
    above = carray(integers(model.dof_parentid), model.nv)
    speed = carray(floats(data.qvel), model.nv)
    x, y, z, axes = _frame(data, body, carray(integers(model.body_rootid + 4 * body), 1)[0])
    holder = body
    while holder > 0 and counts[holder] == 0:
        holder = parents[holder]
    dof = first[holder] + counts[holder] - 1 if holder > 0 else -1
    depth = 0
    bv = 0.0
    bw = 0.0
    while dof >= 0:
        chain[depth] = dof
        motion = carray(floats(data.cdof + 48 * dof), 6)
        jacobian[depth, 0], jacobian[depth, 1], jacobian[depth, 2] = _project(motion, x, y, z, axes)
        # Spatial acceleration, so that its projection is the rate of (u, v, w) in the turning link frame.
        _, dv, dw = _project(carray(floats(data.cdof_dot + 48 * dof), 6), x, y, z, axes)
        bv += dv * speed[dof]
        bw += dw * speed[dof]
        depth += 1
        dof = above[dof]
    state[3] = bv
    state[4] = bw
    return depth


@compiled
def write_wrench(data: Any, body: int, fx: float, fy: float, mz: float) -> None:
    """Write a wrench about the link's origin, in the link's frame, as MuJoCo wants it: at the body's com, in world."""
    axes = carray(floats(data.xmat + 72 * body), 9)
    origin = carray(floats(data.xpos + 24 * body), 3)
    com = carray(floats(data.xipos + 24 * body), 3)
    applied = carray(floats(data.xfrc_applied + 48 * body), 6)
    gx = -axes[0] * fx - axes[1] * fy
    gy = -axes[3] * fx - axes[4] * fy
    gz = -axes[6] * fx - axes[7] * fy
    x = origin[0] - com[0]
    y = origin[1] - com[1]
    z = origin[2] - com[2]
    applied[0] = gx
    applied[1] = gy
    applied[2] = gz
    applied[3] = axes[2] * mz + y * gz - z * gy
    applied[4] = axes[5] * mz + z * gx - x * gz
    applied[5] = axes[8] * mz + x * gy - y * gx
