"""The fish that is free in space: trimmed, righting, and planar where nothing excites the rest."""

from __future__ import annotations

import dataclasses
import itertools

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mjfish import fish as fishes
from mjfish.drive import cpg, modes
from mjfish.drive.motion import JointMotion, grid
from mjfish.errors import InputError
from mjfish.fish import Fish, load_fish
from mjfish.fish.outline import section_at
from mjfish.mujoco import StripFluid, Trim, mjcf, simulate
from mjfish.mujoco.rollout import euler_angles, yaw_rate
from mjfish.numerics.arrays import FloatArray

#: Only looks decide these.
_LOOKS = {"body_geomadr", "body_geomnum", "dof_length"}
_IDEAL = {f"c_{kind}.{group}": 0.0 for kind in "df" for group in ("head", "body", "tail")}


def _command(fish: Fish, mode: str, duration: float, step: float = 0.001) -> JointMotion:
    assert fish.cpg is not None
    return cpg.joint_motion(fish.cpg, modes.drive(mode), duration, step)


def _still(angle: FloatArray, duration: float, step: float = 0.002) -> JointMotion:
    """Return joints that are held."""
    time = grid(np.array([0.0, duration]), step)
    held = np.broadcast_to(angle, (len(time) - 1, 3, len(angle)))
    return JointMotion(time, held, np.zeros_like(held), np.zeros_like(held))


def test_hand_written_and_built_free_pike_are_the_same_model(pike: Fish) -> None:
    """Catches a number of the XML that follows neither the fish's TOML nor the rule for its inertia."""
    written, built = mjcf.spec(pike, Trim()).compile(), mjcf.build(pike, free=True).compile()
    assert written.geom("fin_upper").id >= 0, "spec() did not take the hand-written file"
    for name in dir(built):
        value = getattr(written, name)
        physical = name.partition("_")[0] in ("body", "jnt", "dof", "actuator") and name not in _LOOKS
        if physical and isinstance(value, np.ndarray):
            np.testing.assert_allclose(value, getattr(built, name), rtol=1e-6, atol=1e-15, err_msg=name)
    assert written.opt.disableflags == built.opt.disableflags
    np.testing.assert_array_equal(written.opt.gravity, built.opt.gravity)


def test_free_and_planar_pike_look_and_weigh_the_same(pike: Fish) -> None:
    space, plane = mjcf.spec(pike, Trim()).compile(), mjcf.spec(pike).compile()
    np.testing.assert_array_equal(space.body_mass, plane.body_mass)
    np.testing.assert_array_equal(space.body_inertia[:, 2], plane.body_inertia[:, 2])
    for name in ("geom_pos", "geom_quat", "geom_size", "geom_rgba", "body_pos", "actuator_gainprm"):
        np.testing.assert_array_equal(getattr(space, name), getattr(plane, name), err_msg=name)


@pytest.mark.parametrize("name", sorted(fishes.shipped()))
def test_every_shipped_fish_floats_with_the_inertia_of_its_sections(name: str) -> None:
    """The rule from points spread over the sections; catches half axes taken for axes, or height for width."""
    fish = load_fish(name)
    water = mjcf.swimmer(fish, free=Trim())
    assert sum(strip.volume for strip in water.links) * fish.density == pytest.approx(water.model.body_mass.sum())
    front = np.cumsum([0.0, *(link.length for link in fish.links)])
    unit = np.random.default_rng(7).normal(size=(200_000, 2))
    unit *= np.sqrt(np.random.default_rng(8).uniform(size=(len(unit), 1))) / np.linalg.norm(unit, axis=1, keepdims=True)
    for link, start in zip(fish.links, front, strict=False):
        height, width = section_at(fish.sections, start + link.length * (np.arange(len(unit)) + 0.5) / len(unit))
        z, y = 0.5 * height * unit[:, 0], 0.5 * width * unit[:, 1]
        yy, zz = (np.average(square, weights=height * width) for square in (y * y, z * z))
        xx = link.inertia / link.mass - yy  # <x^2>, so that I_zz is Table I's
        expected = link.mass * np.array([yy + zz, xx + zz, xx + yy])
        np.testing.assert_allclose(water.model.body(link.name).inertia, expected, rtol=0.01)


