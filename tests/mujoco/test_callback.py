"""The callback of the process: what was there before goes first and comes back; blocks nest, overlap and fail."""

from __future__ import annotations

import ctypes
import threading
from collections.abc import Callable
from typing import Any

import mujoco
import numba
import numpy as np
import pytest
from numba import carray, types
from wet_models import stirred, tree

from mjfish.mujoco import StripFluid, callback, layout
from mjfish.mujoco.layout import DATA_POINTER, MODEL_POINTER, floats

_C_TYPE = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p)
_ASKED = 0.7


def _python() -> Callable[..., None]:
    def control(_model: Any, data: mujoco.MjData) -> None:
        data.ctrl[0] = _ASKED

    return control


def _of_numba() -> Any:
    def control(_model: Any, data: Any) -> None:
        carray(floats(carray(data, 1)[0].ctrl), 1)[0] = _ASKED

    return numba.cfunc(types.void(MODEL_POINTER, DATA_POINTER))(control)


def _of_ctypes() -> Any:
    mirror = layout.structure("mjData")

    def control(_model: int, data: int) -> None:
        ctrl = mirror.from_address(data).ctrl  # type: ignore[attr-defined]
        ctypes.c_double.from_address(ctrl).value = _ASKED

    return _C_TYPE(control)


def _acceleration(fluid: StripFluid, asked: float | None) -> Any:
    data = stirred(fluid.model)
    if asked is not None:
        data.ctrl[0] = asked
    with fluid.installed():
        mujoco.mj_forward(fluid.model, data)
    return data.qacc.copy()


@pytest.mark.parametrize("coupling", ["inertia", "xfrc"])
@pytest.mark.parametrize("kind", ["python", "numba", "ctypes"])
def test_controller_that_was_there_before_goes_first_and_is_there_again(kind: str, coupling: str) -> None:
    """Catches a controller that is lost, or called behind water that has solved for its command already."""
    fluid = tree(coupling)
    expected, without = _acceleration(fluid, _ASKED), _acceleration(fluid, None)
    assert np.abs(expected - without).max() > 0.1
    keep = {"python": _python, "numba": _of_numba, "ctypes": _of_ctypes}[kind]()
    before = keep.ctypes if kind == "numba" else keep
    mujoco.set_mjcb_control(before)
    with fluid.installed():
        assert mujoco.get_mjcb_control() is not before
    assert mujoco.get_mjcb_control() is before
    np.testing.assert_array_equal(_acceleration(fluid, None), expected)
    assert mujoco.get_mjcb_control() is before


def test_no_callback_before_is_none_again_and_the_water_is_compiled_code() -> None:
    """A callback in Python would hold the GIL in every step of every thread."""
    with tree().installed():
        assert hasattr(mujoco.get_mjcb_control(), "restype")
    assert mujoco.get_mjcb_control() is None


@pytest.mark.parametrize("before", [None, _python()])
def test_callback_is_as_it_was_after_an_error_in_the_block(before: Any) -> None:
    mujoco.set_mjcb_control(before)
    with pytest.raises(ZeroDivisionError), tree().installed():
        raise ZeroDivisionError
    assert mujoco.get_mjcb_control() is before


def test_error_of_the_users_controller_arrives_and_the_callback_is_as_it_was() -> None:
    def broken(_model: Any, _data: Any) -> None:
        raise ArithmeticError("out of hay")

    fluid = tree()
    mujoco.set_mjcb_control(broken)
    with pytest.raises(ArithmeticError, match="out of hay"), fluid.installed():
        mujoco.mj_step(fluid.model, mujoco.MjData(fluid.model))
    assert mujoco.get_mjcb_control() is broken


def test_layout_that_is_refused_leaves_the_callback_as_it_was(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse() -> None:
        raise ArithmeticError

    before = _python()
    mujoco.set_mjcb_control(before)
    monkeypatch.setattr(callback, "_control", refuse)
    with pytest.raises(ArithmeticError), tree().installed():
        pass
    assert mujoco.get_mjcb_control() is before
    monkeypatch.undo()
    with tree().installed():  # and no user was counted who never came in
        assert mujoco.get_mjcb_control() is not before
    assert mujoco.get_mjcb_control() is before


def test_nested_blocks_keep_the_water_until_the_outer_ends() -> None:
    """Catches an inner block that restores, and a controller that is called twice."""
    calls: list[float] = []
    mujoco.set_mjcb_control(lambda _model, data: calls.append(data.time))
    one, other = tree(), tree(c_d=0.0)
    with one.installed():
        ours = mujoco.get_mjcb_control()
        with other.installed(), pytest.raises(ZeroDivisionError), one.installed():
            raise ZeroDivisionError
        assert mujoco.get_mjcb_control() is ours
        mujoco.mj_forward(one.model, mujoco.MjData(one.model))
    assert calls == [0.0]
    assert mujoco.get_mjcb_control() is not ours


def test_blocks_that_overlap_in_two_threads_keep_the_water_until_the_last_ends() -> None:
    """Catches the restore of the thread that ends first while the other still steps."""
    fluid = tree()
    entered, leave = threading.Event(), threading.Event()

    def other() -> None:
        with fluid.installed():
            entered.set()
            leave.wait(10.0)

    thread = threading.Thread(target=other)
    with fluid.installed():
        thread.start()
        assert entered.wait(10.0)
    assert mujoco.get_mjcb_control() is not None
    leave.set()
    thread.join(10.0)
    assert mujoco.get_mjcb_control() is None


def test_compiling_in_one_thread_leaves_the_water_of_another() -> None:
    """Catches a callback that is taken away while a model compiles: the other thread would step without water."""
    seen: list[Any] = []

    class Watched(mujoco.MjSpec):
        def compile(self) -> mujoco.MjModel:
            seen.append(mujoco.get_mjcb_control())
            return super().compile()

    fluid = tree()
    with fluid.installed():
        ours = mujoco.get_mjcb_control()
        layout.compile_aside(Watched())
        assert seen == [ours]
        assert mujoco.get_mjcb_control() is ours


def test_a_model_compiles_beside_a_controller_in_python() -> None:
    """MuJoCo alone refuses: it calls the controller in a test step."""
    before = _python()
    mujoco.set_mjcb_control(before)
    with pytest.raises(ValueError, match="Python exception"):
        mujoco.MjModel.from_xml_string("<mujoco><worldbody><body><joint/><geom size='1'/></body></worldbody></mujoco>")
    assert layout.compile_aside("<mujoco/>").nv == 0
    assert mujoco.get_mjcb_control() is before


def test_models_without_water_are_left_alone() -> None:
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><custom><numeric name="mine" size="500"/></custom>'
        '<worldbody><body><joint type="slide"/><geom size=".1"/></body></worldbody></mujoco>'
    )
    data = mujoco.MjData(model)
    data.xfrc_applied[1, 2] = 7.0
    with tree().installed():
        mujoco.mj_step(model, data)
    np.testing.assert_array_equal(data.xfrc_applied[1], [0, 0, 7, 0, 0, 0])
    assert np.all(np.isfinite(data.qacc))
