"""Whoever steps the model, the water is the same to the last bit: loop, nstep, threads, batch, copies, a controller."""

from __future__ import annotations

import copy
import pickle
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import mujoco
import mujoco.rollout
import numpy as np
import pytest
from wet_models import full_state, stirred, tree

from mjfish.mujoco import StripFluid
from mjfish.numerics.arrays import FloatArray

_STEPS = 60
_FULL = mujoco.mjtState.mjSTATE_FULLPHYSICS
_CASES = [
    (coupling, integrator)
    for coupling, integrators in {
        "inertia": ("rk4", "euler", "implicitfast", "discrete"),
        "xfrc": ("rk4",),
    }.items()
    for integrator in integrators
]


def _loop(fluid: StripFluid, model: mujoco.MjModel | None = None, steps: int = _STEPS) -> FloatArray:
    """Return the states (steps, n) behind every mj_step, of the fluid's model or of a copy."""
    model = model or fluid.model
    data = stirred(model)
    states = []
    with fluid.installed():
        for _ in range(steps):
            mujoco.mj_step(model, data)
            states.append(full_state(model, data))
    return np.array(states)


def _dry(fluid: StripFluid) -> FloatArray:
    """Return the same without water: what every test here must be able to tell apart."""
    data = stirred(fluid.model)
    states = []
    for _ in range(_STEPS):
        mujoco.mj_step(fluid.model, data)
        states.append(full_state(fluid.model, data))
    return np.array(states)


def _rolled(fluid: StripFluid, models: Any, runs: int, threads: int, steps: int = _STEPS) -> FloatArray:
    """Return the states (runs, steps, n) of `mujoco.rollout`."""
    first = models[0] if isinstance(models, list) else models
    data = [mujoco.MjData(first) for _ in range(threads)]
    start = stirred(first)
    control = np.tile(start.ctrl, (runs, steps, 1))
    with fluid.installed():
        states, _ = mujoco.rollout.rollout(models, data, np.tile(full_state(first, start), (runs, 1)), control)
    return np.asarray(states)


@pytest.mark.parametrize(("coupling", "integrator"), _CASES)
def test_one_call_of_many_steps_is_a_loop_of_one(coupling: str, integrator: str) -> None:
    fluid = tree(coupling, integrator=integrator)
    states = _loop(fluid)
    data = stirred(fluid.model)
    with fluid.installed():
        mujoco.mj_step(fluid.model, data, nstep=_STEPS)
    np.testing.assert_array_equal(full_state(fluid.model, data), states[-1])
    assert np.abs(states - _dry(fluid)).max() > 0.01


@pytest.mark.parametrize(("coupling", "integrator"), [("inertia", "euler"), ("inertia", "implicitfast")])
def test_both_halves_of_a_step_are_a_step(coupling: str, integrator: str) -> None:
    """A controller between mj_step1 and mj_step2 comes behind the water; `inertia` does not mind."""
    fluid = tree(coupling, integrator=integrator)
    data = stirred(fluid.model)
    control = data.ctrl.copy()
    with fluid.installed():
        for _ in range(_STEPS):
            data.ctrl[:] = 0.0
            mujoco.mj_step1(fluid.model, data)
            data.ctrl[:] = control
            mujoco.mj_step2(fluid.model, data)
    np.testing.assert_array_equal(full_state(fluid.model, data), _loop(fluid)[-1])


@pytest.mark.parametrize("coupling", ["inertia", "xfrc"])
def test_forward_that_skips_the_position_is_a_forward(coupling: str) -> None:
    """So do MuJoCo's derivatives; catches added mass that piles up in an inertia that is not made anew."""
    fluid = tree(coupling)
    data, again = stirred(fluid.model), stirred(fluid.model)
    with fluid.installed():
        mujoco.mj_forward(fluid.model, data)
        mujoco.mj_forward(fluid.model, again)
        for stage in (mujoco.mjtStage.mjSTAGE_POS, mujoco.mjtStage.mjSTAGE_VEL):
            mujoco.mj_forwardSkip(fluid.model, again, stage, 0)
            np.testing.assert_array_equal(again.qacc, data.qacc)


@pytest.mark.parametrize("threads", [1, 2, 4])
@pytest.mark.parametrize("coupling", ["inertia", "xfrc"])
def test_rollout_in_threads_is_a_loop(coupling: str, threads: int) -> None:
    """Catches a callback that writes into what the threads share, such as the velocities that loads read."""
    fluid = tree(coupling, loaded=True)
    before = fluid._block.links.copy()
    states = _rolled(fluid, fluid.model, 8, threads)
    np.testing.assert_array_equal(states, np.tile(_loop(fluid), (8, 1, 1)))
    np.testing.assert_array_equal(fluid._block.links, before)


def test_rollout_of_several_models_has_the_water_of_each() -> None:
    fluids = [tree(c_d=c_d) for c_d in (0.0, 0.5, 1.0, 2.0)]
    states = _rolled(fluids[0], [fluid.model for fluid in fluids], 4, 2)
    for found, fluid in zip(states, fluids, strict=True):
        np.testing.assert_array_equal(found, _loop(fluid))
    assert len(np.unique(states[:, -1, 1])) == 4


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize("coupling", ["inertia", "xfrc"])
def test_batch_which_copies_the_model_is_a_loop(coupling: str, threads: int) -> None:
    batches = pytest.importorskip("mujoco.batch", reason="MuJoCo has batches from 4.0 on")
    fluid = tree(coupling, loaded=True)
    batch = batches.Batch(fluid.model, nsim=3, nthread=threads)
    start = stirred(fluid.model)
    batch.bind("qpos")[:], batch.bind("qvel")[:], batch.bind("ctrl")[:] = start.qpos, start.qvel, start.ctrl
    with fluid.installed():
        recorded = batch.rollout(_STEPS, record=[_FULL])[_FULL]
    np.testing.assert_array_equal(recorded, np.tile(_loop(fluid), (3, 1, 1)))


