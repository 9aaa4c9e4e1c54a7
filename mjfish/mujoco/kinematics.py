"""Kinematics of strips from MuJoCo's data, compiled: their frame, velocity and acceleration, and where a wrench goes.

MuJoCo's spatial vectors (`cvel`, `cdof`: rotation, then translation) have the axes of the world and speak of the point
that is at the centre of mass of the tree. A strips' frame is twelve numbers: its axes x, y, z in the world, and its
origin seen from that point.
"""

from __future__ import annotations

from typing import Any

from numba import carray

from mjfish.arrays import FloatArray
from mjfish.compiled import compiled, inlined
from mjfish.mujoco.layout import floats, integers

#: Numbers of a frame.
FRAME = 12


@compiled
def place(model: Any, data: Any, link: Any, frame: FloatArray) -> None:
    """Fill the frame (FRAME,) of a link's strips."""
    body = int(link.body)
    root = carray(integers(model.body_rootid), body + 1)[body]
    turn = carray(floats(data.xmat + 72 * body), 9)
    at = carray(floats(data.xpos + 24 * body), 3)
    com = carray(floats(data.subtree_com + 24 * root), 3)
    for j in range(3):
        a = turn[3 * j]
        b = turn[3 * j + 1]
        c = turn[3 * j + 2]
        for k in range(3):
            frame[3 * k + j] = a * link.turn[3 * k] + b * link.turn[3 * k + 1] + c * link.turn[3 * k + 2]
        frame[9 + j] = at[j] + a * link.origin[0] + b * link.origin[1] + c * link.origin[2] - com[j]


@inlined
def resolve(motion: FloatArray, frame: FloatArray) -> tuple[float, float, float, float, float, float]:
    """Return a spatial motion as (vx, vy, vz, wx, wy, wz) of the strips' origin, in the strips' frame.

    The same of a spatial acceleration is the rate of those six numbers.
    """
    x = motion[3] + motion[1] * frame[11] - motion[2] * frame[10]
    y = motion[4] + motion[2] * frame[9] - motion[0] * frame[11]
    z = motion[5] + motion[0] * frame[10] - motion[1] * frame[9]
    return (
        frame[0] * x + frame[1] * y + frame[2] * z,
        frame[3] * x + frame[4] * y + frame[5] * z,
        frame[6] * x + frame[7] * y + frame[8] * z,
        frame[0] * motion[0] + frame[1] * motion[1] + frame[2] * motion[2],
        frame[3] * motion[0] + frame[4] * motion[1] + frame[5] * motion[2],
        frame[6] * motion[0] + frame[7] * motion[1] + frame[8] * motion[2],
    )


@compiled
def to_world(wrench: FloatArray, frame: FloatArray, spatial: FloatArray) -> None:
    """Turn a wrench (force, moment; strips' frame and origin) to (moment, force; world's axes, the tree's point)."""
    for j in range(3):
        spatial[3 + j] = frame[j] * wrench[0] + frame[3 + j] * wrench[1] + frame[6 + j] * wrench[2]
        spatial[j] = frame[j] * wrench[3] + frame[3 + j] * wrench[4] + frame[6 + j] * wrench[5]
    spatial[0] += frame[10] * spatial[5] - frame[11] * spatial[4]
    spatial[1] += frame[11] * spatial[3] - frame[9] * spatial[5]
    spatial[2] += frame[9] * spatial[4] - frame[10] * spatial[3]


@compiled
def accelerations(data: Any, carriers: FloatArray, rate: FloatArray, acceleration: FloatArray) -> None:
    """Fill the spatial acceleration (c, 6) of every carrier: sum of cdof_dot qvel + cdof `rate` up its chain.

    Args:
        data: mjData.
        carriers: (c, CARRIER), parents first.
        rate: (nv,) of the generalised velocity; shorter than that means zero: what the bias alone gives.
        acceleration: filled.
    """
    for c in range(carriers.shape[0]):
        parent = int(carriers[c, 1])
        for k in range(6):
            acceleration[c, k] = acceleration[parent, k] if parent >= 0 else 0.0
        first = int(carriers[c, 2])
        for dof in range(first, first + int(carriers[c, 3])):
            change = carray(floats(data.cdof_dot + 48 * dof), 6)
            speed = carray(floats(data.qvel + 8 * dof), 1)[0]
            for k in range(6):
                acceleration[c, k] += change[k] * speed
            if rate.shape[0] > dof:
                axis = carray(floats(data.cdof + 48 * dof), 6)
                for k in range(6):
                    acceleration[c, k] += axis[k] * rate[dof]


@compiled
def add_wrench(model: Any, data: Any, body: int, spatial: FloatArray, sum_: FloatArray) -> None:
    """Add a spatial wrench to `sum_` (6,) as MuJoCo's xfrc_applied has it: force, moment about the body's com."""
    root = carray(integers(model.body_rootid), body + 1)[body]
    point = carray(floats(data.subtree_com + 24 * root), 3)
    com = carray(floats(data.xipos + 24 * body), 3)
    x = point[0] - com[0]
    y = point[1] - com[1]
    z = point[2] - com[2]
    for k in range(3):
        sum_[k] += spatial[3 + k]
        sum_[3 + k] += spatial[k]
    sum_[3] += y * spatial[5] - z * spatial[4]
    sum_[4] += z * spatial[3] - x * spatial[5]
    sum_[5] += x * spatial[4] - y * spatial[3]
