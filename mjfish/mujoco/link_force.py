"""The force of the water on one link, compiled: at the state that MuJoCo's data is in, and as MuJoCo takes a force.

Vectors (3,) are tuples. MuJoCo's spatial vectors (`cvel`, `cdof`: rotation, then translation) have the axes of the
world and speak of the point that is at the centre of mass of the tree. A strips' frame is twelve numbers: its axes
x, y, z in the world, and its origin seen from that point. A wrench is force, then moment, in the strips' frame about
its origin. Equations: `mjfish.hydro.spatial_force`.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import mujoco
import numpy as np
from numba import carray

from mjfish.hydro.blunt_force import blunt_drag, momentum
from mjfish.hydro.load import ANSWER, LoadBuffers, loads_on
from mjfish.hydro.spatial_force import spatial_drag, spatial_gyroscopic, spatial_munk
from mjfish.mujoco.layout import floats, integers
from mjfish.numerics.arrays import FloatArray
from mjfish.numerics.compiled import compiled, merged

#: Numbers of a strips' frame.
FRAME = 12
_NO_GRAVITY = int(mujoco.mjtDisableBit.mjDSBL_GRAVITY)

Vector = tuple[float, float, float]
Six = tuple[float, float, float, float, float, float]


@merged
def triple(numbers: Any, first: int) -> Vector:
    """Return three numbers of an array."""
    return numbers[first], numbers[first + 1], numbers[first + 2]


@merged
def put(numbers: Any, first: int, vector: Vector) -> None:
    """Write three numbers into an array."""
    numbers[first] = vector[0]
    numbers[first + 1] = vector[1]
    numbers[first + 2] = vector[2]


@compiled
def vector_at(address: int) -> Vector:
    """Return the three numbers at an address."""
    return triple(carray(floats(address), 3), 0)


@merged
def plus(a: Vector, b: Vector) -> Vector:
    """Return a + b."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@merged
def minus(a: Vector, b: Vector) -> Vector:
    """Return a - b."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@merged
def cross(a: Vector, b: Vector) -> Vector:
    """Return a x b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@merged
def rotated(rows: Any, v: Vector) -> Vector:
    """Return R v, R given row by row in the first nine numbers of an array."""
    return (
        rows[0] * v[0] + rows[1] * v[1] + rows[2] * v[2],
        rows[3] * v[0] + rows[4] * v[1] + rows[5] * v[2],
        rows[6] * v[0] + rows[7] * v[1] + rows[8] * v[2],
    )


@merged
def rotated_back(rows: Any, v: Vector) -> Vector:
    """Return R^T v, R as above."""
    return (
        rows[0] * v[0] + rows[3] * v[1] + rows[6] * v[2],
        rows[1] * v[0] + rows[4] * v[1] + rows[7] * v[2],
        rows[2] * v[0] + rows[5] * v[1] + rows[8] * v[2],
    )


@compiled
def tree_center(model: Any, data: Any, body: int) -> Vector:
    """Return the centre of mass of a body's tree in the world, which spatial vectors speak of."""
    root = carray(integers(model.body_rootid), body + 1)[body]
    return vector_at(data.subtree_com + 24 * root)


@compiled
def fill_frame(model: Any, data: Any, link: Any, frame: FloatArray) -> None:
    """Fill the frame (FRAME,) of a link's strips."""
    body = int(link.body)
    turn = carray(floats(data.xmat + 72 * body), 9)
    for axis in range(3):
        put(frame, 3 * axis, rotated(turn, triple(link.turn, 3 * axis)))
    origin = plus(vector_at(data.xpos + 24 * body), rotated(turn, triple(link.origin, 0)))
    put(frame, 9, minus(origin, tree_center(model, data, body)))


@merged
def resolve(motion: FloatArray, frame: FloatArray) -> tuple[Vector, Vector]:
    """Return velocity of the strips' origin and angular velocity, in the strips' frame, of a spatial motion (6,).

    The same of a spatial acceleration is the rate of these.
    """
    spin = triple(motion, 0)
    return rotated(frame, plus(triple(motion, 3), cross(spin, triple(frame, 9)))), rotated(frame, spin)


