"""Runs of the MuJoCo fish: against mj_step, against the reference trajectories, and those that diverge."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from mjfish import ode
from mjfish.drive import cpg, modes
from mjfish.drive.motion import JointMotion, grid
from mjfish.errors import InputError
from mjfish.fish import Fish, Servo
from mjfish.mujoco import mjcf, simulate
from mjfish.mujoco.coupling_choice import Coupling
from mjfish.mujoco.mjcf import Integrator
from mjfish.numerics.arrays import FloatArray


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


@pytest.mark.parametrize(
    ("integrator", "coupling"),
    [
        ("RK4", "inertia"),
        ("RK4", "xfrc"),
        ("Euler", "inertia"),
        ("implicitfast", "inertia"),
        ("implicit", "inertia"),
        ("discrete", "inertia"),
    ],
)
def test_rollout_is_what_mj_step_does(pike: Fish, integrator: Integrator, coupling: Coupling) -> None:
    """The rollout takes the two halves of mj_step apart to read the accelerations; bit for bit the same."""
    command = _command(pike, "v1", 0.2, 0.001)
    run = simulate(pike, command, integrator=integrator, coupling=coupling)
    fluid = mjcf.swimmer(pike, integrator=integrator, coupling=coupling)
    model = fluid.model
    data = mujoco.MjData(model)
    with fluid.installed():
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


def test_stiffer_servos_approach_the_reference(pike: Fish, reference: Path) -> None:
    expected = _reference(reference, "v1_published", 1.0)
    errors = []
    for stiffer in (1.0, 4.0, 16.0):
        servo = Servo(kp=40.0 * stiffer**2, kv=0.1 * stiffer)
        step = 0.001 / stiffer
        run = simulate(pike.model_copy(update={"servo": servo}), _command(pike, "v1", 1.0, step))
        errors.append(np.abs(run.velocity[_at(run.time, expected[:, 0])] - expected[:, 1:]).max())
    assert errors[0] > 3.0 * errors[1] > 9.0 * errors[2], errors
    assert errors[2] < 0.3


@pytest.mark.parametrize(
    ("integrator", "order"), [("RK4", 4.0), ("Euler", 1.0), ("implicitfast", 1.0), ("implicit", 1.0), ("discrete", 1.0)]
)
def test_every_integrator_converges_at_its_order_to_the_same(pike: Fish, integrator: Integrator, order: float) -> None:
    """The implicit ones, too: they see the added mass. Catches a lagged force, and damping without the water's mass."""
    steps = (5e-4, 2.5e-4)  # at 1 ms the servos are too stiff for the order of RK4 to show
    exact = simulate(pike, _command(pike, "v1", 0.3, 6.25e-5)).velocity[-1]
    errors = [
        np.abs(simulate(pike, _command(pike, "v1", 0.3, step), integrator=integrator).velocity[-1] - exact).max()
        for step in steps
    ]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(order, abs=0.25)


def test_couplings_give_the_same_run(pike: Fish) -> None:
    command = _command(pike, "v3", 0.3, 0.001)
    runs = [simulate(pike, command, coupling=coupling).velocity for coupling in ("inertia", "xfrc")]  # type: ignore[arg-type]
    np.testing.assert_allclose(runs[0], runs[1], rtol=0, atol=1e-9)


def test_realised_motion_is_consistent_to_fourth_order(pike: Fish) -> None:
    """The middles of `motion` come from a quintic; a run of half the step has them as samples."""
    errors = []
    for step in (0.002, 0.001):
        coarse = simulate(pike, _sine(pike.joints, 0.5, step)).motion()
        fine = simulate(pike, _sine(pike.joints, 0.5, step / 2))
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
    run = simulate(pike, cpg.joint_motion(pike.cpg, segments, 0.4, 0.001))
    assert len(np.unique(np.diff(run.time).round(9))) > 1
    assert 0.2505 in run.time
    difference = np.abs(ode.simulate(pike, run.motion()).state[:, 1, :3] - run.velocity[1:])
    assert np.all(difference.max(axis=0) < 2e-5 * np.ptp(run.velocity, axis=0))


def test_start_with_way_on_agrees_with_the_ode(pike: Fish) -> None:
    """Catches a start velocity taken in the model's frame: surge forward, sway to port."""
    time = grid(np.array([0.0, 0.5]), 0.001)
    still = np.zeros((len(time) - 1, 3, pike.joints))
    velocity = np.array([0.5, -0.2, 0.3])
    run = simulate(pike, JointMotion(time, still, still, still), velocity=velocity)
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
    run = simulate(stiff, _command(pike, "v1", 0.5, 0.001))
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
        simulate(
            pike,
            JointMotion(command.time, command.angle[..., :3], command.rate[..., :3], command.acceleration[..., :3]),
        )
    broken = np.where(command.angle > 0.02, np.nan, command.angle)
    with pytest.raises(InputError, match="no finite numbers"):
        simulate(pike, JointMotion(command.time, broken, command.rate, command.acceleration))
