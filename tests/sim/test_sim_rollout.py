"""Runs of the MuJoCo fish: against mj_step, against the reference trajectories, and those that diverge."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from mjfish import frames, ode, sim
from mjfish.arrays import FloatArray
from mjfish.drive import cpg, modes
from mjfish.drive.motion import JointMotion, grid
from mjfish.errors import InputError
from mjfish.fish import Fish, Servo
from mjfish.hydro.link import link_records
from mjfish.sim import parameters, planar
from mjfish.sim.rollout import _steps

#: Rotor inertia of joints that nothing but their motor moves [kg m2].
_ROTOR = 1e7


def _command(fish: Fish, mode: str, duration: float, step: float) -> JointMotion:
    assert fish.cpg is not None
    return cpg.joint_motion(fish.cpg, modes.drive(mode), duration, step)


def _sine(joints: int, duration: float, step: float) -> JointMotion:
    """Return a smooth wave of joint angles on an even grid; it starts still."""
    time = grid(np.array([0.0, duration]), step)
    stages = np.stack([time[:-1], 0.5 * (time[:-1] + time[1:]), time[1:]], axis=1)
    angle = 0.2 * np.sin(18.0 * stages) ** 2
    wave = np.repeat(angle[..., None], joints, axis=-1) * [1.0, -0.5, -1.0, 0.5][:joints]
    return JointMotion(time=time, angle=wave, rate=np.zeros_like(wave), acceleration=np.zeros_like(wave))


def _at(time: FloatArray, wanted: FloatArray) -> FloatArray:
    """Return where the times `wanted` are among the boundaries of the steps."""
    index = np.searchsorted(time, wanted - 1e-9)
    np.testing.assert_allclose(time[index], wanted, atol=1e-9)
    return index


def test_rollout_is_what_mj_step_does(pike: Fish) -> None:
    """The rollout takes the two halves of mj_step apart to read the accelerations; bit for bit the same."""
    command = _command(pike, "v1", 0.2, 0.001)
    run = sim.simulate(pike, command)
    model = planar.model(pike)
    data = mujoco.MjData(model)
    with sim.installed(model):
        for step, width in enumerate(np.diff(command.time)):
            model.opt.timestep = width
            data.userdata[:] = [data.time, *command.angle[step].ravel()]
            mujoco.mj_step(model, data)
    np.testing.assert_array_equal(run.joint_rate[-1], data.qvel[3:])
    np.testing.assert_array_equal(run.pose[-1], data.qpos[:3])
    assert np.abs(run.velocity[-1]).max() > 0.1


def _reference(folder: Path, name: str, until: float) -> FloatArray:
    """Return time and velocity (n, 4) of a reference trajectory."""
    table = np.loadtxt(folder / f"{name}.csv", delimiter=",", skiprows=1)
    return np.asarray(table[table[:, 0] <= until + 1e-9, :4])


def _prescribed(fish: Fish, values: dict[str, float], motion: JointMotion) -> tuple[FloatArray, FloatArray]:
    """Return velocity and joint angles in MuJoCo with joints that heavy rotors drive at the asked acceleration."""
    spec = planar.build(fish)
    for index in range(1, fish.joints + 1):
        spec.joint(f"joint_{index}").armature = _ROTOR
        spec.actuator(f"servo_{index}").set_to_motor()
        spec.actuator(f"servo_{index}").gear[0] = _ROTOR
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_RK4
    spec.nuserdata = 1 + 3 * fish.joints
    parameters.reserve(spec, len(fish.links))
    model = spec.compile()
    parameters.write(model, [link.name for link in fish.links], link_records(fish, values), commanded=True)
    data = mujoco.MjData(model)
    data.qpos[3:], data.qvel[3:] = motion.angle[0, 0], motion.rate[0, 0]
    asked = JointMotion(time=motion.time, angle=motion.acceleration, rate=motion.rate, acceleration=motion.acceleration)
    position, speed, _ = _steps(model, data, asked)
    nose = frames.to_body(speed[:, :2], position[:, 2])
    return np.column_stack([nose, speed[:, 2]]), position[:, 3:]


#: Mode, end [s], c_m, c_d, c_f, munk; runs end where the drive, and with it the joint rate, would jump.
_CASES = {
    "v1_published": ("v1", 10.4, (0.01, 0.07, 0.06), (4, 1.5, 2.5), (0.02, 0.02, 0.02), 0.0),
    "v5-v1_published": ("v5-v1", 5.19, (0.01, 0.07, 0.06), (4, 1.5, 2.5), (0.02, 0.02, 0.02), 0.0),
    "v3-t2_alternative": ("v3-t2", 5.19, (3, 0.01, 0.40), (4, 0.1, 0.18), (0.02, 0.010, 0.009), 0.0),
    "v1-t1_unit_munk": ("v1-t1", 5.19, (1, 1, 1), (1, 1, 1), (0.01, 0.01, 0.01), 1.0),
}


@pytest.mark.parametrize("name", _CASES)
def test_prescribed_joints_reproduce_the_reference(pike: Fish, reference: Path, name: str) -> None:
    """MuJoCo's rigid body with our water against a formulation by total momentum: they share no equation."""
    mode, until, *kinds, munk = _CASES[name]
    groups = ("head", "body", "tail")
    values = {
        f"{kind}.{group}": float(value)
        for kind, three in zip(("c_m", "c_d", "c_f"), kinds, strict=True)
        for group, value in zip(groups, three, strict=True)
    }
    motion = _command(pike, mode, until, 0.001)
    velocity, angle = _prescribed(pike.model_copy(update={"munk_moment": munk}), values, motion)
    expected = _reference(reference, name, until)
    np.testing.assert_allclose(angle[:-1], motion.angle[:, 0], rtol=0, atol=1e-5)
    sampled = velocity[_at(motion.time, expected[:, 0])]
    np.testing.assert_allclose(sampled, expected[:, 1:], rtol=0, atol=1e-5)


