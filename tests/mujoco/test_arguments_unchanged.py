"""What a user hands over stays as it was, but for what is documented to change."""

from __future__ import annotations

import copy
from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np
import pytest
from wet_models import PUSHES, TREE, compiled, stirred, tree_links

from mjfish.mujoco import StripFluid

#: The tag of the water, autoreset, and the current where one is given; see docs/mujoco-plugin.md.
_WRITTEN = {"opt.o_solimp", "opt.disableflags", "opt.wind"}


def _numbers(thing: Any, prefix: str = "") -> dict[str, Any]:
    """Return copies of all numbers and arrays of a struct of MuJoCo, by name."""
    found: dict[str, Any] = {}
    for name in dir(thing):
        if name.startswith("_") or name in ("signature", "contact"):
            continue
        value = getattr(thing, name)
        if isinstance(value, np.ndarray):
            found[prefix + name] = value.copy()
        elif isinstance(value, (int, float)):
            found[prefix + name] = value
    return found


def _of_model(model: mujoco.MjModel) -> dict[str, Any]:
    return _numbers(model) | _numbers(model.opt, "opt.") | _numbers(model.stat, "stat.")


def _changed(before: dict[str, Any], after: dict[str, Any]) -> set[str]:
    assert before.keys() == after.keys()
    return {name for name, value in before.items() if not np.array_equal(value, after[name], equal_nan=True)}


def _call_all(model: mujoco.MjModel, links: list[dict[str, Any]], current: Any, c_d: Any) -> None:
    fluid = StripFluid(model, links, density=1025.0, current=current, loads=PUSHES)
    data = stirred(model)
    with fluid.installed():
        mujoco.mj_step(model, data, nstep=3)
        mujoco.mj_forward(model, data)
        fluid.wrenches(data)
    fluid.set(c_d=c_d)
    fluid.state(data)


def test_of_the_model_only_what_is_documented_changes_and_arguments_stay() -> None:
    model, links = compiled(TREE), tree_links(kc=2.0)
    current, c_d = np.array([0.1, 0.2, -0.1]), np.array([1.0, 2.0])
    before, given = _of_model(model), copy.deepcopy((links, current.tolist(), c_d.tolist()))
    assert len(before) > 200
    _call_all(model, links, current, c_d)
    assert _changed(before, _of_model(model)) == _WRITTEN
    assert (links, current.tolist(), c_d.tolist()) == given
    plain = compiled(TREE)
    StripFluid(plain, links)
    assert _changed(_of_model(compiled(TREE)), _of_model(plain)) == _WRITTEN - {"opt.wind"}


@pytest.mark.parametrize("ask", [lambda fluid, data: fluid.wrenches(data), lambda fluid, data: fluid.state(data)])
def test_questions_change_nothing_of_the_data(ask: Callable[[StripFluid, mujoco.MjData], object]) -> None:
    fluid = StripFluid(compiled(TREE), tree_links(), loads=PUSHES)
    data = stirred(fluid.model)
    with fluid.installed():
        mujoco.mj_forward(fluid.model, data)
        before = _numbers(data)
        ask(fluid, data)
        assert len(before) > 100
        assert not _changed(before, _numbers(data))


def test_a_forward_pass_in_water_leaves_the_state_and_the_inputs_of_the_user() -> None:
    fluid = StripFluid(compiled(TREE), tree_links())
    data = stirred(fluid.model)
    data.qfrc_applied[:] = np.linspace(-0.1, 0.1, fluid.model.nv)
    data.xfrc_applied[fluid.model.body("weight").id] = 0.1  # a body without water
    inputs = ("qpos", "qvel", "act", "ctrl", "qfrc_applied", "xfrc_applied", "mocap_pos", "userdata", "time")
    before = {name: np.copy(getattr(data, name)) for name in inputs}
    with fluid.installed():
        mujoco.mj_forward(fluid.model, data)
    assert not _changed(before, {name: np.copy(getattr(data, name)) for name in inputs})
