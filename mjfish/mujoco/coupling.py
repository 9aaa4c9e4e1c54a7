"""Two couplings of the same water to MuJoCo's equation of motion, compiled; neither lags.

With M, c, tau MuJoCo's inertia, bias and other forces, J_i the Jacobian of link i, A_i its added mass, f_i its drag,
gyroscopic, Munk and buoyancy force and b_i = J_i' q' its acceleration at q'' = 0, the acceleration a is that of

    (M + sum_i J_i^T A_i J_i) a = tau - c + sum_i J_i^T (f_i - A_i b_i)

inertia  M + sum J^T A J takes the place of M in mjData, f - A b goes into xfrc_applied: the integrator, the solver of
         constraints and the derivatives all see the added mass.
xfrc     a is solved here, and the whole wrench f - A (J a + b) goes into xfrc_applied; MuJoCo finds a again wherever
         its acceleration is M^-1 (forces), see `mjfish.mujoco.coupling_choice`.

J^T A J couples a body with its ancestors only, as M does; like M it is summed up the tree (composite bodies).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import carray

from mjfish.mujoco.layout import cholesky, cholesky_solve, factor_inertia, floats, fwd_actuation, integers, make_inertia
from mjfish.mujoco.link_force import (
    FRAME,
    Six,
    add_added_inertia,
    add_applied,
    add_loads,
    add_wrench,
    fill_accelerations,
    fill_frame,
    fill_non_inertial,
    load_scratch,
    take_inertial,
    to_world,
)
from mjfish.numerics.arrays import FloatArray
from mjfish.numerics.compiled import compiled, inlined

_NO_RATE = np.zeros(0)


@compiled
def couple(model: Any, data: Any, water: Any, model_pointer: Any, data_pointer: Any) -> None:
    """Let the water act on one model: write `xfrc_applied` of its bodies, and with coupling "inertia" the inertia.

    And the rates of hidden states of loads, into `ctrl`.

    Args:
        model, data: records of MuJoCo's structs.
        water: `mjfish.mujoco.block.Water`.
        model_pointer, data_pointer: the structs themselves, for MuJoCo's own functions.
    """
    carriers = water.carriers
    c = carriers.shape[0]
    n = water.links.shape[0]
    frame = np.empty((n, FRAME))
    force = np.empty((n, 6))  # f of each link, in its strips' frame
    wrench = np.empty((n, 6))  # f - A b
    rates = carray(
        floats(data.ctrl + 8 * water.head[0].control), water.head[0].states
    )  # of hidden states: see mjfish.mujoco.memory
    scratch = load_scratch(data, water, rates)
    spatial = np.empty(6)
    acceleration = np.empty((c, 6))
    composite = np.zeros((c, 36))
    fill_accelerations(data, carriers, _NO_RATE, acceleration)
    for i in range(n):
        link = water.links[i]
        carrier = int(link.carrier)
        fill_frame(model, data, link, frame[i])
        fill_non_inertial(model, data, link, frame[i], force[i])
        if water.loads.addresses.shape[0] > 0:
            add_loads(model, data, water, i, frame[i], scratch, force[i])
        wrench[i] = force[i]
        take_inertial(model, data, link, frame[i], acceleration[carrier], wrench[i])
        add_added_inertia(link, frame[i], composite[carrier])
    for row in range(c - 1, -1, -1):
        parent = int(carriers[row, 1])
        if parent >= 0:
            for k in range(36):
                composite[parent, k] += composite[row, k]
    if water.head[0].inertia:
        make_inertia(model_pointer, data_pointer)
        _inject(model, data, carriers, composite)
        factor_inertia(model_pointer, data_pointer)
    else:
        fwd_actuation(model_pointer, data_pointer)  # qfrc_actuator is that of the step before
        rate = np.zeros(model.nv)
        _fill_force(model, data, water, frame, wrench, rate)
        for t in range(water.trees.shape[0]):
            first = int(water.trees[t, 0])
            _solve(model, data, first, first + int(water.trees[t, 1]), carriers, composite, rate)
        fill_accelerations(data, carriers, rate, acceleration)
        for i in range(n):
            link = water.links[i]
            wrench[i] = force[i]
            take_inertial(model, data, link, frame[i], acceleration[int(link.carrier)], wrench[i])
    for i in range(n):
        carray(floats(data.xfrc_applied + 48 * int(water.links[i].body)), 6)[:] = 0.0
    for i in range(n):
        body = int(water.links[i].body)
        to_world(wrench[i], frame[i], spatial)
        add_wrench(model, data, body, spatial, carray(floats(data.xfrc_applied + 48 * body), 6))


@compiled
def _inject(model: Any, data: Any, carriers: FloatArray, composite: FloatArray) -> None:
    """Add sum J^T A J to mjData's inertia: sparse rows, ancestors in rising order, the diagonal last."""
    above = carray(integers(model.dof_parentid), model.nv)
    counts = carray(integers(model.M_rownnz), model.nv)
    starts = carray(integers(model.M_rowadr), model.nv)
    for row in range(carriers.shape[0]):
        first = int(carriers[row, 2])
        for dof in range(first, first + int(carriers[row, 3])):
            momentum = _momentum(data, dof, composite[row])
            at = starts[dof] + counts[dof] - 1
            column = dof
            while column >= 0:
                carray(floats(data.M + 8 * at), 1)[0] += _component(data, column, momentum)
                at -= 1
                column = above[column]


