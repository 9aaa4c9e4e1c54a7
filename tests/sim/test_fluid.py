"""The force of the water in MuJoCo: exact added mass, conservation laws, models and threads that do not disturb."""

from __future__ import annotations

from collections.abc import Iterator

import mujoco
import mujoco.rollout
import numpy as np
import pytest

from mjfish.arrays import FloatArray
from mjfish.fish import COEFFICIENTS, Fish
from mjfish.hydro.link import link_records
from mjfish.sim import installed, parameters, planar
from mjfish.sim import reference as slow

_SEED = 11


@pytest.fixture(autouse=True)
def _clean() -> Iterator[None]:
    yield
    mujoco.set_mjcb_control(None)


def _tail_alone(pike: Fish, c_m: float) -> tuple[mujoco.MjModel, tuple[float, float, float]]:
    """Return the tail of the pike as the only body of a model, and A_0, A_1, A_2."""
    link = pike.links[-1]
    spec = mujoco.MjSpec.from_string(
        f"""<mujoco><option gravity="0 0 0"><flag autoreset="disable"/></option>
        <compiler inertiafromgeom="false"/><worldbody><body name="tail">
        <joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 1 0"/><joint axis="0 0 1"/>
        <inertial pos="{-link.com} 0 0" mass="{link.mass}" diaginertia="{f"{link.inertia} " * 3}"/>
        </body></worldbody></mujoco>"""
    )
    parameters.reserve(spec, 1)
    model = spec.compile()
    record = link_records(pike, {"c_m.tail": c_m})[-1:]
    parameters.write(model, ["tail"], record)
    return model, tuple(c_m * record["added"][0])


@pytest.mark.parametrize("c_m", [0.06, 1.0, 25.0])
@pytest.mark.parametrize("heading", [0.0, 0.7])
def test_pushed_link_accelerates_with_its_added_mass(pike: Fish, c_m: float, heading: float) -> None:
    """F/m along the link, F/(m + m_a) across; added mass up to 116 times the mass, where a lagged one diverges."""
    model, (a0, a1, a2) = _tail_alone(pike, c_m)
    link = pike.links[-1]
    data = mujoco.MjData(model)
    data.qpos[2] = heading
    forward, port = np.array([np.cos(heading), np.sin(heading)]), np.array([-np.sin(heading), np.cos(heading)])
    with installed(model):
        data.qfrc_applied[:2] = 2.0 * forward
        mujoco.mj_forward(model, data)
        np.testing.assert_allclose(data.qacc[:2], 2.0 / link.mass * forward, rtol=1e-12, atol=1e-12)
        # Pushed at the centre of mass and added mass together, the link does not turn.
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


def test_compiled_and_numpy_callback_agree(pike: Fish) -> None:
    """Catches a slip in either: frames, moment arms, J'q', the stale actuator force, a wrench that accumulates."""
    random = np.random.default_rng(_SEED)
    for munk in (0.0, 1.0):
        model = planar.model(pike.model_copy(update={"munk_moment": munk}))
        records = parameters.read(model)[1]
        parameters.write(model, [link.name for link in pike.links], records, commanded=False)
        data = mujoco.MjData(model)
        for _ in range(20):
            data.qpos[:], data.qvel[:] = random.normal(size=7), 3.0 * random.normal(size=7)
            data.ctrl[:], data.qfrc_applied[:] = random.normal(size=4), random.normal(size=7)
            with installed(model):
                mujoco.mj_forward(model, data)
            wrench, acceleration = data.xfrc_applied.copy(), data.qacc.copy()
            mujoco.set_mjcb_control(slow.control)
            mujoco.mj_forward(model, data)
            mujoco.set_mjcb_control(None)
            assert np.abs(data.xfrc_applied - wrench).max() < 1e-12 * np.abs(wrench).max()
            assert np.abs(data.qacc - acceleration).max() < 1e-12 * np.abs(acceleration).max()


def test_compiled_and_numpy_callback_agree_in_space(pike: Fish) -> None:
    """The same with a free joint: the planar force must find each link's own plane."""
    spec = planar.build(pike)
    for name in ("x", "y", "yaw"):
        spec.delete(spec.joint(name))
    spec.body("head").add_freejoint()
    parameters.reserve(spec, len(pike.links))
    model = spec.compile()
    parameters.write(model, [link.name for link in pike.links], link_records(pike, {"c_m.tail": 1.0}))
    data = mujoco.MjData(model)
    random = np.random.default_rng(_SEED)
    for _ in range(5):
        data.qpos[:], data.qvel[:] = random.normal(size=model.nq), random.normal(size=model.nv)
        with installed(model):
            mujoco.mj_forward(model, data)
        wrench = data.xfrc_applied.copy()
        mujoco.set_mjcb_control(slow.control)
        mujoco.mj_forward(model, data)
        mujoco.set_mjcb_control(None)
        np.testing.assert_allclose(data.xfrc_applied, wrench, rtol=0, atol=1e-12 * np.abs(wrench).max())