def test_stiffer_servos_approach_the_reference(pike: Fish, reference: Path) -> None:
    expected = _reference(reference, "v1_published", 1.0)
    errors = []
    for stiffer in (1.0, 4.0, 16.0):
        servo = Servo(kp=40.0 * stiffer**2, kv=0.1 * stiffer)
        step = 0.001 / stiffer
        run = sim.simulate(pike.model_copy(update={"servo": servo}), _command(pike, "v1", 1.0, step))
        errors.append(np.abs(run.velocity[_at(run.time, expected[:, 0])] - expected[:, 1:]).max())
    assert errors[0] > 3.0 * errors[1] > 9.0 * errors[2], errors
    assert errors[2] < 0.3


def test_euler_converges_at_first_order_to_rk4(pike: Fish) -> None:
    exact = sim.simulate(pike, _command(pike, "v1", 0.5, 0.0005)).velocity[-1]
    errors = [
        np.abs(sim.simulate(pike, _command(pike, "v1", 0.5, step), integrator="Euler").velocity[-1] - exact).max()
        for step in (2.5e-4, 1.25e-4)
    ]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(1.0, abs=0.15)


def test_realised_motion_is_consistent_to_fourth_order(pike: Fish) -> None:
    """The middles of `motion` come from a quintic; a run of half the step has them as samples."""
    errors = []
    for step in (0.002, 0.001):
        coarse = sim.simulate(pike, _sine(pike.joints, 0.5, step)).motion()
        fine = sim.simulate(pike, _sine(pike.joints, 0.5, step / 2))
        errors.append(
            [
                np.abs(coarse.angle[:, 1] - fine.joint_angle[1::2]).max(),
                np.abs(coarse.rate[:, 1] - fine.joint_rate[1::2]).max(),
                np.abs(coarse.acceleration[:, 1] - fine.joint_acceleration[1::2]).max(),
            ]
        )
    orders = np.log2(np.divide(errors[0], errors[1]))
    assert np.all(orders > 3.7), orders
    assert errors[1][2] < 5e-3 * np.abs(fine.joint_acceleration).max()


def test_steps_of_several_lengths_hit_the_change_of_the_drive(pike: Fish) -> None:
    """A change at 0.2505 s lies on no grid of 1 ms: the steps differ, and the run agrees with the ODE."""
    assert pike.cpg is not None
    first, second = modes.drive("v1")[0], modes.drive("v5")[0]
    segments = (first, cpg.DriveSegment(0.2505, second.omega, second.bias))
    run = sim.simulate(pike, cpg.joint_motion(pike.cpg, segments, 0.4, 0.001))
    assert len(np.unique(np.diff(run.time).round(9))) > 1
    assert 0.2505 in run.time
    difference = np.abs(ode.simulate(pike, run.motion()).state[:, 1, :3] - run.velocity[1:])
    assert np.all(difference.max(axis=0) < 2e-5 * np.ptp(run.velocity, axis=0))


def test_start_with_way_on_agrees_with_the_ode(pike: Fish) -> None:
    """Catches a start velocity taken in the model's frame: surge forward, sway to port."""
    time = grid(np.array([0.0, 0.5]), 0.001)
    still = np.zeros((len(time) - 1, 3, pike.joints))
    velocity = np.array([0.5, -0.2, 0.3])
    run = sim.simulate(pike, JointMotion(time, still, still, still), velocity=velocity)
    np.testing.assert_array_equal(run.velocity[0], velocity)
    assert run.pose[-1, 0] > 0.1
    same = ode.simulate(pike, run.motion(), velocity=velocity)
    np.testing.assert_allclose(same.state[:, 1, :3], run.velocity[1:], rtol=0, atol=1e-5)
    np.testing.assert_allclose(same.state[:, 1, 3:6], run.pose[1:], rtol=0, atol=1e-5)


def test_run_that_diverges_is_a_status_with_time_and_parameters(
    pike: Fish, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """Catches MuJoCo's silent reset, and the warnings and the log file that it leaves behind."""
    monkeypatch.chdir(tmp_path)
    stiff = pike.model_copy(update={"servo": Servo(kp=20.0, kv=5.0)})
    run = sim.simulate(stiff, _command(pike, "v1", 0.5, 0.001))
    assert run.status == "diverged"
    assert "c_m.tail = 0.06" in run.message
    assert f"diverged at {run.time[-1]:.3f} s" in run.message
    assert 1 < len(run.time) < 100
    assert len(run.time) == len(run.velocity) == len(run.joint_acceleration)
    assert np.all(np.diff(run.time) > 0)
    assert not list(tmp_path.iterdir())
    assert capfd.readouterr().err == ""


def test_command_that_does_not_fit_is_refused(pike: Fish) -> None:
    command = _command(pike, "v1", 0.1, 0.001)
    with pytest.raises(InputError, match="has 3 joints, pike has 4"):
        sim.simulate(
            pike,
            JointMotion(command.time, command.angle[..., :3], command.rate[..., :3], command.acceleration[..., :3]),
        )
    broken = np.where(command.angle > 0.02, np.nan, command.angle)
    with pytest.raises(InputError, match="no finite numbers"):
        sim.simulate(pike, JointMotion(command.time, broken, command.rate, command.acceleration))
