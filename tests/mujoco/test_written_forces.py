"""What the water wrote into xfrc_applied is taken out where it acts no longer; what the user wrote stays."""

from __future__ import annotations

import copy
import ctypes
import gc
import threading
from typing import Any

import mujoco
import mujoco.rollout
import numpy as np
import pytest
from wet_models import stirred, tree

from mjfish.mujoco import StripFluid, written_forces

_PUSH = np.array([0.3, 0.1, -0.2, 0.01, 0.02, 0.03])


def _body(fluid: StripFluid, name: str) -> int:
    return int(fluid.model.body(name).id)


@pytest.mark.parametrize("coupling", ["inertia", "xfrc"])
def test_a_step_after_the_block_is_one_without_water(coupling: str) -> None:
    """Catches the last force of the water, which would push for ever."""
    fluid = tree(coupling)
    data = stirred(fluid.model)
    with fluid.installed():
        mujoco.mj_step(fluid.model, data, nstep=5)
        assert np.abs(data.xfrc_applied).max() > 1.0
    np.testing.assert_array_equal(data.xfrc_applied, 0.0)
    dry = mujoco.MjData(fluid.model)
    state = mujoco.mjtState.mjSTATE_INTEGRATION.value
    numbers = np.empty(mujoco.mj_stateSize(fluid.model, state))
    mujoco.mj_getState(fluid.model, data, numbers, state)
    mujoco.mj_setState(fluid.model, dry, numbers, state)
    dry.xfrc_applied[:] = 0.0
    mujoco.mj_step(fluid.model, data)
    mujoco.mj_step(fluid.model, dry)
    np.testing.assert_array_equal(data.qvel, dry.qvel)


def test_forces_of_the_user_stay() -> None:
    """On a dry body all the time, on a wet one again behind the block, and what is written inside behind the step."""
    fluid = tree()
    trunk, tail, weight = (_body(fluid, name) for name in ("trunk", "tail", "weight"))
    data = stirred(fluid.model)
    data.xfrc_applied[weight], data.xfrc_applied[tail] = _PUSH, 2.0 * _PUSH
    with fluid.installed():
        mujoco.mj_step(fluid.model, data, nstep=3)
        np.testing.assert_array_equal(data.xfrc_applied[weight], _PUSH)
        data.xfrc_applied[trunk] = 3.0 * _PUSH
    np.testing.assert_array_equal(data.xfrc_applied[weight], _PUSH)
    np.testing.assert_array_equal(data.xfrc_applied[tail], 2.0 * _PUSH)
    np.testing.assert_array_equal(data.xfrc_applied[trunk], 3.0 * _PUSH)


def test_every_data_is_cleared_in_every_thread_and_of_every_model() -> None:
    fluid, other = tree(), tree("xfrc")
    twin = copy.copy(fluid.model)
    served = [mujoco.MjData(fluid.model) for _ in range(4)]
    start = np.zeros((32, mujoco.mj_stateSize(fluid.model, mujoco.mjtState.mjSTATE_FULLPHYSICS.value)))
    mujoco.mj_getState(fluid.model, stirred(fluid.model), start[0], mujoco.mjtState.mjSTATE_FULLPHYSICS.value)
    start[:] = start[0]
    alone, copied = stirred(other.model), stirred(twin)
    with fluid.installed():
        mujoco.rollout.rollout(fluid.model, served, start, nstep=3)
        mujoco.mj_step(other.model, alone)
        mujoco.mj_step(twin, copied)
        worked = [data for data in (*served, alone, copied) if np.any(data.xfrc_applied)]
        assert {id(alone), id(copied)} < {id(data) for data in worked}
    for data in (*served, alone, copied):
        np.testing.assert_array_equal(data.xfrc_applied, 0.0)


def test_inner_block_leaves_the_water_to_the_outer_one() -> None:
    fluid = tree()
    data = stirred(fluid.model)
    with fluid.installed():
        with tree().installed():
            mujoco.mj_step(fluid.model, data)
        assert np.any(data.xfrc_applied)
    assert not np.any(data.xfrc_applied)


def test_run_that_diverged_is_cleared() -> None:
    """No number equals itself: catches a comparison that takes NaN for somebody else's force."""
    fluid = tree()
    data = stirred(fluid.model)
    with fluid.installed():
        mujoco.mj_step(fluid.model, data)
        data.qvel[0] = np.nan
        mujoco.mj_step(fluid.model, data)
        assert np.any(np.isnan(data.xfrc_applied))
    np.testing.assert_array_equal(data.xfrc_applied, 0.0)


def test_data_freed_inside_the_block_are_not_touched() -> None:
    """Catches writing to freed memory, and to the data of somebody else who got it next."""
    fluid = tree()
    before = written_forces._hook.value
    with fluid.installed():
        for _ in range(200):
            data = stirred(fluid.model)
            mujoco.mj_step(fluid.model, data)
            address = data._address
            assert address in written_forces._notes
            del data
            gc.collect(0)
            assert address not in written_forces._notes
        assert not written_forces._notes
        assert np.all(written_forces.TABLE[:, 0] <= written_forces._FREED)
        fresh = stirred(fluid.model)
        fresh.xfrc_applied[_body(fluid, "trunk")] = _PUSH
    np.testing.assert_array_equal(fresh.xfrc_applied[_body(fluid, "trunk")], _PUSH)
    assert written_forces._hook.value == before
    assert not np.any(written_forces.TABLE)


def test_memory_handler_of_the_user_is_called_and_there_again() -> None:
    freed: list[int] = []
    free = ctypes.CDLL(None).free

    def handler(address: Any) -> None:
        freed.append(address)
        free(ctypes.c_void_p(address))

    kept = ctypes.CFUNCTYPE(None, ctypes.c_void_p)(handler)
    written_forces._hook.value = ctypes.cast(kept, ctypes.c_void_p).value
    try:
        fluid = tree()
        with fluid.installed():
            data = stirred(fluid.model)
            mujoco.mj_step(fluid.model, data)
            address = data._address
            del data
        assert address in freed
        assert written_forces._hook.value == ctypes.cast(kept, ctypes.c_void_p).value
    finally:
        written_forces._hook.value = None


def test_threads_that_meet_new_data_at_once_note_each() -> None:
    fluid = tree()
    many = [stirred(fluid.model, seed) for seed in range(64)]

    def run(mine: list[mujoco.MjData]) -> None:
        for data in mine:
            mujoco.mj_step(fluid.model, data)

    with fluid.installed():
        threads = [threading.Thread(target=run, args=(many[k::4],)) for k in range(4)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert all(np.any(data.xfrc_applied) for data in many)
    assert not any(np.any(data.xfrc_applied) for data in many)
