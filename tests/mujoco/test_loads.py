"""Loads of causes in MuJoCo: the record they read, the wrench they make, and who keeps them alive."""

from __future__ import annotations

import gc
import weakref
from typing import Any

import mujoco
import numpy as np
import pytest
from pike_coefficients import COEFFICIENTS
from wet_models import PLATE, PLATE_LINK, PUSHES, compiled, pushing, stirred, tree

from mjfish.errors import InputError
from mjfish.fish import Fish
from mjfish.hydro.link import LINK, link_records
from mjfish.hydro.load import PARAMETERS, Load, load
from mjfish.mujoco import StripFluid, mjcf
from mjfish.mujoco.block import block_of
from proofs import reference

VALUES = dict(zip(COEFFICIENTS, (1.0, 0.5, 0.6, 2.0, 1.5, 2.5, 0.02, 0.01, 0.02), strict=True))


def test_a_load_reads_the_record_that_it_reads_in_the_ode(pike: Fish) -> None:
    """Field by field. Catches a centre of mass from the wrong end, an inertia of another axis, strips not copied."""
    for fish in (pike, pike.model_copy(update={"servo": None, "munk_moment": 0.5})):  # hand-written, built
        fluid = mjcf.swimmer(fish, values=VALUES, loads=[(pushing, [1.0])])
        found = block_of(fluid.model).planes
        expected = link_records(fish, VALUES)
        for field in LINK.names or ():
            np.testing.assert_allclose(found[field], expected[field], rtol=1e-12, atol=1e-15, err_msg=field)


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize("coupling", ["inertia", "xfrc"])
def test_compiled_loads_accelerate_the_tree_as_the_readable_ones_do(coupling: str, seed: int) -> None:
    """In a current, every body turned in space. Catches a load left out of one coupling, or counted twice."""
    fluid, bare = tree(coupling, loaded=True), tree(coupling)
    found = []
    for one in (fluid, bare):
        one.model.opt.wind[:] = (0.3, -0.2, 0.1)
        data = stirred(one.model, seed)
        with one.installed():
            mujoco.mj_forward(one.model, data)
        found.append(data.qacc.copy())
    data = stirred(fluid.model, seed)
    mujoco.mj_forward(fluid.model, data)
    expected = reference.solve(fluid.model, data)
    np.testing.assert_allclose(found[0], expected, rtol=0, atol=1e-9 * np.abs(expected).max())
    assert np.abs(found[0] - found[1]).max() > 0.1


@load
def _strange(link: Any, parameters: Any) -> tuple[float, float, float]:
    return parameters[0] * (1.0 + link.last), parameters[1], parameters[2]


def test_force_and_moment_arrive_at_the_front_of_the_link_in_its_frame() -> None:
    """A plate whose x points backwards: fx pushes along -x of the body, mz about +z of its origin."""
    fluid = StripFluid(compiled(PLATE), [PLATE_LINK], loads=[(_strange, [0.5, 0.2, 0.03])])
    data = mujoco.MjData(fluid.model)
    with fluid.installed():
        mujoco.mj_forward(fluid.model, data)
    wrench = fluid.wrenches(data)["loads"][0]
    arm = data.xpos[fluid.model.body("plate").id] - data.xipos[fluid.model.body("plate").id]
    force = np.array([-1.0, -0.2, 0.0])
    np.testing.assert_allclose(wrench, [*force, 0.0, 0.0, 0.03 + np.cross(arm, force)[2]], rtol=0, atol=1e-14)


def test_a_load_lives_as_long_as_the_water_and_no_longer() -> None:
    """Catches a callback collected while MuJoCo still calls its address, which may go well for a while."""

    def made() -> tuple[StripFluid, weakref.ref[Load]]:
        @load
        def pull(link: Any, parameters: Any) -> tuple[float, float, float]:
            return -parameters[0] * link.u - 1.0, 0.0, 0.0

        return StripFluid(compiled(PLATE), [PLATE_LINK], loads=[(pull, [2.0])]), weakref.ref(pull)

    fluid, alive = made()
    gc.collect()
    assert alive() is not None
    data = mujoco.MjData(fluid.model)
    with fluid.installed():
        mujoco.mj_forward(fluid.model, data)
    assert fluid.wrenches(data)["loads"][0, 0] == pytest.approx(1.0)
    del fluid, data
    gc.collect()
    assert alive() is None


def test_what_is_no_load_is_refused() -> None:
    with pytest.raises(
        InputError, match=r"expected a compiled Load, found <function .*write @mjfish\.hydro\.load\.load"
    ):
        StripFluid(compiled(PLATE), [PLATE_LINK], loads=[(lambda link, parameters: None, [1.0])])  # type: ignore[list-item]
    for parameters, message in (
        ([0.0] * (PARAMETERS + 1), f"loads.1: found {PARAMETERS + 1} parameters, expected {PARAMETERS} at most"),
        ([0.0, np.nan], "loads.1: found the parameter nan, expected a finite number"),
        (["a"], "loads.1: found the parameter 'a', expected a finite number"),
    ):
        with pytest.raises(InputError, match=message):
            StripFluid(compiled(PLATE), [PLATE_LINK], loads=[(pushing, parameters)])  # type: ignore[list-item]
    assert len(PUSHES) == 2
