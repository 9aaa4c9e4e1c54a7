"""MuJoCo's control callback: whatever was installed before, the servo commands of the step, the force of the water."""

from __future__ import annotations

import functools
import threading
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import llvmlite.binding
import mujoco
import numpy as np
from numba import carray, types

from mjfish.mujoco import block, written_forces
from mjfish.mujoco.block import view
from mjfish.mujoco.coupling import couple
from mjfish.mujoco.layout import DATA_POINTER, MODEL_POINTER, counts, floats, verify
from mjfish.mujoco.written_forces import copy_written, note_of
from mjfish.numerics.compiled import c_callback, compiled

_MAGIC = block.MAGIC
_RK4 = int(mujoco.mjtIntegrator.mjINT_RK4)  # the last of the explicit ones

#: Symbols of functions that return the addresses of tables: machine code on disk must not know the numbers themselves.
_SYMBOLS = {"mjfish_table_of_blocks": block.TABLE, "mjfish_table_of_notes": written_forces.TABLE}
_blocks, _notes = (types.ExternalFunction(name, types.int64()) for name in _SYMBOLS)


@compiled
def find(model: Any) -> tuple[bool, Any]:
    """Return whether the model is tagged, and the address of its block; 0 where the tag leads nowhere."""
    tag = model.o_solimp
    if tag[0] != _MAGIC:
        return False, 0
    table = _blocks()
    if tag[1] != float(carray(counts(table), 2)[0]):
        return True, 0
    row = carray(counts(table + 16 * int(tag[2])), 2)
    return True, (np.int64(row[0]) if float(row[1]) == tag[3] else 0)


@compiled
def _command(model: Any, data: Any) -> None:
    """Set ctrl from userdata: time of the step's start, then the commands at its start, middle and end."""
    servos = (model.nuserdata - 1) // 3  # behind them, actuators may hold hidden states of loads
    user = carray(floats(data.userdata), 1 + 3 * servos)
    ctrl = carray(floats(data.ctrl), servos)
    stage = min(max(int(2.0 * (data.time - user[0]) / model.timestep + 0.5), 0), 2)
    for k in range(servos):
        ctrl[k] = user[1 + stage * servos + k]


@compiled
def _fits(model: Any, data: Any, head: Any) -> bool:
    """Return whether the water is that of this model, and its coupling right in the state that it is in."""
    return (  # type: ignore[no-any-return]
        head.bodies == model.nbody
        and head.dofs == model.nv
        and head.actuators == model.nu
        and head.activations == model.na
        and (head.inertia or (data.nefc == 0 and model.integrator <= _RK4))
    )


def _act(model_pointer: Any, data_pointer: Any) -> None:
    """Let the water act on one model, where it has any; what cannot be right is spoilt, so that it is seen."""
    model = carray(model_pointer, 1)[0]
    data = carray(data_pointer, 1)[0]
    tagged, address = find(model)
    if not tagged:
        return
    if address == 0 or not _fits(model, data, view(address).head[0]):
        carray(floats(data.qfrc_passive), model.nv)[:] = np.nan  # then accelerations are none: MuJoCo warns of them
        return
    water = view(address)
    if water.head[0].commanded:
        _command(model, data)
    note = note_of(_notes(), np.int64(carray(data_pointer, 1).ctypes.data), data, water)
    couple(model, data, water, model_pointer, data_pointer)
    copy_written(note, data, water)


@functools.cache
def _control() -> Any:
    """Compile the callback, or load it from disk, for the tables of this process; return it, and what it needs."""
    verify()
    getters = [c_callback(types.int64(), cached=False)(_constant(table.ctypes.data)) for table in _SYMBOLS.values()]
    for name, getter in zip(_SYMBOLS, getters, strict=True):
        llvmlite.binding.add_symbol(name, getter.address)
    return c_callback(types.void(MODEL_POINTER, DATA_POINTER))(_act), getters  # which must not be collected


def _constant(number: int) -> Callable[[], int]:
    return lambda: number


def _with(before: Any) -> Any:
    """Return a callback that first does what was installed before, such as a user's controller."""
    ours = _control()[0].ctypes
    if before is None:
        return ours
    in_c = hasattr(before, "restype")  # of ctypes

    def both(model: mujoco.MjModel, data: mujoco.MjData) -> None:
        before(*((model._address, data._address) if in_c else (model, data)))
        ours(model._address, data._address)

    return both


_lock = threading.Lock()
_users = 0
_told = False  # of steps without water, once
_before: Any = None


@contextmanager
def installed() -> Iterator[None]:
    """Let the water act while the block runs; what was MuJoCo's control callback before is so again afterwards.

    The callback belongs to the whole process: inside the block it acts on every model with water, in all threads, and
    on no other. A control callback that was there before goes on, ahead of the water. Blocks may be nested and may
    overlap in time; the last one out restores.

    Then the force of the water is taken out of `xfrc_applied` of every mjData that it acted on.

    Warns, once, of an mjData that took steps since the block before.

    Raises:
        MjfishError: this MuJoCo is not understood.
    """
    global _users, _before, _told
    dry = 0
    with _lock:
        if _users == 0:
            before = mujoco.get_mjcb_control()
            ours = _with(before)
            written_forces.start()
            mujoco.set_mjcb_control(ours)
            _before = before
        _users += 1
    try:
        yield
    finally:
        with _lock:
            _users -= 1
            if _users == 0:
                mujoco.set_mjcb_control(_before)
                _before = None
                dry = written_forces.take_out()
    if dry and not _told:
        _told = True
        warnings.warn(
            f"MjData took {dry} steps outside installed(), where there is no water; put all steps into the block",
            stacklevel=5,
        )