def test_inertia_too_small_for_the_sections_draws_them_in(pike: Fish) -> None:
    """A link turns about z less than its sections alone would: MuJoCo refuses I_xx > I_yy + I_zz."""
    thin = pike.links[0].model_copy(update={"inertia": 2e-4})
    model = mjcf.swimmer(pike.model_copy(update={"links": (thin, *pike.links[1:])})).model
    x, y, z = model.body("head").inertia
    assert z == 2e-4
    assert 0.0 < x <= (y + z) * (1.0 + 1e-12)


@pytest.mark.parametrize("bend", [(0.0, 0.0, 0.0, 0.0), (0.3, -0.2, 0.4, 0.5)])
@pytest.mark.parametrize("trim", [Trim(), Trim(arm=0.008, drop=0.002)])
def test_fish_at_rest_hovers_level_in_every_shape(pike: Fish, bend: tuple[float, ...], trim: Trim) -> None:
    """Catches a volume or a centre of buoyancy of the outline in place of the trimmed: it sinks, or bent it rolls."""
    run = simulate(pike, _still(np.array(bend), 4.0), free=trim)
    assert run.time[-1] == pytest.approx(4.0)
    drift = np.column_stack([run.pose, run.attitude, run.joint_angle - np.array(bend)])
    assert np.abs(drift).max() < 1e-5


def _stiff(fish: Fish, trim: Trim) -> StripFluid:
    """Return the stretched fish as one rigid body in water without drag."""
    made = mjcf.prepared(fish, mjcf.spec(fish, trim), 0.002, "RK4")
    for actuator in list(made.actuators):
        made.delete(actuator)
    for index in range(1, fish.joints + 1):
        made.delete(made.joint(f"joint_{index}"))
    return StripFluid(made.compile(), mjcf.strips(fish, _IDEAL, trim), density=fish.density)


def _frequency(fluid: StripFluid, axis: int) -> float:
    """Return the frequency [rad/s] of a small swing in roll (0) or pitch (1), from its passages through zero."""
    data = mujoco.MjData(fluid.model)
    data.qpos[3] = 1.0
    data.qpos[4 + axis] = 0.5e-3
    angle, time = [], []
    with fluid.installed():
        while data.time < 20.0:
            angle.append(euler_angles(data.qpos[None, 3:7])[0, axis])
            time.append(data.time)
            mujoco.mj_step(fluid.model, data)
    a, t = np.array(angle), np.array(time)
    before = np.flatnonzero(a[:-1] * a[1:] < 0.0)
    passage = t[before] + (t[before + 1] - t[before]) * a[before] / (a[before] - a[before + 1])
    return float(np.pi * (len(passage) - 1) / (passage[-1] - passage[0]))


