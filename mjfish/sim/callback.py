"""MuJoCo's control callback: the servo commands of the step, then the force of the water."""

from __future__ import annotations

import functools
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import mujoco
from numba import carray, types

from mjfish.compiled import c_callback, compiled
from mjfish.sim.compatible import require_compatible
from mjfish.sim.fluid import push
from mjfish.sim.layout import DATA_POINTER, MODEL_POINTER, floats, fwd_actuation, integers, links, verify
from mjfish.sim.parameters import HEADER, MAGIC


@compiled
def _parameters(model: Any) -> int:
    """Return the address of the fluid's parameters in the model, 0 where it has none."""
    starts = carray(integers(model.numeric_adr), model.nnumeric)
    sizes = carray(integers(model.numeric_size), model.nnumeric)
    for k in range(model.nnumeric):
        address = model.numeric_data + 8 * starts[k]
        if sizes[k] > HEADER and carray(floats(address), 1)[0] == MAGIC:
            return address  # type: ignore[no-any-return]
    return 0


@compiled
def _command(model: Any, data: Any) -> None:
    """Set ctrl from userdata: time of the step's start, then the commands at its start, middle and end."""
    user = carray(floats(data.userdata), 1 + 3 * model.nu)
    ctrl = carray(floats(data.ctrl), model.nu)
    stage = min(max(int(2.0 * (data.time - user[0]) / model.timestep + 0.5), 0), 2)
    for k in range(model.nu):
        ctrl[k] = user[1 + stage * model.nu + k]


@c_callback(types.void(MODEL_POINTER, DATA_POINTER))
def control(model_pointer: Any, data_pointer: Any) -> None:
    """Be MuJoCo's ``mjcb_control``: command the servos, then write each link's wrench; other models are left alone."""
    model = carray(model_pointer, 1)[0]
    data = carray(data_pointer, 1)[0]
    address = _parameters(model)
    if address == 0:
        return
    header = carray(floats(address), HEADER)
    if header[2] > 0.0:
        _command(model, data)
    fwd_actuation(model_pointer, data_pointer)  # qfrc_actuator is that of the step before
    count = int(header[1])
    bodies = carray(floats(address + 8 * HEADER), count)
    water = carray(links(address + 8 * (HEADER + count)), count)
    push(model, data, bodies, water)


@functools.cache
def _verify_once() -> None:
    """Check the memory layout; MuJoCo compiles no model under a callback in Python, so that one steps aside."""
    before = mujoco.get_mjcb_control()
    mujoco.set_mjcb_control(None)
    try:
        verify()
    finally:
        mujoco.set_mjcb_control(before)


_lock = threading.Lock()
_users = 0
_before: Any = None


@contextmanager
def installed(*models: mujoco.MjModel) -> Iterator[None]:
    """Let the water act while the block runs; what was MuJoCo's control callback before is so again afterwards.

    The callback belongs to the whole process: inside the block it acts on every model with water in it, in all threads,
    and on no other. Blocks may be nested and may overlap in time; the last one out restores. The water assigns
    ``xfrc_applied`` of its bodies: push them by ``qfrc_applied``.

    Args:
        models: those that will be stepped; each is checked.

    Raises:
        InputError: the force would be wrong in one of them.
        MjfishError: this MuJoCo is not understood.
    """
    global _users, _before
    _verify_once()
    for model in models:
        require_compatible(model)
    with _lock:
        if _users == 0:
            _before = mujoco.get_mjcb_control()
            mujoco.set_mjcb_control(control.ctypes)
        _users += 1
    try:
        yield
    finally:
        with _lock:
            _users -= 1
            if _users == 0:
                mujoco.set_mjcb_control(_before)
                _before = None
