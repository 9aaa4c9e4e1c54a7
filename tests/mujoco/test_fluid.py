"""The force of the water in MuJoCo: exact added mass, one solution by two programs, conservation laws."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from pike_coefficients import COEFFICIENTS
from wet_models import TREE, compiled, stirred, tree_links

from mjfish.fish import Fish
from mjfish.hydro.link import link_records
from mjfish.mujoco import StripFluid, mjcf
from mjfish.mujoco.coupling_choice import Coupling
from mjfish.numerics.arrays import FloatArray
from proofs import reference as slow

_SEED = 11


def _tail_alone(pike: Fish, c_m: float, coupling: Coupling) -> tuple[StripFluid, tuple[float, float, float]]:
    """Return the tail of the pike as the only body of a model, and A_0, A_1, A_2."""
    link = pike.links[-1]
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option gravity="0 0 0"/>
        <compiler inertiafromgeom="false"/><worldbody><body name="tail">
        <joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 1 0"/><joint axis="0 0 1"/>
        <inertial pos="{-link.com} 0 0" mass="{link.mass}" diaginertia="{f"{link.inertia} " * 3}"/>
        </body></worldbody></mujoco>"""
    )
    fluid = StripFluid(model, mjcf.strips(pike, {"c_m.tail": c_m})[-1:], coupling=coupling)
    return fluid, tuple(c_m * link_records(pike)[-1]["added"])


@pytest.mark.parametrize("coupling", ["inertia", "xfrc"])
@pytest.mark.parametrize("c_m", [0.06, 1.0, 25.0])
@pytest.mark.parametrize("heading", [0.0, 0.7])
def test_pushed_link_accelerates_with_its_added_mass(
    pike: Fish, c_m: float, heading: float, coupling: Coupling
) -> None:
    """F/m along the link, F/(m + m_a) across; added mass up to 116 times the mass, where a lagged one diverges."""
    fluid, (a0, a1, a2) = _tail_alone(pike, c_m, coupling)
    link = pike.links[-1]
    model = fluid.model
    data = mujoco.MjData(model)
    data.qpos[2] = heading
    forward, port = np.array([np.cos(heading), np.sin(heading)]), np.array([-np.sin(heading), np.cos(heading)])
    with fluid.installed():
        data.qfrc_applied[:2] = 2.0 * forward
        mujoco.mj_forward(model, data)
        np.testing.assert_allclose(data.qacc[:2], 2.0 / link.mass * forward, rtol=1e-12, atol=1e-12)
        # ProcessNoise at the centre of mass and added mass together, the link does not turn.
        arm = (link.mass * link.com + a1) / (link.mass + a0)
        data.qfrc_applied[:] = [*(2.0 * port), -2.0 * arm]
        mujoco.mj_forward(model, data)
        np.testing.assert_allclose(data.qacc[:2], 2.0 / (link.mass + a0) * port, rtol=1e-12, atol=1e-12)
        assert data.qacc[2] == pytest.approx(0.0, abs=1e-9)
        # Turned by a couple, it turns about that same point.
        data.qfrc_applied[:] = [0, 0, 1e-3]
        mujoco.mj_forward(model, data)
        inertia = link.inertia + link.mass * link.com**2 + a2 - (link.mass + a0) * arm**2
        assert data.qacc[2] == pytest.approx(1e-3 / inertia, rel=1e-12)


def _numpy_solution(model: mujoco.MjModel, data: mujoco.MjData) -> tuple[FloatArray, FloatArray]:
    """Return xfrc_applied and qacc by the NumPy callback, at the state of `data`."""
    same = mujoco.MjData(model)
    same.qpos[:], same.qvel[:], same.ctrl[:], same.qfrc_applied[:] = data.qpos, data.qvel, data.ctrl, data.qfrc_applied
    mujoco.set_mjcb_control(slow.control)
    mujoco.mj_forward(model, same)
    mujoco.set_mjcb_control(None)
    return same.xfrc_applied.copy(), same.qacc.copy()


def _assert_same(found: FloatArray, expected: FloatArray) -> None:
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12 * np.abs(expected).max())


@pytest.mark.parametrize("munk", [0.0, 1.0])
def test_compiled_and_numpy_callback_agree(pike: Fish, munk: float) -> None:
    """Catches a slip in either: frames, moment arms, J'q', the stale actuator force, a wrench that accumulates."""
    random = np.random.default_rng(_SEED)
    swimmer = mjcf.swimmer(pike.model_copy(update={"munk_moment": munk}))
    for coupling in ("xfrc", "inertia"):
        fluid = StripFluid(swimmer.model, swimmer.links, coupling=coupling)  # type: ignore[arg-type]
        data = mujoco.MjData(fluid.model)
        for _ in range(10):
            data.qpos[:], data.qvel[:] = random.normal(size=7), 3.0 * random.normal(size=7)
            data.ctrl[:], data.qfrc_applied[:] = random.normal(size=4), random.normal(size=7)
            with fluid.installed():
                mujoco.mj_forward(fluid.model, data)
                written = data.xfrc_applied.copy()
            wrench, acceleration = _numpy_solution(fluid.model, data)
            _assert_same(data.qacc, acceleration)
            if coupling == "xfrc":
                _assert_same(written, wrench)