def _theory(fish: Fish, trim: Trim, values: dict[str, float], axis: int) -> float:
    """Return that frequency from a linear balance of the straight fish, omega^2 = m g arm (M^-1)_angle.

    M of the velocities (across, angle, other) of the nose: sway, roll, yaw; or heave, pitch, surge. A centre of mass at
    x, depth d moves with (1, d, x) resp. with (1, -x, 0) up and (0, -d, 1) forward; a strip has no d.
    """
    inertia = np.zeros((3, 3))
    model = mjcf.spec(fish, trim).compile()
    points, weights = np.polynomial.legendre.leggauss(12)
    edges = np.unique(
        [0.0, *np.cumsum([link.length for link in fish.links]), *(section.end for section in fish.sections)]
    )
    front = np.cumsum([0.0, *(link.length for link in fish.links)])
    depth = trim.depth
    for link, start in zip(fish.links, front, strict=False):
        x = -(start + link.com)
        ix, iy, iz = model.body(link.name).inertia
        arms = [(1.0, depth, x)] if axis == 0 else [(1.0, -x, 0.0), (0.0, -depth, 1.0)]
        inertia += sum(link.mass * np.outer(arm, arm) for arm in arms)
        inertia += np.diag([0.0, ix, iz] if axis == 0 else [0.0, iy, 0.0])
        for a, b in itertools.pairwise(edges):
            if a < start - 1e-9 or b > start + link.length + 1e-9:
                continue
            station = 0.5 * (a + b) + 0.5 * (b - a) * points
            height, width = section_at(fish.sections, station)
            c = values[f"c_m.{link.group}"] * fish.density * np.pi * 0.5 * (b - a) * weights
            for s, h, w, share in zip(station, height, width, c, strict=True):
                arm = (1.0, 0.0, -s) if axis == 0 else (1.0, s, 0.0)
                inertia += share * (h if axis == 0 else w) ** 2 / 4.0 * np.outer(arm, arm)
                inertia[1, 1] += share * (h**2 - w**2) ** 2 / 128.0 if axis == 0 else 0.0
    stiffness = sum(link.mass for link in fish.links) * mjcf.GRAVITY * trim.arm
    return float(np.sqrt(stiffness * np.linalg.inv(inertia)[1, 1]))


@pytest.mark.parametrize("axis", [0, 1], ids=["roll", "pitch"])
@pytest.mark.parametrize("trim", [Trim(), Trim(arm=0.006, drop=0.02)], ids=str)
def test_small_swings_have_the_frequency_of_linear_theory(pike: Fish, axis: int, trim: Trim) -> None:
    """Catches a missing roll inertia of the water, or a coupling of roll and sway by a wrong height."""
    values = {f"c_m.{group}": c_m for group, c_m in (("head", 1.0), ("body", 0.8), ("tail", 2.0))}
    heavy = pike.with_values(values)
    theory = _theory(heavy, trim, values, axis)
    assert _frequency(_stiff(heavy, trim), axis) == pytest.approx(theory, rel=1e-4)
    dry = _theory(heavy, trim, dict.fromkeys(values, 0.0), axis)
    level = _theory(heavy, dataclasses.replace(trim, drop=0.0), values, axis)
    assert abs(dry / theory - 1.0) > 0.01, "the water must matter"
    if axis == 0 and trim.depth > 0.01:
        assert abs(level / theory - 1.0) > 0.01, "the coupling with sway must matter"


@pytest.mark.parametrize("trim", [Trim(arm=0.0, drop=0.0), Trim(arm=0.004, drop=0.0)], ids=str)
def test_fish_that_nothing_rolls_swims_in_the_plane(pike: Fish, trim: Trim) -> None:
    """With the centres of mass on the axis of the strips v1 and a turn are those of the planar fish."""
    for mode in ("v1", "v1-t2"):
        command = _command(pike, mode, 7.0)
        plane, space = simulate(pike, command), simulate(pike, command, free=trim)
        np.testing.assert_allclose(space.velocity, plane.velocity, rtol=0, atol=1e-8)
        np.testing.assert_allclose(space.pose, plane.pose, rtol=0, atol=1e-8)
        np.testing.assert_allclose(space.joint_acceleration, plane.joint_acceleration, rtol=0, atol=1e-6)
        assert np.abs(space.attitude).max() < 1e-8
        assert not plane.attitude.any()


def test_start_with_way_on_is_that_of_the_plane(pike: Fish) -> None:
    """Catches a yaw rate put into the roll rate of the free joint."""
    velocity, still = np.array([0.5, -0.2, 0.3]), _still(np.zeros(4), 0.5)
    plane = simulate(pike, still, velocity=velocity)
    space = simulate(pike, still, velocity=velocity, free=Trim(drop=0.0))
    np.testing.assert_allclose(space.velocity, plane.velocity, rtol=0, atol=1e-8)


