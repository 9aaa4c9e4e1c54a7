"""Generated poses: what a camera sees of the same swimming, and what is written of the joints."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import mjfish
from mjfish.data import save
from mjfish.data.sensor import third_differences
from mjfish.errors import InputError


def test_poses_are_those_of_the_same_swimming() -> None:
    """Differentiated and turned by the heading they are its velocities; catches another fish, frame or clock."""
    start = [(0.2, -0.1, 0.7)]
    moving = mjfish.generate("pike", ["v1"], duration=4.0, rate=200.0, places=start).trials[0]
    seen = mjfish.generate("pike", ["v1"], duration=4.0, rate=200.0, places=start, observe="pose").trials[0]
    position, heading = seen.sensors
    assert not seen.measured.any()
    np.testing.assert_allclose(position.values, moving.pose[:, :2], atol=1e-12)
    rate, turn = (CubicSpline(one.time, one.values)(one.time, 1) for one in (position, heading))
    yaw = heading.values[:, 0]
    surge = np.cos(yaw) * rate[:, 0] + np.sin(yaw) * rate[:, 1]
    inner = slice(5, -5)
    np.testing.assert_allclose(surge[inner], moving.velocity[inner, 0], atol=1e-4)
    np.testing.assert_allclose(turn[inner, 0], moving.velocity[inner, 2], atol=1e-3)


def test_the_noise_of_poses_has_its_size() -> None:
    seen = mjfish.generate("pike", ["v1"], noise=(1e-3, 2e-3, 0.01), rate=100.0, observe="pose").trials[0]
    found = [np.sqrt(np.mean(third_differences(sensor) ** 2, axis=0)) for sensor in seen.sensors]
    np.testing.assert_allclose(np.concatenate(found), [1e-3, 2e-3, 0.01], rtol=0.1)
    assert all(sensor.sigma is None for sensor in seen.sensors)


@pytest.mark.parametrize("joints", ["measured", "commanded"])
def test_joints_are_recorded_before_or_behind_the_servos(joints: str) -> None:
    lag = {"servo_lag.time_constant": 0.05}
    asked = mjfish.generate("pike", ["v1"], duration=4.0, observe="pose", joints="commanded").trials[0]
    found = mjfish.generate("pike", ["v1"], values=lag, duration=4.0, observe="pose", joints=joints).trials[0]
    assert found.drive == ()
    assert found.from_rest
    assert found.commanded is (joints == "commanded")
    off = np.abs(found.joint_angle - asked.joint_angle).max()
    assert bool(off > 0.05) is (joints == "measured")


def test_generated_poses_come_back_from_a_file(tmp_path) -> None:
    pool = mjfish.generate("pike", ["v1"], duration=3.0, noise=(1e-3, 1e-3, 0.01), observe="pose", joints="measured")
    save(pool, tmp_path / "pool")
    (again,) = mjfish.load_dataset(tmp_path / "pool").trials
    assert again.from_rest
    np.testing.assert_array_equal(again.joint_angle, pool.trials[0].joint_angle)
    for sensor, own in zip(again.sensors, pool.trials[0].sensors, strict=True):
        np.testing.assert_array_equal(sensor.values, own.values)


def test_one_number_of_noise_is_not_enough() -> None:
    with pytest.raises(InputError, match="expected three numbers"):
        mjfish.generate("pike", ["v1"], noise=(1e-3,), observe="pose")
