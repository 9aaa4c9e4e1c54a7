"""The checks of a model are done again where something that they read was changed, and only there."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
import pytest
from wet_models import TREE, compiled, tree, tree_links

from mjfish.errors import InputError
from mjfish.mujoco import StripFluid, coupling_choice, fluid
from mjfish.mujoco.coupling_choice import FIELDS, OPTIONS
from mjfish.mujoco.memory import make_room, room_in

_SIZES_AND_NAMES = {"opt", "nbody", "nv", "nu", "njnt", "neq", "npair", "actuator", "joint"}


class _Reader:
    """Passes attributes on, and keeps their names."""

    def __init__(self, thing: Any, names: set[str], inner: dict[str, _Reader] | None = None) -> None:
        self._thing, self._names, self._inner = thing, names, inner or {}

    def __getattr__(self, name: str) -> Any:
        if not name.startswith("_"):  # MuJoCo's own functions look for the pointer
            self._names.add(name)
        return self._inner.get(name) or getattr(self._thing, name)


def test_all_that_the_checks_read_is_watched() -> None:
    """Catches a check that reads something new, whose change a later block would not see."""
    spec = mujoco.MjSpec.from_string(TREE)
    make_room(spec, 1)
    model = spec.compile()
    fields: set[str] = set()
    options: set[str] = set()
    reader: Any = _Reader(model, fields, {"opt": _Reader(model.opt, options)})
    coupling_choice.choose(reader, [1, 2], None)
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_EULER
    model.jnt_limited[model.joint("tail").id] = 1  # where there may be a constraint, solvers count
    coupling_choice.choose(reader, [1, 2], "inertia")
    list(coupling_choice._against_xfrc(reader))
    room_in(reader, 1)
    assert fields - _SIZES_AND_NAMES == set(FIELDS)
    assert options == set(OPTIONS)


def test_a_model_that_is_as_it_was_is_not_checked_again(monkeypatch: pytest.MonkeyPatch) -> None:
    checks: list[str | None] = []
    choose = fluid.choose

    def counting(model: Any, bodies: Any, asked: Any) -> Any:
        checks.append(asked)
        return choose(model, bodies, asked)

    monkeypatch.setattr(fluid, "choose", counting)
    water = tree()
    for step in (0.002, 0.001):  # what no check reads may change
        water.model.opt.timestep = step
        water.model.opt.wind[0] = step
        with water.installed():
            pass
    assert checks == [None]
    water.model.opt.integrator = mujoco.mjtIntegrator.mjINT_EULER
    for _ in range(2):
        with water.installed():
            pass
    assert checks == [None, "inertia"]


def test_a_model_that_was_spoilt_is_refused_until_it_is_mended() -> None:
    """Catches a change that is taken for seen where it was refused, and one that is seen in the first block only."""
    water = StripFluid(compiled(TREE), tree_links(), coupling="xfrc")
    friction = water.model.dof_frictionloss
    for value, message in ((0.1, "frictionloss"), (0.1, "frictionloss"), (0.2, "frictionloss")):
        friction[:] = value
        with pytest.raises(InputError, match=message), water.installed():
            pass
    friction[:] = 0.0
    with water.installed():
        data = mujoco.MjData(water.model)
        mujoco.mj_step(water.model, data)
    assert np.all(np.isfinite(data.qacc))