def _free_chain(pike: Fish, munk: float) -> mujoco.MjModel:
    """Return the pike without drag and with limp joints, c_m = 1."""
    still = {name: 1.0 if name.startswith("c_m") else 0.0 for name in COEFFICIENTS}
    model = planar.model(pike.model_copy(update={"munk_moment": munk}), values=still)
    model.actuator_gainprm[:] = 0.0
    model.actuator_biasprm[:] = 0.0
    return model


def _invariants(model: mujoco.MjModel, data: mujoco.MjData) -> FloatArray:
    """Return energy and total impulse (two linear, one angular about the world's origin) of body and water."""
    inertia = np.zeros((model.nv, model.nv))
    mujoco.mj_forward(model, data)
    mujoco.mj_fullM(model, data, inertia)
    for body, record in zip(*parameters.read(model), strict=True):
        J = slow.jacobian_of(model, data, body)
        inertia += J.T @ slow.inertia_of(record) @ J
    momentum = inertia @ data.qvel
    px, py, turning = momentum[:3]
    x, y = data.qpos[:2]
    return np.array([0.5 * momentum @ data.qvel, px, py, turning + x * py - y * px])


def _drift(pike: Fish, munk: float, step: float) -> float:
    """Return the largest change of the invariants after half a second of tumbling."""
    model = _free_chain(pike, munk)
    model.opt.timestep = step
    data = mujoco.MjData(model)
    data.qpos[3:] = [0.3, -0.2, 0.4, 0.1]
    data.qvel[:] = [0.5, 0.2, 1.0, -3.0, 2.0, 4.0, -5.0]
    with installed(model):
        before = _invariants(model, data)
        for _ in range(round(0.5 / step)):
            mujoco.mj_step(model, data)
        return float(np.abs(_invariants(model, data) - before).max())


def test_energy_and_impulse_are_conserved_without_drag(pike: Fish) -> None:
    """Kirchhoff's water (munk_moment = 1) takes nothing; the drift is RK4's and falls at its order.

    Catches a wrong sign of the gyroscopic terms, a moment about the wrong point, a missing J'q' of the added mass.
    """
    drifts = [_drift(pike, 1.0, step) for step in (4e-3, 2e-3, 1e-3, 5e-4)]
    orders = np.log2(np.divide(drifts[:-1], drifts[1:]))
    assert drifts[2] < 2e-5
    assert np.all(orders > 3.85), orders
    assert _drift(pike, 0.0, 1e-3) > 1e-2, "Morison's water does take energy: the test must see that"


def test_two_models_with_other_coefficients_do_not_disturb_each_other(pike: Fish) -> None:
    slippery, sticky = planar.model(pike, values={"c_d.head": 0.1}), planar.model(pike, values={"c_d.head": 4.0})

    def run(*models: mujoco.MjModel) -> list[FloatArray]:
        states = [mujoco.MjData(model) for model in models]
        for state in states:
            state.qvel[:3] = [0.5, 0.3, 0.5]
        with installed(*models):
            for _ in range(200):
                for model, state in zip(models, states, strict=True):
                    mujoco.mj_step(model, state)
        return [state.qvel.copy() for state in states]

    (first,), (second,) = run(slippery), run(sticky)
    together = run(slippery, sticky)
    np.testing.assert_array_equal(together[0], first)
    np.testing.assert_array_equal(together[1], second)
    assert np.abs(first - second).max() > 1e-2


def test_threads_that_share_a_model_give_bitwise_the_same(pike: Fish) -> None:
    """Catches a callback that writes into the shared model."""
    models = [planar.model(pike, values={"c_m.tail": c_m}) for c_m in (0.1, 1.0)]
    for model in models:
        bodies = [link.name for link in pike.links]
        parameters.write(model, bodies, parameters.read(model)[1], commanded=False)
    batch = [models[k // 4] for k in range(8)]
    size = mujoco.mj_stateSize(models[0], mujoco.mjtState.mjSTATE_FULLPHYSICS)
    start = np.zeros((8, size))
    start[:, 1:] = 0.3 * np.random.default_rng(_SEED).normal(size=(8, size - 1))
    control = np.full((8, 100, 4), 0.2)

    def run(threads: int) -> FloatArray:
        states = [mujoco.MjData(models[0]) for _ in range(threads)]
        with installed(*models):
            trajectory, _ = mujoco.rollout.rollout(batch, states, start, control)
        return np.asarray(trajectory)

    before = [model.numeric_data.copy() for model in models]
    one, two = run(1), run(2)
    np.testing.assert_array_equal(one, two)
    np.testing.assert_array_equal([model.numeric_data for model in models], before)
    assert np.all(np.isfinite(one))
    assert np.abs(one[:4] - one[4:]).max() > 1e-3
