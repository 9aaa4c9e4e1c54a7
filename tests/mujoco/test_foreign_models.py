"""Models that are not ours in water: the two examples of docs/mujoco-plugin.md, against what physics says of them."""

from __future__ import annotations

from types import ModuleType
from typing import Any

import mujoco
import numpy as np
import pytest
from doc_blocks import ROOT, module
from scipy.integrate import simpson

from mjfish import StripFluid
from mjfish.errors import InputError
from mjfish.mujoco.coupling_choice import Coupling
from mjfish.numerics.arrays import FloatArray

_PLATE = ROOT / "models" / "xml" / "towed_plate.xml"
_RHO, _LENGTH, _HEIGHT = 1000.0, 0.3, 0.2
_MASS = 2700.0 * 0.3 * 0.004 * 0.2


@pytest.fixture
def swimmer() -> ModuleType:
    """The page's swimmer.py, anew for every test: its LENGTH and BEAT may be changed."""
    return module(ROOT / "docs" / "mujoco-plugin.md", "swimmer")


def _run(fluid: StripFluid, drive: Any, seconds: float, velocity: tuple[float, ...] = ()) -> mujoco.MjData:
    """Step from rest, or from a velocity of the root; `drive` returns the servo commands at a time."""
    data = mujoco.MjData(fluid.model)
    data.qvel[: len(velocity)] = velocity
    with fluid.installed():
        for _ in range(round(seconds / fluid.model.opt.timestep)):
            data.ctrl[:] = drive(data.time)
            mujoco.mj_step(fluid.model, data)
        mujoco.mj_forward(fluid.model, data)
    assert fluid.state(data).status == "ok"
    return data


def _chain_in_water(swimmer: ModuleType, links: int, step: float = 0.002, **water: Any) -> StripFluid:
    model = swimmer.chain(links).compile()
    model.opt.timestep = step
    return StripFluid(model, swimmer.strips(links, **water))


def test_two_links_that_open_and_close_do_not_swim(swimmer: ModuleType) -> None:
    """Each half of the swimmer mirrors the other, so its centre of mass stays; RK4's drift falls at its order.

    Catches a force that depends on which end of a link is called its front: moments about the wrong point, strips
    laid out the wrong way, and a root whose added mass lags.
    """

    def drift(step: float) -> float:
        fluid = _chain_in_water(swimmer, 2, step)
        before = -0.5 * swimmer.LENGTH
        return float(_run(fluid, lambda time: swimmer.wave(2, time), 1.0).subtree_com[1, 0]) - before

    drifts = np.abs([drift(step) for step in (4e-3, 2e-3, 1e-3)])
    assert drifts[2] < 1e-8
    assert np.all(np.log2(drifts[:-1] / drifts[1:]) > 3.9), drifts


@pytest.mark.parametrize("links", [6, 20])
def test_chain_swims_against_its_wave_and_backwards_with_the_wave_reversed(swimmer: ModuleType, links: int) -> None:
    """Reversed in space, the wave drives the mirror image of the swimmer: the same path, tail first."""
    fluid = _chain_in_water(swimmer, links)
    head_first = _run(fluid, lambda time: swimmer.wave(links, time), 3.0).subtree_com[1]
    tail_first = _run(fluid, lambda time: swimmer.wave(links, time)[::-1], 3.0).subtree_com[1]
    middle = np.array([-0.5 * swimmer.LENGTH, 0.0, 0.0])
    assert (head_first - middle)[0] > 0.5 * swimmer.LENGTH
    # Mirrored fore and aft: x and the sense of turning change their signs, and so do y and the angles, twice.
    np.testing.assert_allclose((tail_first - middle)[:2], (head_first - middle)[:2] * (-1, 1), atol=2e-5)


@pytest.mark.parametrize(("length", "beat"), [(2.0, 1.0), (1.0, 0.5), (2.0, 0.5)])
def test_speed_scales_with_length_times_frequency(swimmer: ModuleType, length: float, beat: float) -> None:
    """Without viscosity U = L f F(shape) and torques go with rho L^5 f^2, if inertia and servo are scaled alike.

    Catches any length, time or density that is written into the code.
    """

    def swim(step: float, size: float, rate: float) -> tuple[float, float]:
        spec = swimmer.chain(6)
        spec.option.timestep = step
        for joint in spec.joints[3:]:
            joint.armature *= size**5
        for servo in spec.actuators:
            servo.set_to_position(kp=10.0 * size**5 * rate**2, kv=0.2 * size**5 * rate)
        model = spec.compile()
        speed, torque = swimmer.swim(model, StripFluid(model, swimmer.strips(6, height=5 * swimmer.RADIUS)), 3)
        return float(speed), float(torque)

    speed, torque = swim(0.002, 1.0, 1.0)
    swimmer.LENGTH, swimmer.RADIUS, swimmer.BEAT = length, 0.02 * length, beat
    rate = 1.0 / beat
    scaled = swim(0.002 * beat, length, rate)
    assert scaled == pytest.approx((speed * length * rate, torque * length**5 * rate**2), rel=1e-9)
    assert speed > 0.3


