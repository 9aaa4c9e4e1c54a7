"""The strip-Morison force in MuJoCo: a compiled control callback that never lags, [Yu2016] eqs. (7)-(13).

MuJoCo knows no added mass that accelerates. Here the joint-space acceleration a with it is solved first,

    (M + sum_i J_i^T A_i J_i) a = tau - c + sum_i J_i^T (f_i - A_i b_i),      b_i = J_i' q',

M, c and tau being MuJoCo's inertia, bias and passive, actuator and applied forces, J_i the Jacobian of link i, A_i its
added mass and f_i drag and gyroscopic force. The wrench of each link, f_i - A_i (J_i a + b_i), then goes into
xfrc_applied, and MuJoCo's own acceleration comes out as a. `mjfish.sim.reference` is the same in plain NumPy.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import carray

from mjfish.arrays import FloatArray
from mjfish.compiled import compiled
from mjfish.hydro.force import added_mass, drag, gyroscopic
from mjfish.sim.kinematics import jacobian_of, velocity_of, write_wrench
from mjfish.sim.layout import floats, integers


class Moving(NamedTuple):
    """What `mjfish.hydro.force` reads of a link; parameters stay in the model, which threads share, unwritten."""

    length: float
    density: float
    c_m: float
    c_d: float
    c_f: float
    munk: float
    wetted: float
    u: float
    v: float
    w: float
    added: FloatArray
    node_height: FloatArray
    height_moment: FloatArray


@compiled
def _rigid(model: Any, data: Any, inertia: FloatArray, force: FloatArray) -> None:
    """Unpack M (lower triangle, dense) and sum the forces that are no water's."""
    nv = model.nv
    inertia[:] = 0.0
    counts = carray(integers(model.M_rownnz), nv)
    starts = carray(integers(model.M_rowadr), nv)
    passive = carray(floats(data.qfrc_passive), nv)
    actuator = carray(floats(data.qfrc_actuator), nv)
    applied = carray(floats(data.qfrc_applied), nv)
    bias = carray(floats(data.qfrc_bias), nv)
    for row in range(nv):
        columns = carray(integers(model.M_colind + 4 * starts[row]), counts[row])
        values = carray(floats(data.M + 8 * starts[row]), counts[row])
        for k in range(counts[row]):
            inertia[row, columns[k]] = values[k]
        force[row] = passive[row] + actuator[row] + applied[row] - bias[row]


@compiled
def _add(
    inertia: FloatArray, force: FloatArray, jacobian: FloatArray, chain: Any, depth: int, state: FloatArray,
    a0: float, a1: float, a2: float,
) -> None:  # fmt: skip
    """Add J^T A J to the inertia (lower triangle) and J^T (f - A b) to the force."""
    fx = state[0]
    fy = state[1] - a0 * state[3] - a1 * state[4]
    mz = state[2] - a1 * state[3] - a2 * state[4]
    for k in range(depth):
        row = chain[k]
        py = a0 * jacobian[k, 1] + a1 * jacobian[k, 2]
        pz = a1 * jacobian[k, 1] + a2 * jacobian[k, 2]
        force[row] += jacobian[k, 0] * fx + jacobian[k, 1] * fy + jacobian[k, 2] * mz
        for j in range(k, depth):  # up the chain: smaller dofs, so the lower triangle
            inertia[row, chain[j]] += py * jacobian[j, 1] + pz * jacobian[j, 2]


@compiled
def _solve(matrix: FloatArray, right: FloatArray) -> None:
    """Solve by Cholesky's method in place; `matrix` is given by its lower triangle."""
    n = right.shape[0]
    for i in range(n):
        for j in range(i + 1):
            total = matrix[i, j]
            for k in range(j):
                total -= matrix[i, k] * matrix[j, k]
            matrix[i, j] = np.sqrt(total) if i == j else total / matrix[j, j]
        total = right[i]
        for k in range(i):
            total -= matrix[i, k] * right[k]
        right[i] = total / matrix[i, i]
    for i in range(n - 1, -1, -1):
        total = right[i]
        for k in range(i + 1, n):
            total -= matrix[k, i] * right[k]
        right[i] = total / matrix[i, i]


@compiled
def push(model: Any, data: Any, bodies: FloatArray, water: Any) -> None:
    """Solve for the acceleration and write the wrenches; `bodies` (n,) ids, `water` (n,) `LINK` records."""
    nv = model.nv
    n = bodies.shape[0]
    inertia = np.empty((nv, nv))
    force = np.empty(nv)
    jacobian = np.empty((n, nv, 3))  # of a link's u, v, w, dof by dof up its chain
    chain = np.empty((n, nv), dtype=np.int32)
    depth = np.empty(n, dtype=np.int32)
    state = np.empty((n, 5))  # drag and gyroscopic force; b_i across and about: no water is added along the link
    _rigid(model, data, inertia, force)
    for i in range(n):
        body = int(bodies[i])
        depth[i] = jacobian_of(model, data, body, jacobian[i], chain[i], state[i])
        link = water[i]
        u, v, w = velocity_of(model, data, body)
        moving = Moving(
            link.length, link.density, link.c_m, link.c_d, link.c_f, link.munk, link.wetted, u, v, w, link.added,
            link.node_height, link.height_moment,
        )  # fmt: skip
        drag_x, drag_y, drag_z = drag(moving)
        gyro_x, gyro_y, gyro_z = gyroscopic(moving)
        state[i, 0] = drag_x + gyro_x
        state[i, 1] = drag_y + gyro_y
        state[i, 2] = drag_z + gyro_z
        a0, a1, a2 = added_mass(link)
        _add(inertia, force, jacobian[i], chain[i], depth[i], state[i], a0, a1, a2)
    _solve(inertia, force)
    for i in range(n):
        bv = state[i, 3]
        bw = state[i, 4]
        for k in range(depth[i]):
            bv += jacobian[i, k, 1] * force[chain[i, k]]
            bw += jacobian[i, k, 2] * force[chain[i, k]]
        a0, a1, a2 = added_mass(water[i])
        write_wrench(
            data, int(bodies[i]), state[i, 0], state[i, 1] - a0 * bv - a1 * bw, state[i, 2] - a1 * bv - a2 * bw
        )
