"""The force of the water on each link, part by part, for logs; from the acceleration that MuJoCo found."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
from numba import carray

from mjfish.arrays import FloatArray
from mjfish.compiled import compiled
from mjfish.hydro.spatial_force import spatial_drag, spatial_gyroscopic, spatial_munk
from mjfish.mujoco.block_layout import CARRIER, HEADER, TREE, loads_in
from mjfish.mujoco.kinematics import FRAME, accelerations, add_wrench, place, to_world
from mjfish.mujoco.layout import data_at, floats, links, model_at, verify
from mjfish.mujoco.water import buoyancy, inertial, load, relative_velocity

#: Parts of the force, in the order of the arrays.
PARTS = ("drag", "added_mass", "munk", "buoyancy", "loads")


def wrenches(model: mujoco.MjModel, data: mujoco.MjData, numbers: FloatArray) -> FloatArray:
    """Return the parts (len(PARTS), links, 6) of the force on each link, as in `xfrc_applied`.

    Args:
        model: the model.
        data: after `mj_forward`.
        numbers: the block of the model's water.
    """
    verify()
    parts = np.zeros((len(PARTS), int(numbers[0]), 6))
    _fill(model._address, data._address, numbers.ctypes.data, *loads_in(numbers), parts)
    return parts


@compiled
def _fill(
    model_address: int, data_address: int, address: int, hooks: Any, parameters: FloatArray, plane: Any,
    parts: FloatArray,
) -> None:  # fmt: skip
    model = carray(model_at(np.uint64(model_address)), 1)[0]
    data = carray(data_at(np.uint64(data_address)), 1)[0]
    header = carray(floats(np.uint64(address)), HEADER)
    n, c, t = int(header[0]), int(header[1]), int(header[2])
    carriers = carray(floats(np.uint64(address + 8 * HEADER)), (c, CARRIER))
    water = carray(links(np.uint64(address + 8 * (HEADER + CARRIER * c + TREE * t))), n)
    acceleration = np.empty((c, 6))
    accelerations(data, carriers, carray(floats(data.qacc), model.nv), acceleration)
    frame = np.empty(FRAME)
    wrench = np.empty((5, 6))
    spatial = np.empty(6)
    for i in range(n):
        link = water[i]
        place(model, data, link, frame)
        vx, vy, vz, wx, wy, wz = relative_velocity(model, data, link, frame)
        wrench[0] = _array(spatial_drag(link, vx, vy, vz, wx, wy, wz))
        wrench[1] = _array(spatial_gyroscopic(link, vy, vz, wx, wy, wz))
        inertial(model, data, link, frame, acceleration[int(link.carrier)], wrench[1])
        kx, ky, kz = spatial_munk(link, vx, vy, vz, wy, wz)
        wrench[2] = _array((0.0, 0.0, 0.0, kx, ky, kz))
        wrench[3] = _array(buoyancy(model, link, frame))
        wrench[4] = 0.0
        if hooks.shape[0] > 0:
            load(model, data, link, frame, plane[i : i + 1].copy(), hooks, parameters, wrench[4])
        for part in range(5):
            to_world(wrench[part], frame, spatial)
            add_wrench(model, data, int(link.body), spatial, parts[part, i])


@compiled
def _array(six: Any) -> FloatArray:
    return np.array(six)
