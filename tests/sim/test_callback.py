"""The callback of the process: put in, taken out, refused where it would be wrong; and the memory layout below it."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from typing import Any

import mujoco
import numpy as np
import pytest

from mjfish.errors import InputError, MjfishError
from mjfish.fish import Fish
from mjfish.sim import installed, layout, planar

_BITS = mujoco.mjtDisableBit


@pytest.fixture(autouse=True)
def _clean() -> Iterator[None]:
    yield
    mujoco.set_mjcb_control(None)


def test_callback_that_was_there_before_is_there_again(pike: Fish) -> None:
    calls: list[int] = []

    def mine(_model: Any, _data: Any) -> None:
        calls.append(1)

    mujoco.set_mjcb_control(mine)
    model = planar.model(pike)
    data = mujoco.MjData(model)
    mujoco.mj_resetData(model, data)
    assert not calls
    with installed(model):
        mujoco.mj_forward(model, data)
        assert not calls
    assert mujoco.get_mjcb_control() is mine
    mujoco.mj_forward(model, data)
    assert calls == [1]


def test_callback_is_removed_after_an_error(pike: Fish) -> None:
    with pytest.raises(ZeroDivisionError), installed(planar.model(pike)):
        raise ZeroDivisionError
    assert mujoco.get_mjcb_control() is None


def test_blocks_that_overlap_in_two_threads_keep_the_water_until_the_last_ends(pike: Fish) -> None:
    """Catches the restore of the thread that ends first while the other still steps."""
    model = planar.model(pike)
    entered, leave = threading.Event(), threading.Event()

    def other() -> None:
        with installed(model):
            entered.set()
            leave.wait(10.0)

    thread = threading.Thread(target=other)
    with installed(model):
        thread.start()
        assert entered.wait(10.0)
    assert mujoco.get_mjcb_control() is not None
    leave.set()
    thread.join(10.0)
    assert mujoco.get_mjcb_control() is None


def _damped(model: mujoco.MjModel) -> None:
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_EULER
    model.dof_damping[4] = 0.3


def _limited(model: mujoco.MjModel) -> None:
    model.jnt_limited[3] = 1


def _rubbing(model: mujoco.MjModel) -> None:
    model.dof_frictionloss[5] = 0.1


def _deaf(model: mujoco.MjModel) -> None:
    model.opt.disableflags |= _BITS.mjDSBL_ACTUATION


def _resetting(model: mujoco.MjModel) -> None:
    model.opt.disableflags &= ~int(_BITS.mjDSBL_AUTORESET)


def _touching(model: mujoco.MjModel) -> None:
    model.opt.disableflags &= ~int(_BITS.mjDSBL_CONTACT)
    model.geom_contype[:] = 1


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (_damped, r'damping of joint_2 implicitly.*eulerdamp="disable".*RK4'),
        (_limited, r"joint limits of joint_1; remove their range"),
        (_rubbing, r"frictionloss of joint_3; remove it"),
        (_deaf, r'remove <flag actuation="disable"/>'),
        (_resetting, r'set <flag autoreset="disable"/>'),
        (_touching, r'geoms that can touch; set contype="0"'),
    ],
)
def test_model_that_spoils_the_force_is_refused_with_the_remedy(pike: Fish, spoil: Any, message: str) -> None:
    model = planar.model(pike)
    with installed(model):
        pass  # the model as it comes is fine
    spoil(model)
    with pytest.raises(InputError, match=message), installed(model):
        pass
    assert mujoco.get_mjcb_control() is None


@pytest.mark.parametrize("name", ["implicit", "implicitfast", "discrete"])
def test_implicit_integrators_are_refused_by_name(pike: Fish, name: str) -> None:
    model = planar.model(pike)
    model.opt.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{name.upper()}")
    with pytest.raises(InputError, match=rf"integrator '{name}' treats damping implicitly.*RK4"), installed(model):
        pass


def test_euler_with_explicit_damping_is_accepted(pike: Fish) -> None:
    model = planar.model(pike, integrator="Euler")
    model.dof_damping[4] = 0.3
    model.opt.disableflags |= _BITS.mjDSBL_EULERDAMP
    with installed(model):
        assert mujoco.get_mjcb_control() is not None


def test_layout_agrees_with_this_mujoco() -> None:
    """Every allocated array of model and data that compiled code touches lies where the layout says."""
    layout.verify()
    assert {"xfrc_applied", "M", "cdof_dot"} <= set(layout.DATA.fields)


def test_another_layout_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    real = layout.structure

    def shifted(name: str) -> Any:
        fields = [("new_in_some_version", layout._C_TYPES["mjtSize"]), *real(name)._fields_]  # type: ignore[misc]
        return type(name, (real(name).__base__,), {"_fields_": fields})

    monkeypatch.setattr(layout, "structure", shifted)
    with pytest.raises(MjfishError, match=r"MuJoCo \d.*: mjModel\.nv is not where its headers say"):
        layout.verify()


def test_models_without_water_are_left_alone() -> None:
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><option><flag autoreset="disable"/></option><custom><numeric name="mine" size="5000"/></custom>'
        '<worldbody><body><joint type="slide"/><geom size=".1"/></body></worldbody></mujoco>'
    )
    data = mujoco.MjData(model)
    data.xfrc_applied[1, 2] = 7.0
    with installed():
        mujoco.mj_step(model, data)
    np.testing.assert_array_equal(data.xfrc_applied[1], [0, 0, 7, 0, 0, 0])