@pytest.mark.parametrize("links", [2, 6, 20])
def test_a_straight_chain_is_one_rod(swimmer: ModuleType, links: int) -> None:
    """However many links, the drag of a rigid motion is that of the whole, and so is its moment about the nose.

    Catches an error of a link's place: its origin, its own velocity, the moment's arm.
    """

    def pulled(count: int) -> FloatArray:
        fluid = _chain_in_water(swimmer, count, height=0.1)
        data = mujoco.MjData(fluid.model)
        data.qpos[2] = 0.3
        data.qvel[:3] = (0.4, -0.2, 1.5)
        with fluid.installed():
            mujoco.mj_forward(fluid.model, data)
        drag = fluid.wrenches(data)["drag"]
        moment = drag[:, 3:] + np.cross(data.xipos[1:], drag[:, :3])
        return np.concatenate([drag[:, :3].sum(axis=0), moment.sum(axis=0)])

    np.testing.assert_allclose(pulled(links), pulled(1), rtol=0, atol=1e-11)


@pytest.mark.parametrize("links", [6, 20])
def test_logged_forces_change_the_momentum(swimmer: ModuleType, links: int) -> None:
    """The impulse of `wrenches` is the change of the bodies' momentum: nothing is missing in the log, or twice.

    The servos hold a bent shape that the chain is not in: commands that change in steps would make the forces jump.
    """
    fluid = _chain_in_water(swimmer, links, height=0.1)
    model, data = fluid.model, mujoco.MjData(fluid.model)
    data.qvel[:3] = (0.5, 0.2, 1.0)
    data.ctrl[:] = swimmer.wave(links, 1.2)
    momentum, force = [], []
    with fluid.installed():
        for _ in range(1001):
            mujoco.mj_forward(model, data)
            mujoco.mj_subtreeVel(model, data)
            momentum.append(model.body_subtreemass[1] * data.subtree_linvel[1, :2])
            force.append(fluid.wrenches(data)["total"][:, :2].sum(axis=0))
            mujoco.mj_step(model, data)
    impulse = simpson(force, dx=model.opt.timestep, axis=0)
    np.testing.assert_allclose(impulse, momentum[-1] - momentum[0], atol=1e-5 * np.abs(momentum).max())


def test_swimmer_in_a_current_swims_as_in_still_water(swimmer: ModuleType) -> None:
    """`opt.wind` is a current: the swimmer is carried along and does all else as before."""
    still, carried = (_chain_in_water(swimmer, 6) for _ in range(2))
    carried.model.opt.wind[:2] = current = np.array([0.1, -0.25])
    ends = [
        _run(fluid, lambda time: swimmer.wave(6, time), 2.0, tuple(start)).qpos
        for fluid, start in ((still, (0.0, 0.0)), (carried, current))
    ]
    np.testing.assert_allclose(ends[1][2:], ends[0][2:], atol=1e-10)
    np.testing.assert_allclose(ends[1][:2], ends[0][:2] + 2.0 * current, atol=1e-10)


def test_both_couplings_swim_alike_and_joint_limits_choose(swimmer: ModuleType) -> None:
    """With limits only `inertia` is right, and is what a user gets; without, twenty links swim the same by either."""
    model = swimmer.chain(20).compile()
    assert StripFluid(model, swimmer.strips(20)).coupling == "inertia"
    with pytest.raises(InputError, match="joint limits of joint_1"):
        StripFluid(model, swimmer.strips(20), coupling="xfrc")

    def end(coupling: Coupling) -> FloatArray:
        free = swimmer.chain(20).compile()
        free.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_LIMIT
        fluid = StripFluid(free, swimmer.strips(20), coupling=coupling)
        return np.array(_run(fluid, lambda time: swimmer.wave(20, time), 1.0).qpos)

    np.testing.assert_allclose(end("xfrc"), end("inertia"), atol=1e-10)


