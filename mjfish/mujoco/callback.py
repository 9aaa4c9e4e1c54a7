"""MuJoCo's control callback: whatever was installed before, the servo commands of the step, the force of the water."""

from __future__ import annotations

import functools
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import llvmlite.binding
import mujoco
import numpy as np
from numba import carray, types

from mjfish.compiled import c_callback, compiled
from mjfish.hydro.load import PARAMETERS
from mjfish.mujoco import blocks
from mjfish.mujoco.block_layout import CARRIER, HEADER, SPATIAL_SIZE, TREE
from mjfish.mujoco.coupling import couple
from mjfish.mujoco.layout import DATA_POINTER, MODEL_POINTER, counts, floats, links, plane_links, verify

_MAGIC = blocks.MAGIC
_EULER, _RK4 = 0, 1  # mjtIntegrator


#: Symbol of a function that returns the address of the table: machine code on disk must not know the number itself.
_TABLE = "mjfish_table_of_blocks"
_table = types.ExternalFunction(_TABLE, types.uint64())


@compiled
def find(model: Any) -> tuple[bool, int]:
    """Return whether the model is tagged, and the address of its block; 0 where the tag leads nowhere."""
    tag = model.o_solimp
    if tag[0] != _MAGIC:
        return False, 0
    table = _table()
    if tag[1] != float(carray(counts(table), 2)[0]):
        return True, 0
    row = carray(counts(table + 16 * int(tag[2])), 2)
    return True, (row[0] if float(row[1]) == tag[3] else 0)


@compiled
def _command(model: Any, data: Any) -> None:
    """Set ctrl from userdata: time of the step's start, then the commands at its start, middle and end."""
    user = carray(floats(data.userdata), 1 + 3 * model.nu)
    ctrl = carray(floats(data.ctrl), model.nu)
    stage = min(max(int(2.0 * (data.time - user[0]) / model.timestep + 0.5), 0), 2)
    for k in range(model.nu):
        ctrl[k] = user[1 + stage * model.nu + k]


def _act(model_pointer: Any, data_pointer: Any) -> None:
    """Let the water act on one model, where it has any; what cannot be right is spoilt, so that it is seen."""
    model = carray(model_pointer, 1)[0]
    data = carray(data_pointer, 1)[0]
    tagged, address = find(model)
    if not tagged:
        return
    if address == 0:
        _spoil(model, data)
        return
    header = carray(floats(address), HEADER)
    if header[5] != model.nbody or header[6] != model.nv:
        _spoil(model, data)
        return
    n, c, t, k = int(header[0]), int(header[1]), int(header[2]), int(header[7])
    inertia = header[3] > 0.0
    if header[4] > 0.0:
        _command(model, data)
    if not inertia and (data.nefc > 0 or model.integrator > _RK4):
        _spoil(model, data)
        return
    address += 8 * HEADER
    carriers = carray(floats(address), (c, CARRIER))
    address += 8 * CARRIER * c
    trees = carray(floats(address), (t, TREE))
    address += 8 * TREE * t
    water = carray(links(address), n)
    address += SPATIAL_SIZE * n
    hooks = carray(counts(address), k)
    address += 8 * k
    parameters = carray(floats(address), (k, PARAMETERS))
    plane = carray(plane_links(address + 8 * PARAMETERS * k), n)
    couple(model, data, carriers, trees, water, inertia, hooks, parameters, plane, model_pointer, data_pointer)


@compiled
def _spoil(model: Any, data: Any) -> None:
    """Make the accelerations no numbers: MuJoCo then warns of them."""
    carray(floats(data.qfrc_passive), model.nv)[:] = np.nan


@functools.cache
def _control() -> Any:
    """Compile the callback, or load it from disk, for the table of this process; return both its functions."""
    verify()
    address = blocks.TABLE.ctypes.data
    table = c_callback(types.uint64(), cached=False)(lambda: address)
    llvmlite.binding.add_symbol(_TABLE, table.address)
    return c_callback(types.void(MODEL_POINTER, DATA_POINTER))(_act), table  # the second must not be collected


def _with(before: Any) -> Any:
    """Return a callback that first does what was installed before, such as a user's controller."""
    ours = _control()[0].ctypes
    if before is None:
        return ours
    if hasattr(before, "restype"):  # a C function, of ctypes

        def both(model: mujoco.MjModel, data: mujoco.MjData) -> None:
            before(model._address, data._address)
            ours(model._address, data._address)
    else:

        def both(model: mujoco.MjModel, data: mujoco.MjData) -> None:
            before(model, data)
            ours(model._address, data._address)

    return both


_lock = threading.Lock()
_users = 0
_before: Any = None


@contextmanager
def installed() -> Iterator[None]:
    """Let the water act while the block runs; what was MuJoCo's control callback before is so again afterwards.

    The callback belongs to the whole process: inside the block it acts on every model with water, in all threads, and
    on no other. A control callback that was there before goes on, ahead of the water. Blocks may be nested and may
    overlap in time; the last one out restores.

    Raises:
        MjfishError: this MuJoCo is not understood.
    """
    global _users, _before
    with _lock:
        if _users == 0:
            _before = mujoco.get_mjcb_control()
            mujoco.set_mjcb_control(None)  # MuJoCo compiles no model, which `verify` needs, under one in Python
            try:
                mujoco.set_mjcb_control(_with(_before))
            except BaseException:
                mujoco.set_mjcb_control(_before)
                raise
        _users += 1
    try:
        yield
    finally:
        with _lock:
            _users -= 1
            if _users == 0:
                mujoco.set_mjcb_control(_before)
                _before = None
