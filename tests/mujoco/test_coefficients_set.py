"""Coefficients that are set in place: the water is that of a new StripFluid, to the last bit."""

from __future__ import annotations

import copy
import re
from typing import Any

import mujoco
import numpy as np
import pytest
from wet_models import PUSHES, TREE, compiled, full_state, stirred, tree, tree_links

from mjfish.errors import InputError, UnknownNameError
from mjfish.mujoco import StripFluid
from mjfish.mujoco.links import COEFFICIENTS
from mjfish.numerics.arrays import FloatArray

_OTHER: dict[str, Any] = {
    "c_m": [0.7, 1.3],
    "c_d": np.array([0.9, 2.1]),
    "c_f": 0.03,
    "munk_moment": [0.5, 0.25],
    "roll_damping": 2.0,
}


def _new(coupling: str, *, loaded: bool, kc: dict[str, float]) -> StripFluid:
    """Return the tree in water that has the other coefficients from the start."""
    links = tree_links(**kc)
    for index, link in enumerate(links):
        link.update({name: float(np.broadcast_to(value, 2)[index]) for name, value in _OTHER.items()})
    loads = PUSHES if loaded else ()
    return StripFluid(compiled(TREE), links, coupling=coupling, loads=loads)  # type: ignore[arg-type]


def _run(fluid: StripFluid, model: mujoco.MjModel | None = None) -> FloatArray:
    model = model or fluid.model
    data = stirred(model)
    with fluid.installed():
        mujoco.mj_step(model, data, nstep=20)
    return full_state(model, data)


@pytest.mark.parametrize("coupling", ["inertia", "xfrc"])
@pytest.mark.parametrize("loaded", [False, True])
@pytest.mark.parametrize("kc", [{}, {"kc": 8.0}])
def test_water_is_that_of_a_new_one(kc: dict[str, float], loaded: bool, coupling: str) -> None:
    """Every coefficient, with loads that read them, in a copy of the model too."""
    assert _OTHER.keys() == COEFFICIENTS.keys()
    fluid = tree(coupling, loaded=loaded, **kc)
    before, twin = _run(fluid), copy.copy(fluid.model)
    fluid.set(**_OTHER)
    new = _new(coupling, loaded=loaded, kc=kc)
    expected = _run(new)
    assert not np.array_equal(before, expected)
    np.testing.assert_array_equal(_run(fluid), expected)
    np.testing.assert_array_equal(_run(fluid, twin), expected)
    assert fluid.links == new.links


@pytest.mark.parametrize("name", COEFFICIENTS)
def test_one_coefficient_is_set_and_the_others_stay(name: str) -> None:
    fluid = tree(munk_moment=0.3)
    fluid.set(**{name: 0.4})
    expected = tree(**{"munk_moment": 0.3, name: 0.4})
    np.testing.assert_array_equal(_run(fluid), _run(expected))


def test_the_next_step_of_a_block_has_them() -> None:
    fluid, other = tree(), tree(c_d=3.0)
    data, twin = stirred(fluid.model), stirred(other.model)
    with fluid.installed():
        for wet, moving in ((fluid, data), (other, twin)):
            mujoco.mj_forward(wet.model, moving)
        assert fluid.wrenches(data)["drag"].tolist() != other.wrenches(twin)["drag"].tolist()
        fluid.set(c_d=3.0)
        mujoco.mj_step(fluid.model, data)
        mujoco.mj_step(other.model, twin)
    np.testing.assert_array_equal(full_state(fluid.model, data), full_state(other.model, twin))


@pytest.mark.parametrize(
    ("coefficients", "message"),
    [
        ({"c_d": -1.0}, "link 'trunk': c_d: -1 is outside its bounds [0, 100]; choose one inside"),
        ({"c_m": 1.0, "c_d": [1.0, np.nan]}, "link 'tail': c_d: nan is outside its bounds [0, 100]; choose one inside"),
        (
            {"c_d": [1.0, 1.0, 1.0]},
            "c_d: found an array of shape (3,), expected a number, or 2, one a link; correct it",
        ),
        ({"c_d": "much"}, "c_d: found 'much', expected a number or one a link; correct it"),
        ({"c_d": 90.0}, "link 'trunk': kc 1 makes c_d 129.802, expected 100 at most; correct kc, kc_power or c_d"),
    ],
)
def test_what_cannot_be_set_is_refused_and_nothing_set(coefficients: dict[str, Any], message: str) -> None:
    fluid = tree(kc=1.0)
    links, numbers = fluid.links, fluid._block.links.copy()
    with pytest.raises(InputError, match=f"^{re.escape(message)}$"):
        fluid.set(c_f=0.5, **coefficients)
    assert fluid.links is links
    np.testing.assert_array_equal(fluid._block.links, numbers)


def test_an_unknown_coefficient_lists_those_there_are() -> None:
    with pytest.raises(
        UnknownNameError, match="unknown coefficient 'cd'; known: c_d, c_f, c_m, munk_moment, roll_damp"
    ):
        tree().set(cd=1.0)


def test_water_that_was_replaced_sets_nothing() -> None:
    first = tree()
    StripFluid(first.model, tree_links())
    with pytest.raises(InputError, match="another StripFluid has taken the place"):
        first.set(c_d=1.0)
