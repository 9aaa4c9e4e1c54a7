"""Where compiled code finds MuJoCo's numbers: it agrees with this MuJoCo, and another is refused."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest
from wet_models import tree

from mjfish.errors import MjfishError
from mjfish.mujoco import callback, layout


def test_layout_agrees_with_this_mujoco() -> None:
    """Every allocated array of model and data that compiled code touches lies where the layout says."""
    layout.verify.__wrapped__()
    assert {"xfrc_applied", "M", "cdof_dot"} <= set(layout.DATA.fields)
    assert {"o_solimp", "wind", "dof_parentid"} <= set(layout.MODEL.fields)


@pytest.mark.parametrize(("struct", "first"), [("mjModel", "nv"), ("mjData", "time")])
def test_another_layout_is_refused(struct: str, first: str, monkeypatch: pytest.MonkeyPatch) -> None:
    real = layout.structure

    def shifted(name: str) -> Any:
        new = [("new_in_some_version", layout._C_TYPES["mjtSize"])] if name == struct else []
        return type(name, (real(name).__base__,), {"_fields_": [*new, *real(name)._fields_]})  # type: ignore[misc]

    monkeypatch.setattr(layout, "structure", shifted)
    with pytest.raises(MjfishError, match=rf"MuJoCo \d.*: {struct}\.{first} is not where its headers say; install"):
        layout.verify.__wrapped__()


def test_water_is_not_installed_on_a_layout_that_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """Catches a verification that nobody calls."""

    def refuse() -> None:
        raise MjfishError("not this one")

    fluid = tree()
    monkeypatch.setattr(callback, "verify", refuse)
    monkeypatch.setattr(callback, "_control", callback._control.__wrapped__)  # as in a new process
    with pytest.raises(MjfishError, match="not this one"), fluid.installed():
        pass


def test_field_of_an_unknown_type_is_refused() -> None:
    with pytest.raises(MjfishError, match=r"mjData\.x has the unknown type 'mjtQuad'; install a MuJoCo version"):
        layout._c_type("mjData.x", SimpleNamespace(name="mjtQuad"))