def _plate(**coefficients: float) -> StripFluid:
    """The towed plate, its water read from the MJCF; coefficients replace those there."""
    spec = mujoco.MjSpec.from_file(str(_PLATE))
    for key, value in coefficients.items():
        spec.numeric(f"strip_fluid/plate/{key}").data = [value]
    return StripFluid(spec.compile())


@pytest.mark.parametrize(("c_d", "c_m"), [(1.9, 1.0), (0.5, 0.0), (1.2, 20.0)])
@pytest.mark.parametrize("force", [0.1, 10.0])
def test_towed_plate_comes_to_its_terminal_speed(c_d: float, c_m: float, force: float) -> None:
    """From rest under a steady force: v = V tanh(t / T), V = sqrt(2 F / (rho c_d A)), T = (m + m_a) V / F.

    V tells a wrong area or coefficient of drag, T a wrong added mass.
    """
    fluid = _plate(c_d=c_d, c_m=c_m)
    terminal = np.sqrt(2.0 * force / (_RHO * c_d * _LENGTH * _HEIGHT))
    added = c_m * _RHO * np.pi * _HEIGHT**2 / 4.0 * _LENGTH
    time = (_MASS + added) * terminal / force
    fluid.model.opt.timestep = time / 100.0
    for seconds in (0.5 * time, 2.0 * time, 15.0 * time):
        data = _run(fluid, lambda _: force, seconds)
        assert data.qvel[0] == pytest.approx(terminal * np.tanh(data.time / time), rel=1e-8)
    assert data.qvel[0] == pytest.approx(terminal, rel=1e-8)


def test_oscillated_plate_feels_drag_and_added_mass_of_the_closed_form() -> None:
    """At every instant, with both in one force of the motor; and over a beat the mean drag is the mean tow."""
    fluid = _plate()
    model, data = fluid.model, mujoco.MjData(fluid.model)
    steps, log = 1000, []
    with fluid.installed():
        for _ in range(5 * steps):
            data.ctrl[0] = 3.0 + 20.0 * np.sin(2.0 * np.pi * data.time / (steps * model.opt.timestep))
            mujoco.mj_forward(model, data)
            water = fluid.wrenches(data)
            log.append([data.ctrl[0], data.qvel[0], data.qacc[0], water["drag"][0, 1], water["added_mass"][0, 1]])
            mujoco.mj_step(model, data)
    tow, v, a, drag, inertial = np.array(log).T
    np.testing.assert_allclose(drag, -0.5 * _RHO * 1.9 * _HEIGHT * _LENGTH * np.abs(v) * v, atol=1e-12)
    np.testing.assert_allclose(inertial, -_RHO * np.pi * _HEIGHT**2 / 4.0 * _LENGTH * a, atol=1e-12)
    np.testing.assert_allclose(tow + drag + inertial, _MASS * a, atol=1e-12)
    assert drag[-steps:].mean() == pytest.approx(-3.0, rel=1e-5)
    assert (v < 0.0).any(), "it must go both ways, for the sign of the drag"


def test_plate_left_in_a_current_is_carried_along() -> None:
    """From u = c to u = c / (1 + k c t / (m + m_a)), k = rho c_d A / 2, of the velocity relative to the water."""
    current = 0.8
    fluid = StripFluid(_plate().model, current=(0.0, current, 0.0))
    data = _run(fluid, lambda _: 0.0, 3.0)
    added = _RHO * np.pi * _HEIGHT**2 / 4.0 * _LENGTH
    drag = 0.5 * _RHO * 1.9 * _HEIGHT * _LENGTH
    relative = current / (1.0 + drag * current * 3.0 / (_MASS + added))
    assert data.qvel[0] == pytest.approx(current - relative, rel=1e-8)


def test_plate_is_buoyed_by_the_weight_of_its_ellipses() -> None:
    """Along gravity, at the middle of the sections; none without gravity."""
    fluid = _plate()
    data = _run(fluid, lambda _: 0.0, 0.01)
    weight = _RHO * np.pi / 4.0 * _HEIGHT * 0.004 * _LENGTH * 9.81
    np.testing.assert_allclose(fluid.wrenches(data)["buoyancy"][0], [0, 0, weight, 0, 0, 0], atol=1e-12)
    fluid.model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_GRAVITY
    np.testing.assert_array_equal(fluid.wrenches(data)["buoyancy"][0], np.zeros(6))