@compiled
def relative_velocity(model: Any, data: Any, link: Any, frame: FloatArray) -> tuple[Vector, Vector]:
    """Return the velocity of the strips' origin relative to the water, opt.wind, and the angular velocity."""
    velocity, spin = resolve(carray(floats(data.cvel + 48 * int(link.body)), 6), frame)
    return minus(velocity, rotated(frame, triple(model.wind, 0))), spin


@merged
def buoyancy(model: Any, link: Any, frame: FloatArray) -> Six:
    """Return force -rho V g [N] at the centre of buoyancy, and its moment about the strips' origin [N m]."""
    weight = -link.density * link.volume
    if model.disableflags & _NO_GRAVITY:
        weight = 0.0
    gravity = triple(model.gravity, 0)
    force = rotated(frame, (weight * gravity[0], weight * gravity[1], weight * gravity[2]))
    arm = rotated(link.turn, minus(triple(link.center, 0), triple(link.origin, 0)))
    moment = cross(arm, force)
    return force[0], force[1], force[2], moment[0], moment[1], moment[2]


@compiled
def non_inertial(model: Any, data: Any, link: Any, frame: FloatArray) -> tuple[Six, Six, Vector, Six]:
    """Return drag, gyroscopic force, Munk moment and buoyancy."""
    (vx, vy, vz), (wx, wy, wz) = relative_velocity(model, data, link, frame)
    if link.blunt > 0.0:
        velocity, spin = (vx, vy, vz), (wx, wy, wz)
        a, b, c, d, e, f = momentum(link, velocity, spin)
        push, turn, munk = cross((a, b, c), spin), cross((d, e, f), spin), cross((a, b, c), velocity)
        return (
            blunt_drag(link, velocity, spin),
            (push[0], push[1], push[2], turn[0], turn[1], turn[2]),
            (link.munk * munk[0], link.munk * munk[1], link.munk * munk[2]),
            buoyancy(model, link, frame),
        )
    return (
        spatial_drag(link, vx, vy, vz, wx, wy, wz),
        spatial_gyroscopic(link, vy, vz, wx, wy, wz),
        spatial_munk(link, vx, vy, vz, wy, wz),
        buoyancy(model, link, frame),
    )


@compiled
def fill_non_inertial(model: Any, data: Any, link: Any, frame: FloatArray, wrench: FloatArray) -> None:
    """Set `wrench` (6,) to all but the inertial force and the loads."""
    drag, gyroscopic, munk, lift = non_inertial(model, data, link, frame)
    for k in range(6):
        wrench[k] = drag[k] + gyroscopic[k] + lift[k]
    for k in range(3):
        wrench[3 + k] += munk[k]


class LoadScratch(NamedTuple):
    """What a call of the loads on all links needs: not the block's own, as several threads may step copies of a model.

    Attributes:
        seen: (1,) `LINK` record that the loads are called with.
        head: (2,) x, y of the axis of the first link in the world; written where loads read places.
        buffers: hidden states and their rates.
    """

    seen: Any
    head: FloatArray
    buffers: LoadBuffers


@compiled
def load_scratch(data: Any, water: Any, rates: FloatArray) -> LoadScratch:
    """Return scratch for the loads on all links; the rates (states,) of their hidden states will be written."""
    state = carray(floats(data.act + 8 * water.head[0].activation), water.head[0].states)
    seen = water.planes[: min(water.loads.addresses.shape[0], 1)].copy()  # without loads there are none
    return LoadScratch(seen, np.empty(2 if water.head[0].placed else 0), LoadBuffers(np.empty(ANSWER), state, rates))