def _through_file(model: mujoco.MjModel) -> mujoco.MjModel:
    mujoco.mj_saveModel(model, "model.mjb", None)
    return mujoco.MjModel.from_binary_path("model.mjb")


COPIES: dict[str, Callable[[mujoco.MjModel], mujoco.MjModel]] = {
    "copy": copy.copy,
    "deepcopy": copy.deepcopy,
    "pickle": lambda model: pickle.loads(pickle.dumps(model)),  # noqa: S301 - our own
    "file": _through_file,
}


@pytest.mark.parametrize("name", COPIES)
def test_copy_of_the_model_is_in_the_same_water(name: str) -> None:
    fluid = tree()
    model = COPIES[name](fluid.model)
    assert model is not fluid.model
    np.testing.assert_array_equal(_loop(fluid, model), _loop(fluid))


def test_other_water_on_a_copy_leaves_the_original_alone() -> None:
    fluid = tree()
    expected = _loop(fluid)
    other = StripFluid(copy.copy(fluid.model), [link.model_copy(update={"c_d": 5.0}) for link in fluid.links])
    assert np.abs(_loop(other) - expected).max() > 0.01
    np.testing.assert_array_equal(_loop(fluid), expected)


def test_models_stepped_at_once_in_threads_keep_their_own_water() -> None:
    """Each thread steps its model in one call without the GIL, inside blocks of its own that overlap."""
    fluids = [tree(c_d=c_d, c_m=c_m) for c_d in (0.1, 2.0) for c_m in (0.1, 3.0)]
    expected = [_loop(fluid, steps=400)[-1] for fluid in fluids]

    def run(fluid: StripFluid) -> FloatArray:
        data = stirred(fluid.model)
        with fluid.installed():
            mujoco.mj_step(fluid.model, data, nstep=400)
        return full_state(fluid.model, data)

    with ThreadPoolExecutor(4) as pool:
        for found, wanted in zip(pool.map(run, fluids * 3), expected * 3, strict=True):
            np.testing.assert_array_equal(found, wanted)
    assert mujoco.get_mjcb_control() is None


def _swing(_model: Any, data: mujoco.MjData) -> None:
    data.ctrl[0] = 0.5 * np.sin(20.0 * data.time)


@pytest.mark.parametrize("coupling", ["inertia", "xfrc"])
def test_controller_of_a_user_drives_while_the_water_acts(coupling: str) -> None:
    """At every stage of RK4; in `mujoco.rollout`, too, where the threads take turns in Python."""
    fluid = tree(coupling)
    idle = _loop(fluid)
    mujoco.set_mjcb_control(_swing)
    try:
        driven = _loop(fluid)
        rolled = _rolled(fluid, fluid.model, 4, 2)
    finally:
        mujoco.set_mjcb_control(None)
    np.testing.assert_array_equal(rolled, np.tile(driven, (4, 1, 1)))
    assert np.abs(driven - idle).max() > 0.1
    # The same as commands that are set by hand, once a step, but for what RK4 sees between.
    data = stirred(fluid.model)
    with fluid.installed():
        for _ in range(_STEPS):
            _swing(fluid.model, data)
            mujoco.mj_step(fluid.model, data)
    assert 0.0 < np.abs(full_state(fluid.model, data) - driven[-1]).max() < 0.3


def test_servo_commands_of_a_step_are_read_at_every_stage_of_rk4() -> None:
    """Userdata holds the commands at the start, middle and end of the step: as from a controller with a clock."""
    spec = mujoco.MjSpec.from_string(_SERVO)
    spec.nuserdata = 4
    model = spec.compile()
    fluid = StripFluid(model, [{"body": "plate", "length": 0.3, "height": 0.2, "width": 0.01}], commanded=True)
    told, driven = mujoco.MjData(model), mujoco.MjData(model)
    h = model.opt.timestep
    with fluid.installed():
        for step in range(50):
            told.userdata[:] = [told.time, *(_asked((step + stage) * h) for stage in (0.0, 0.5, 1.0))]
            mujoco.mj_step(model, told)
    plain = StripFluid(model, fluid.links)
    mujoco.set_mjcb_control(lambda _model, data: data.ctrl.__setitem__(0, _asked(data.time)))
    with plain.installed():
        mujoco.mj_step(model, driven, nstep=50)
    np.testing.assert_allclose(told.qpos, driven.qpos, rtol=0, atol=1e-14)
    assert abs(told.qpos[0]) > 1e-3


def _asked(time: float) -> float:
    return float(0.4 * np.sin(60.0 * time) ** 2)


_SERVO = """
<mujoco><option integrator="RK4" gravity="0 0 0" timestep="0.004"/>
<worldbody><body name="plate"><joint name="hinge" axis="0 0 1"/>
<geom type="box" size=".15 .005 .1" pos="-.15 0 0" contype="0" conaffinity="0"/></body></worldbody>
<actuator><position joint="hinge" kp="5" kv=".1"/></actuator></mujoco>
"""
