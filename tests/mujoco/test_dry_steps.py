"""Steps between two blocks, where there is no water, are told of, once; what only looks like them is not."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from pathlib import Path

import mujoco
import numpy as np
import pytest
from wet_models import stirred, tree

from mjfish.mujoco import StripFluid, callback, written_forces

_DRY = "MjData took 3 steps outside installed.., where there is no water; put all steps into the block"
_STATE = mujoco.mjtState.mjSTATE_INTEGRATION.value


@pytest.fixture(autouse=True)
def _untold() -> Iterator[None]:
    callback._told = False
    written_forces._left.clear()
    yield
    callback._told = False


def _steps_in_a_block(fluid: StripFluid, data: mujoco.MjData) -> None:
    with fluid.installed():
        mujoco.mj_step(fluid.model, data, nstep=2)


@pytest.mark.parametrize("integrator", ["euler", "rk4"])
def test_steps_between_two_blocks_are_told_of_once_where_the_block_stands(integrator: str) -> None:
    fluid = tree(integrator=integrator)
    data = stirred(fluid.model)
    _steps_in_a_block(fluid, data)
    mujoco.mj_step(fluid.model, data, nstep=3)
    with pytest.warns(UserWarning, match=f"^{_DRY}$") as told:
        _steps_in_a_block(fluid, data)
    assert Path(told[0].filename) == Path(__file__)
    mujoco.mj_step(fluid.model, data, nstep=3)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        _steps_in_a_block(fluid, data)


def test_a_warning_that_is_an_error_leaves_all_as_it_was() -> None:
    fluid = tree()
    data = stirred(fluid.model)
    _steps_in_a_block(fluid, data)
    mujoco.mj_step(fluid.model, data, nstep=3)
    with pytest.raises(UserWarning, match=_DRY):
        _steps_in_a_block(fluid, data)
    assert mujoco.get_mjcb_control() is None
    np.testing.assert_array_equal(data.xfrc_applied, 0.0)
    _steps_in_a_block(fluid, data)


def _nothing(fluid: StripFluid, data: mujoco.MjData) -> None:
    pass


def _forward(fluid: StripFluid, data: mujoco.MjData) -> None:
    mujoco.mj_forward(fluid.model, data)


def _reset(fluid: StripFluid, data: mujoco.MjData) -> None:
    mujoco.mj_resetData(fluid.model, data)


def _later_state(fluid: StripFluid, data: mujoco.MjData) -> None:
    """As a planner sets it."""
    later = stirred(fluid.model)
    later.time = data.time + 1.0
    numbers = np.empty(mujoco.mj_stateSize(fluid.model, _STATE))
    mujoco.mj_getState(fluid.model, later, numbers, _STATE)
    mujoco.mj_setState(fluid.model, data, numbers, _STATE)
    mujoco.mj_forward(fluid.model, data)


def _copied(fluid: StripFluid, data: mujoco.MjData) -> None:
    """From one that took more steps, all of them in water."""
    other = stirred(fluid.model)
    for _ in range(3):
        _steps_in_a_block(fluid, other)
    mujoco.mj_copyData(data, fluid.model, other)


@pytest.mark.parametrize("between", [_nothing, _forward, _reset, _later_state, _copied])
def test_what_is_no_step_is_not_told_of(between: Callable[[StripFluid, mujoco.MjData], None]) -> None:
    """Warnings are errors here."""
    fluid = tree()
    data, other = stirred(fluid.model), stirred(fluid.model)
    for _ in range(2):
        _steps_in_a_block(fluid, data)
        _steps_in_a_block(fluid, other)
        between(fluid, data)
    _steps_in_a_block(fluid, data)


def test_steps_before_the_first_block_are_the_users() -> None:
    """To let a scene come to rest, say."""
    fluid = tree()
    data = stirred(fluid.model)
    mujoco.mj_step(fluid.model, data, nstep=3)
    _steps_in_a_block(fluid, data)