@compiled
def add_loads(
    model: Any, data: Any, water: Any, index: int, frame: FloatArray, scratch: LoadScratch, wrench: FloatArray
) -> None:
    """Add to `wrench` (6,) the loads on a link: they see its motion in its plane of x and y, and push in it.

    Args:
        model, data: records of MuJoCo's structs.
        water: `mjfish.mujoco.block.Water`.
        index: of the link; the first link comes first, where hidden states are shared.
        frame: (FRAME,) of its strips.
        scratch: of these loads.
        wrench: added to.
    """
    velocity, spin = relative_velocity(model, data, water.links[index], frame)
    scratch.seen[0] = water.planes[index]
    seen = scratch.seen[0]
    seen.u = velocity[0]
    seen.v = velocity[1]
    seen.w = spin[2]
    if water.head[0].placed:
        origin = plus(triple(frame, 9), tree_center(model, data, int(water.links[index].body)))
        seen.x = origin[0]
        seen.y = origin[1]
        seen.heading = np.arctan2(-frame[1], -frame[0])  # ahead is against the strips' x
        head = scratch.head
        if index == 0:
            head[0], head[1] = frame[0], frame[1]
        seen.bend = np.arctan2(head[0] * frame[1] - head[1] * frame[0], head[0] * frame[0] + head[1] * frame[1])
    fx, fy, mz = loads_on(scratch.seen, 0, index, water.loads, False, scratch.buffers)
    wrench[0] += fx
    wrench[1] += fy
    wrench[5] += mz


@compiled
def take_inertial(
    model: Any, data: Any, link: Any, frame: FloatArray, acceleration: FloatArray, wrench: FloatArray
) -> None:
    """Take the rate of the added momentum from `wrench` (6,), at a spatial acceleration of the body.

    What counts is the acceleration relative to the water: in the turning frame a steady current c changes as -w x c.
    """
    rate, spin_rate = resolve(acceleration, frame)
    spin = rotated(frame, vector_at(data.cvel + 48 * int(link.body)))
    rate = plus(rate, cross(spin, rotated(frame, triple(model.wind, 0))))
    impulse = momentum(link, rate, spin_rate)
    for k in range(6):
        wrench[k] -= impulse[k]


@compiled
def add_added_inertia(link: Any, frame: FloatArray, inertia: FloatArray) -> None:
    """Add the added mass A of a link to a spatial inertia (36,), about the tree's point.

    It is T^T A T, where T turns a spatial motion into the velocity of the link's origin.
    """
    turn = np.zeros((6, 6))
    for axis in range(3):
        e = triple(frame, 3 * axis)
        arm = cross(triple(frame, 9), e)
        for k in range(3):
            turn[axis, k] = arm[k]
            turn[axis, 3 + k] = turn[3 + axis, k] = e[k]
    for a in range(6):
        for k in range(6):
            moved = 0.0
            for b in range(6):
                moved += link.c_m * link.matrix[6 * a + b] * turn[b, k]
            for j in range(6):
                inertia[6 * j + k] += turn[a, j] * moved


@compiled
def to_world(wrench: FloatArray, frame: FloatArray, spatial: FloatArray) -> None:
    """Turn a wrench to (moment, force; world's axes, the tree's point)."""
    force = rotated_back(frame, triple(wrench, 0))
    put(spatial, 0, plus(rotated_back(frame, triple(wrench, 3)), cross(triple(frame, 9), force)))
    put(spatial, 3, force)


@compiled
def add_wrench(model: Any, data: Any, body: int, spatial: FloatArray, applied: FloatArray) -> None:
    """Add a spatial wrench to `applied` (6,) as in MuJoCo's xfrc_applied: force, moment about the body's com."""
    arm = minus(tree_center(model, data, body), vector_at(data.xipos + 24 * body))
    force = triple(spatial, 3)
    put(applied, 0, plus(triple(applied, 0), force))
    put(applied, 3, plus(triple(applied, 3), plus(triple(spatial, 0), cross(arm, force))))


@compiled
def add_applied(model: Any, data: Any, body: int, spatial: FloatArray) -> None:
    """Add what a user applies to a body without water, in xfrc_applied, as a spatial wrench about the tree's point."""
    applied = carray(floats(data.xfrc_applied + 48 * body), 6)
    arm = minus(vector_at(data.xipos + 24 * body), tree_center(model, data, body))
    force = triple(applied, 0)
    put(spatial, 0, plus(triple(spatial, 0), plus(triple(applied, 3), cross(arm, force))))
    put(spatial, 3, plus(triple(spatial, 3), force))


@compiled
def fill_accelerations(data: Any, carriers: FloatArray, rate: FloatArray, acceleration: FloatArray) -> None:
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
