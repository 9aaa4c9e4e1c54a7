"""The force of the water on each link, part by part: what MuJoCo was given, and what its accelerations need."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from wet_models import PLATE_LINK, TREE, compiled, stirred, tree, tree_links

from mjfish.errors import InputError
from mjfish.mujoco import StripFluid
from mjfish.mujoco.block import block_of
from mjfish.mujoco.fluid import PARTS

_SEEDS = (1, 2, 3)


def _forward(fluid: StripFluid, seed: int, wind: tuple[float, float, float] = (0.3, -0.2, 0.1)) -> mujoco.MjData:
    """Return data behind mj_forward in a current, pushed from outside on every dof."""
    fluid.model.opt.wind[:] = wind
    data = stirred(fluid.model, seed)
    data.qfrc_applied[:] = np.random.default_rng(seed).normal(size=fluid.model.nv)
    data.xfrc_applied[fluid.model.body("weight").id] = [0.3, 0.1, -0.2, 0.01, 0.02, 0.03]
    with fluid.installed():
        mujoco.mj_forward(fluid.model, data)
    return data


def _imbalance(fluid: StripFluid, data: mujoco.MjData) -> float:
    """Return the largest element of M_rigid qacc less all forces, the logged one included, by the largest of that."""
    model = fluid.model
    water, pushed = np.zeros(model.nv), np.zeros(model.nv)
    for link, wrench in zip(fluid.links, fluid.wrenches(data)["total"], strict=True):
        body = model.body(link.body).id
        mujoco.mj_applyFT(model, data, wrench[:3], wrench[3:], data.xipos[body], body, water)
    weight = model.body("weight").id
    by_user = data.xfrc_applied[weight]
    mujoco.mj_applyFT(model, data, by_user[:3], by_user[3:], data.xipos[weight], weight, pushed)
    force = data.qfrc_passive + data.qfrc_actuator + data.qfrc_applied + data.qfrc_constraint - data.qfrc_bias
    mujoco.mj_makeM(model, data)  # without the added mass that coupling "inertia" left there
    inertia = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, inertia)
    return float(np.abs(inertia @ data.qacc - force - pushed - water).max() / np.abs(water).max())


@pytest.mark.parametrize("seed", _SEEDS)
def test_total_is_the_sum_of_its_parts_and_with_xfrc_what_is_applied(seed: int) -> None:
    fluid = tree("xfrc", loaded=True)
    with fluid.installed():
        data = _forward(fluid, seed)
        written = data.xfrc_applied.copy()
    found = fluid.wrenches(data)
    assert set(found) == {*PARTS, "total"}
    np.testing.assert_allclose(sum(found[part] for part in PARTS), found["total"], rtol=0, atol=1e-12)
    for index, link in enumerate(fluid.links):
        applied = written[fluid.model.body(link.body).id]
        np.testing.assert_allclose(found["total"][index], applied, rtol=0, atol=1e-10 * np.abs(applied).max())
    assert all(np.abs(found[part]).max() > 1e-4 for part in PARTS), "a part that is zero is not tested"
    assert not found["total"].flags.writeable


@pytest.mark.parametrize("coupling", ["inertia", "xfrc"])
@pytest.mark.parametrize("seed", _SEEDS)
def test_rigid_bodies_accelerate_as_the_total_and_all_other_forces_demand(seed: int, coupling: str) -> None:
    """M_rigid qacc = tau - c + J^T total: what a log of the force is for. Catches a moment about the wrong point."""
    fluid = tree(coupling, loaded=True)
    data = _forward(fluid, seed)
    assert _imbalance(fluid, data) < 1e-12


@pytest.mark.parametrize("seed", _SEEDS)
def test_both_couplings_have_the_same_parts(seed: int) -> None:
    parts = [
        fluid.wrenches(_forward(fluid, seed)) for fluid in (tree("inertia", loaded=True), tree("xfrc", loaded=True))
    ]
    for name, inertia in parts[0].items():
        np.testing.assert_allclose(inertia, parts[1][name], rtol=0, atol=1e-9 * np.abs(inertia).max(), err_msg=name)


def test_total_holds_at_a_stop_where_only_inertia_is_right() -> None:
    """With an active joint limit, the force of the limit is one of the others."""
    model = compiled(TREE)
    joint = model.joint("tail")
    model.jnt_limited[joint.id], model.jnt_range[joint.id] = 1, (-1e-3, 1e-3)
    model.opt.tolerance, model.opt.iterations = 0.0, 200
    fluid = StripFluid(model, tree_links())
    data = _forward(fluid, 1)
    assert data.nefc > 0
    assert np.abs(data.qfrc_constraint).max() > 1.0
    assert _imbalance(fluid, data) < 1e-8


def test_parts_are_what_they_are_called() -> None:
    """Buoyancy of a body at rest; drag against the way; Munk a pure moment; each zero where its cause is."""
    fluid = tree()
    model = fluid.model
    data = mujoco.MjData(model)
    with fluid.installed():
        mujoco.mj_forward(model, data)
    rest = fluid.wrenches(data)
    volumes = block_of(model).links["volume"]
    assert np.all(rest["drag"] == 0.0)
    assert np.all(rest["munk"] == 0.0)
    np.testing.assert_allclose(rest["buoyancy"][:, 2], 1000.0 * 9.81 * volumes, rtol=1e-12)
    np.testing.assert_allclose(rest["buoyancy"][:, :2], 0.0, atol=1e-12)
    data.qvel[:2] = [0.5, 0.4]  # forward and to port
    with fluid.installed():
        mujoco.mj_forward(model, data)
    moving = fluid.wrenches(data)
    assert np.all(moving["drag"][:, :2] < 0.0)
    np.testing.assert_array_equal(moving["munk"][:, :3], 0.0)
    assert abs(moving["munk"][0, 5]) > 0.1
    np.testing.assert_array_equal(moving["buoyancy"], rest["buoyancy"])
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_GRAVITY
    assert np.all(fluid.wrenches(data)["buoyancy"] == 0.0)


def test_plate_held_in_a_current_is_pushed_as_on_paper() -> None:
    """1/2 rho c_d A v^2 in the middle of the plate; a body that cannot move may have water, too."""
    model = mujoco.MjModel.from_xml_string(
        """<mujoco><option gravity="0 0 0" wind="0 2 0"/><worldbody><body name="plate">
        <geom type="box" size=".15 .002 .1" pos="-.15 0 0"/></body></worldbody></mujoco>"""
    )
    fluid = StripFluid(model, [{**PLATE_LINK, "c_d": 1.9}])
    data = mujoco.MjData(model)
    with fluid.installed():
        mujoco.mj_forward(model, data)
    total = fluid.wrenches(data)["total"][0]
    np.testing.assert_allclose(total, [0, 0.5 * 1000 * 1.9 * 0.06 * 2**2, 0, 0, 0, 0], rtol=1e-12, atol=1e-10)


def test_two_links_on_one_body_add_up() -> None:
    """Front and back half of the tail as links of their own are the tail."""
    whole = {"body": "tail", "length": 0.2, "height": 0.1, "width": 0.01, "c_d": 1.5}
    halves = [{**whole, "length": 0.1}, {**whole, "length": 0.1, "origin": (-0.1, 0.0, 0.0)}]
    for coupling in ("inertia", "xfrc"):
        fluids = [StripFluid(compiled(TREE), links, coupling=coupling) for links in ([whole], halves)]  # type: ignore[arg-type]
        one, two = (_forward(fluid, 2) for fluid in fluids)
        np.testing.assert_allclose(one.qacc, two.qacc, rtol=1e-6)
        totals = [fluid.wrenches(data)["total"] for fluid, data in zip(fluids, (one, two), strict=True)]
        np.testing.assert_allclose(totals[1].sum(axis=0), totals[0][0], rtol=1e-5, atol=1e-6)


def test_wrenches_need_their_own_water() -> None:
    fluid = tree()
    data = _forward(fluid, 1)
    fluid.model.opt.o_solimp[0] = 0.9
    with pytest.raises(InputError, match=r"opt\.o_solimp: found another value than the tag"):
        fluid.wrenches(data)