@pytest.mark.parametrize("coupling", ["xfrc", "inertia"])
def test_compiled_and_numpy_callback_agree_in_space(coupling: Coupling) -> None:
    """A free root, skew strips with their origin off the body's, a dry branch, a current and gravity."""
    links = [{**link, "axis": (-1.0, 0.2, 0.1), "origin": (0.01, 0.02, 0.03)} for link in tree_links(roll_damping=2.0)]
    fluid = StripFluid(compiled(TREE), links, coupling=coupling, density=1025.0)
    fluid.model.opt.wind[:] = (0.4, -0.3, 0.2)
    for seed in range(10):
        data = stirred(fluid.model, seed)
        with fluid.installed():
            mujoco.mj_forward(fluid.model, data)
            written = data.xfrc_applied.copy()
        wrench, acceleration = _numpy_solution(fluid.model, data)
        _assert_same(data.qacc, acceleration)
        if coupling == "xfrc":
            _assert_same(written, wrench)


def test_armature_of_tendons_stays_in_the_inertia() -> None:
    """Catches an inertia that is made anew without it."""
    tendon = """<tendon><fixed armature="2"><joint joint="tail" coef="1"/><joint joint="weight" coef="2"/></fixed>
    </tendon></mujoco>"""
    fluid = StripFluid(compiled(TREE.replace("</mujoco>", tendon)), tree_links())
    data, without = stirred(fluid.model), stirred(fluid.model)
    with fluid.installed():
        mujoco.mj_forward(fluid.model, data)
    _assert_same(data.qacc, _numpy_solution(fluid.model, data)[1])
    free = StripFluid(compiled(TREE), tree_links())
    with free.installed():
        mujoco.mj_forward(free.model, without)
    assert np.abs(data.qacc - without.qacc).max() > 1.0


def _free_chain(pike: Fish, munk: float, coupling: Coupling) -> StripFluid:
    """Return the pike without drag and with limp joints, c_m = 1."""
    still = {name: 1.0 if name.startswith("c_m") else 0.0 for name in COEFFICIENTS}
    fluid = mjcf.swimmer(pike.model_copy(update={"munk_moment": munk}), values=still, coupling=coupling)
    fluid.model.actuator_gainprm[:] = 0.0
    fluid.model.actuator_biasprm[:] = 0.0
    return fluid


def _invariants(model: mujoco.MjModel, data: mujoco.MjData) -> FloatArray:
    """Return energy and total impulse (two linear, one angular about the world's origin) of body and water."""
    mujoco.mj_forward(model, data)
    mujoco.mj_makeM(model, data)
    inertia = slow.inertia(model, data)
    momentum = inertia @ data.qvel
    px, py, turning = momentum[:3]
    x, y = data.qpos[:2]
    return np.array([0.5 * momentum @ data.qvel, px, py, turning + x * py - y * px])


def _drift(pike: Fish, munk: float, step: float, coupling: Coupling) -> float:
    """Return the largest change of the invariants after half a second of tumbling."""
    fluid = _free_chain(pike, munk, coupling)
    model = fluid.model
    model.opt.timestep = step
    data = mujoco.MjData(model)
    data.qpos[3:] = [0.3, -0.2, 0.4, 0.1]
    data.qvel[:] = [0.5, 0.2, 1.0, -3.0, 2.0, 4.0, -5.0]
    with fluid.installed():
        before = _invariants(model, data)
        for _ in range(round(0.5 / step)):
            mujoco.mj_step(model, data)
        return float(np.abs(_invariants(model, data) - before).max())


@pytest.mark.parametrize("coupling", ["inertia", "xfrc"])
def test_energy_and_impulse_are_conserved_without_drag(pike: Fish, coupling: Coupling) -> None:
    """Kirchhoff's water (munk_moment = 1) takes nothing; the drift is RK4's and falls at its order.

    Catches a wrong sign of the gyroscopic terms, a moment about the wrong point, a missing J'q' of the added mass.
    """
    drifts = [_drift(pike, 1.0, step, coupling) for step in (4e-3, 2e-3, 1e-3, 5e-4)]
    orders = np.log2(np.divide(drifts[:-1], drifts[1:]))
    assert drifts[2] < 2e-5
    assert np.all(orders > 3.85), orders
    assert _drift(pike, 0.0, 1e-3, coupling) > 1e-2, "Morison's water does take energy: the test must see that"