def test_mirrored_drive_mirrors_roll_and_leaves_pitch(pike: Fish) -> None:
    """A centre of mass below the axis rolls and pitches the fish; catches a term that knows port from starboard."""
    command = _command(pike, "v3", 1.0)
    mirrored = JointMotion(command.time, -command.angle, -command.rate, -command.acceleration)
    run, other = (simulate(pike, one, free=Trim()) for one in (command, mirrored))
    assert np.abs(run.attitude[:, :2]).max(axis=0).min() > 0.1
    np.testing.assert_allclose(other.attitude, run.attitude * [-1.0, 1.0, 1.0], rtol=0, atol=1e-9)
    np.testing.assert_allclose(other.velocity, run.velocity * [1.0, -1.0, -1.0], rtol=0, atol=1e-9)


def test_centre_of_mass_above_the_axis_turns_the_fish_upside_down_in_effect(pike: Fish) -> None:
    """What rolls it is the height of the mass alone: with the same mass above the axis roll and pitch change sign."""
    command = _command(pike, "v1", 1.0)
    below, above = (simulate(pike, command, free=Trim(drop=drop)) for drop in (0.004, -0.004))
    np.testing.assert_allclose(above.attitude, -below.attitude, rtol=0, atol=1e-9)
    np.testing.assert_allclose(above.velocity, below.velocity, rtol=0, atol=1e-9)


def test_both_couplings_swim_alike_in_space(pike: Fish) -> None:
    command = _command(pike, "v1-t2", 1.0)
    runs = [simulate(pike, command, coupling=coupling, free=Trim()) for coupling in ("inertia", "xfrc")]
    assert np.abs(runs[0].attitude).max(axis=0).min() > 0.01
    np.testing.assert_allclose(runs[1].attitude, runs[0].attitude, rtol=0, atol=1e-9)
    np.testing.assert_allclose(runs[1].velocity, runs[0].velocity, rtol=0, atol=1e-9)


@pytest.mark.parametrize("integrator", ["Euler", "implicitfast", "implicit", "discrete"])
def test_every_integrator_rolls_alike(pike: Fish, integrator: mjcf.Integrator) -> None:
    """The difference to RK4 halves with the step: first order, and nothing else is different."""
    errors = []
    for step in (2e-4, 1e-4):
        command = _command(pike, "v1", 0.4, step)
        exact, run = (simulate(pike, command, integrator=one, free=Trim()) for one in ("RK4", integrator))
        errors.append(np.abs(run.attitude - exact.attitude).max(axis=0))
    assert np.abs(exact.attitude[:, 0]).max() > 0.05
    np.testing.assert_allclose(np.log2(errors[0] / errors[1]), 1.0, atol=0.2)


def test_attitude_is_that_of_the_rotation_and_yaw_rate_its_rate() -> None:
    """Against scipy, over turns; catches a swapped order of the angles, a yaw that jumps by a turn."""
    time = np.linspace(0.0, 10.0, 20001)
    angles = np.column_stack([0.9 * np.sin(time), 0.7 * np.cos(1.3 * time), 2.0 * time])
    rotation = Rotation.from_euler("ZYX", angles[:, ::-1])
    np.testing.assert_allclose(euler_angles(rotation.as_quat(scalar_first=True)), angles, rtol=0, atol=1e-12)
    between = (rotation[:-1].inv() * rotation[1:]).as_rotvec() / np.diff(time)[:, None]
    middle = 0.5 * (angles[:-1] + angles[1:])
    np.testing.assert_allclose(yaw_rate(middle, between), 2.0, rtol=0, atol=1e-6)


@pytest.mark.parametrize("numbers", [{"arm": float("nan")}, {"drop": float("inf")}])
def test_trim_that_is_no_number_is_refused(numbers: dict[str, float]) -> None:
    (name,) = numbers
    with pytest.raises(InputError, match=f"trim: {name} is (nan|inf) m; expected a finite number"):
        Trim(**numbers)
