"""Uniform current: a change of inertial frame."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import integrate

from mjfish.data import Dataset, Trial
from mjfish.effects import find
from mjfish.fish import Fish, frames
from mjfish.model import Model, Prediction
from mjfish.numerics.arrays import FloatArray, readonly

CURRENT = find("ambient_current")
C = np.array([0.12, -0.07])


def _predict(fish: Fish, trial: Trial, x: float, y: float, held: float = 0.0) -> Prediction:
    model = Model(fish, (CURRENT,))
    sizes = {"x": x, "y": y, "held": held}
    return model.predict(trial, model.values({f"ambient_current.{short}": size for short, size in sizes.items()}))


def _headed(trial: Trial, yaw: float, drift: float = 0.0) -> Trial:
    """Return the trial with a measured pose that begins at this heading."""
    pose = np.zeros((len(trial.time), 3))
    pose[:, 2] = yaw + drift * (trial.time - trial.time[0])
    return replace(trial, pose=readonly(pose))


def _in_world(velocity: FloatArray, yaw: FloatArray) -> FloatArray:
    return frames.to_world(velocity[:, :2], yaw)


def test_velocity_over_ground_is_velocity_through_the_water_plus_the_current(pike: Fish, turning: Trial) -> None:
    """Everywhere in a turn; the heading is that of the same run. Catches a rotation the wrong way round."""
    still = Model(pike).predict(turning, Model(pike).values())
    yaw = still.rollout.at(turning.time)[:, 5]
    assert np.ptp(yaw) > 1.0
    read = _predict(pike, turning, *C).velocity
    drift = _in_world(read, yaw) - _in_world(still.velocity, yaw)
    np.testing.assert_allclose(drift, np.broadcast_to(C, drift.shape), rtol=0.0, atol=1e-13)
    assert np.array_equal(read[:, 2], still.velocity[:, 2])


def test_a_fish_without_drive_drifts_with_the_water_whatever_its_heading(pike: Fish) -> None:
    """At rest in the water it feels nothing of the current: no force, no turn."""
    time = np.linspace(0.0, 1.0, 51)
    resting = Trial("r", None, readonly(time), readonly(np.zeros((51, 3))), joint_angle=readonly(np.zeros((51, 4))))
    for yaw in (0.0, 0.7, -2.0):
        read = _predict(pike, _headed(resting, yaw), *C).velocity
        expected = [np.cos(yaw) * C[0] + np.sin(yaw) * C[1], np.cos(yaw) * C[1] - np.sin(yaw) * C[0], 0.0]
        np.testing.assert_allclose(read, np.broadcast_to(expected, (51, 3)), rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("yaw", [0.0, 0.7, -2.0])
def test_a_fish_that_was_held_begins_at_rest_for_the_camera(pike: Fish, straight: Trial, yaw: float) -> None:
    """In the water's frame it is a fish that was pushed. Catches a start along the wrong axis, or the wrong way."""
    trial = _headed(straight, yaw)
    read, still = _predict(pike, trial, *C, held=1.0), _predict(pike, trial, 0.0, 0.0)
    np.testing.assert_allclose(read.velocity[0], still.velocity[0], rtol=0.0, atol=1e-9)
    turn = np.array([[np.cos(yaw), np.sin(yaw)], [-np.sin(yaw), np.cos(yaw)]])
    against = Model(pike).predict(trial, Model(pike).values(), velocity=np.array([*(-turn @ C), 0.0]))
    heading = against.rollout.at(trial.time)[:, 5]
    through = read.velocity[:, :2] - frames.to_body(np.broadcast_to(C, (len(trial.time), 2)), heading)
    np.testing.assert_allclose(through, against.velocity[:, :2], rtol=0.0, atol=1e-12)
    adrift = _predict(pike, trial, *C).velocity
    assert np.max(np.abs(read.velocity - adrift)[:50]) > 0.05


def test_the_path_in_the_tank_is_that_of_the_velocity_over_ground(pike: Fish, turning: Trial) -> None:
    """Catches a place that stays behind with the water."""
    for held in (0.0, 1.0):
        read = _predict(pike, _headed(turning, 0.4), *C, held=held)
        ground = _in_world(read.velocity, read.pose[:, 2])
        path = integrate.cumulative_trapezoid(ground, turning.time, axis=0, initial=0.0)
        np.testing.assert_allclose(read.pose[:, :2], path, rtol=0.0, atol=4e-3)
        assert np.max(np.abs(path - turning.time[:, None] * C)) > 0.5
        assert np.max(np.abs(turning.time[:, None] * C)) > 0.2


def test_where_a_trial_does_not_begin_at_rest_the_start_is_free_anyhow(pike: Fish) -> None:
    time = np.linspace(0.0, 1.0, 51)
    bent = Trial("r", None, readonly(time), readonly(np.zeros((51, 3))), joint_angle=readonly(np.zeros((51, 4))))
    assert not bent.starts_at_rest
    adrift, held = (_predict(pike, _headed(bent, 0.3), *C, held=share).velocity for share in (0.0, 1.0))
    assert np.array_equal(adrift, held)


def test_the_same_run_in_the_opposite_heading_sees_the_opposite_current(pike: Fish, straight: Trial) -> None:
    still = _predict(pike, straight, 0.0, 0.0).velocity
    there, back = (_predict(pike, _headed(straight, yaw), *C).velocity for yaw in (0.3, 0.3 + np.pi))
    np.testing.assert_allclose(there + back, 2.0 * still, rtol=0.0, atol=1e-13)
    assert np.max(np.abs(there - back)) > 0.1


def test_the_heading_is_the_measured_one_at_the_first_sample_and_the_simulated_one_after_it(
    pike: Fish, turning: Trial
) -> None:
    """Also where recording began late in the run. Catches a heading counted from the start of the drive."""
    late = replace(turning, time=turning.time[120:], velocity=turning.velocity[120:])
    headed = _headed(late, 0.4, drift=5.0)
    still = Model(pike).predict(late, Model(pike).values())
    yaw = still.rollout.at(late.time)[:, 5]
    assert abs(yaw[0]) > 0.2
    drift = _in_world(_predict(pike, headed, *C).velocity - still.velocity, yaw - yaw[0] + 0.4)
    np.testing.assert_allclose(drift, np.broadcast_to(C, drift.shape), rtol=0.0, atol=1e-13)


@pytest.mark.parametrize("axis", [0, 1])
def test_at_the_start_x_is_ahead_and_y_to_port(pike: Fish, straight: Trial, axis: int) -> None:
    read = _predict(pike, straight, *(0.1 * np.eye(2)[axis])).velocity[0]
    np.testing.assert_allclose(read, 0.1 * np.eye(3)[axis], rtol=0.0, atol=1e-15)


def test_a_current_needs_a_heading_in_the_world(pike: Fish) -> None:
    time = np.linspace(0.0, 1.0, 51)
    measured = Trial(
        "run", None, readonly(time), readonly(np.zeros((51, 3))), joint_angle=readonly(np.zeros((51, pike.joints)))
    )
    effect = find("ambient_current")
    assert "heading was not measured (no yaw column) in run" in effect.not_applicable(Dataset("d", pike, (measured,)))
    known = replace(measured, pose=readonly(np.zeros((51, 3))))
    assert effect.not_applicable(Dataset("d", pike, (known,))) == ""
