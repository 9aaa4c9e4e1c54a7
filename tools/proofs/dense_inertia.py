"""The inertia of a model with the added mass of its water, dense: in plain NumPy and MuJoCo's own functions."""

from __future__ import annotations

import mujoco
import numpy as np

from mjfish.mujoco.block import block_of
from mjfish.numerics.arrays import FloatArray, RecordArray


def inertia(model: mujoco.MjModel, data: mujoco.MjData) -> FloatArray:
    """Return M + sum J^T A J (nv, nv), where mjData's own inertia is without water (`mj_makeM`)."""
    total = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, total)
    for link in block_of(model).links:
        J = jacobian_of(model, data, link)
        total += J.T @ inertia_of(link) @ J
    return total


def axes_of(data: mujoco.MjData, link: RecordArray) -> FloatArray:
    """Return the axes (3, 3) of the link's strips in the world, as columns."""
    axes: FloatArray = data.xmat[int(link["body"])].reshape(3, 3) @ link["turn"].reshape(3, 3).T
    return axes


def origin_of(data: mujoco.MjData, link: RecordArray) -> FloatArray:
    """Return the origin (3,) of the link's strips in the world."""
    body = int(link["body"])
    origin: FloatArray = data.xpos[body] + data.xmat[body].reshape(3, 3) @ link["origin"]
    return origin


def jacobian_of(model: mujoco.MjModel, data: mujoco.MjData, link: RecordArray) -> FloatArray:
    """Return J (6, nv): velocity of the strips' origin, then angular velocity, in the strips' frame."""
    linear, angular = np.zeros((3, model.nv)), np.zeros((3, model.nv))
    mujoco.mj_jac(model, data, linear, angular, origin_of(data, link), int(link["body"]))
    axes = axes_of(data, link)
    return np.vstack([axes.T @ linear, axes.T @ angular])


def inertia_of(link: RecordArray) -> FloatArray:
    """Return the added mass (6, 6) of a link about its origin; strips have none along them."""
    if link["blunt"]:
        return np.asarray(link["c_m"] * link["matrix"].reshape(6, 6))
    (y0, y1, y2), (z0, z1, z2) = link["c_m"] * link["added"], link["c_m"] * link["added_width"]
    A = np.zeros((6, 6))
    A[1, 1], A[1, 5], A[5, 1], A[5, 5] = y0, y1, y1, y2
    A[2, 2], A[2, 4], A[4, 2], A[4, 4] = z0, -z1, -z1, z2
    A[3, 3] = link["c_m"] * link["added_roll"]
    return A