@compiled
def _momentum(data: Any, dof: int, inertia: FloatArray) -> Six:
    """Return the added momentum of a composite body that moves with one dof."""
    axis = carray(floats(data.cdof + 48 * dof), 6)
    a, b, c, d, e, f = axis[0], axis[1], axis[2], axis[3], axis[4], axis[5]
    return (
        inertia[0] * a + inertia[1] * b + inertia[2] * c + inertia[3] * d + inertia[4] * e + inertia[5] * f,
        inertia[6] * a + inertia[7] * b + inertia[8] * c + inertia[9] * d + inertia[10] * e + inertia[11] * f,
        inertia[12] * a + inertia[13] * b + inertia[14] * c + inertia[15] * d + inertia[16] * e + inertia[17] * f,
        inertia[18] * a + inertia[19] * b + inertia[20] * c + inertia[21] * d + inertia[22] * e + inertia[23] * f,
        inertia[24] * a + inertia[25] * b + inertia[26] * c + inertia[27] * d + inertia[28] * e + inertia[29] * f,
        inertia[30] * a + inertia[31] * b + inertia[32] * c + inertia[33] * d + inertia[34] * e + inertia[35] * f,
    )


@inlined
def _component(data: Any, dof: int, momentum: Six) -> float:
    """Return the component of a spatial momentum along one dof: an entry of J^T A J."""
    axis = carray(floats(data.cdof + 48 * dof), 6)
    return (  # type: ignore[no-any-return]
        momentum[0] * axis[0] + momentum[1] * axis[1] + momentum[2] * axis[2]
        + momentum[3] * axis[3] + momentum[4] * axis[4] + momentum[5] * axis[5]
    )  # fmt: skip


@compiled
def _fill_force(model: Any, data: Any, water: Any, frame: FloatArray, wrench: FloatArray, force: FloatArray) -> None:
    """Fill the generalised force of everything but the added mass, on the dofs of the carriers."""
    passive = carray(floats(data.qfrc_passive), model.nv)
    actuator = carray(floats(data.qfrc_actuator), model.nv)
    applied = carray(floats(data.qfrc_applied), model.nv)
    bias = carray(floats(data.qfrc_bias), model.nv)
    carriers = water.carriers
    total = np.zeros((carriers.shape[0], 6))
    spatial = np.empty(6)
    wet = np.zeros(carriers.shape[0], dtype=np.bool_)
    for i in range(water.links.shape[0]):
        to_world(wrench[i], frame[i], spatial)
        carrier = int(water.links[i].carrier)
        wet[carrier] = True
        for k in range(6):
            total[carrier, k] += spatial[k]
    for row in range(carriers.shape[0] - 1, -1, -1):
        if not wet[row]:
            add_applied(model, data, int(carriers[row, 0]), total[row])
        first = int(carriers[row, 2])
        for dof in range(first, first + int(carriers[row, 3])):
            axis = carray(floats(data.cdof + 48 * dof), 6)
            force[dof] = passive[dof] + actuator[dof] + applied[dof] - bias[dof]
            for k in range(6):
                force[dof] += axis[k] * total[row, k]
        parent = int(carriers[row, 1])
        if parent >= 0:
            for k in range(6):
                total[parent, k] += total[row, k]


@compiled
def _solve(
    model: Any, data: Any, first: int, end: int, carriers: FloatArray, composite: FloatArray, force: FloatArray
) -> None:
    """Solve (M + sum J^T A J) a = force in place for the dofs of one tree; their inertia is below the diagonal."""
    n = end - first
    above = carray(integers(model.dof_parentid), model.nv)
    counts = carray(integers(model.M_rownnz), model.nv)
    starts = carray(integers(model.M_rowadr), model.nv)
    matrix = np.zeros((n, n))
    for dof in range(first, end):
        columns = carray(integers(model.M_colind + 4 * starts[dof]), counts[dof])
        entries = carray(floats(data.M + 8 * starts[dof]), counts[dof])
        for k in range(counts[dof]):
            matrix[dof - first, columns[k] - first] = entries[k]
    for row in range(carriers.shape[0]):
        lowest = int(carriers[row, 2])
        if lowest < first or lowest >= end:
            continue
        for dof in range(lowest, lowest + int(carriers[row, 3])):
            momentum = _momentum(data, dof, composite[row])
            column = dof
            while column >= 0:
                matrix[dof - first, column - first] += _component(data, column, momentum)
                column = above[column]
    solved = force[first:end]
    cholesky(floats(matrix.ctypes.data), n, 0.0)
    cholesky_solve(floats(solved.ctypes.data), floats(matrix.ctypes.data), floats(solved.ctypes.data), n)
