"""The log of a fish that is free in space shows it where MuJoCo has it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from logs import column, entities
from scipy.spatial.transform import Rotation

from mjfish.fish import Fish
from mjfish.mujoco import Trim, mjcf
from mjfish.reporting.log import write_log
from mjfish.reporting.log.drawing import camera_path, drawn, link_poses
from mjfish.reporting.log.recording import floor_lines
from mjfish.reporting.log.scene import Run, Swim
from mjfish.simulation import simulate


def test_links_in_space_are_where_mujoco_has_them(pike: Fish) -> None:
    """Catches another order of the angles, or a roll of the wrong sense."""
    random = np.random.default_rng(5)
    pose, attitude = random.uniform(-1.0, 1.0, (6, 3)), random.uniform(-1.0, 1.0, (6, 3))
    angle = random.uniform(-0.6, 0.6, (6, pike.joints))
    place, turn = link_poses(pike, pose, angle, attitude)
    model = mjcf.spec(pike, Trim()).compile()
    data = mujoco.MjData(model)
    backwards = Rotation.from_rotvec([0.0, 0.0, np.pi])  # a link's x axis runs towards the tail
    for k in range(len(pose)):
        head = Rotation.from_euler("ZYX", [pose[k, 2], attitude[k, 1], attitude[k, 0]])
        data.qpos[:] = [*pose[k, :2], attitude[k, 2], *head.as_quat(scalar_first=True), *angle[k]]
        mujoco.mj_kinematics(model, data)
        np.testing.assert_allclose(place[k], data.xpos[1:], rtol=0, atol=1e-12)
        there = Rotation.from_quat(data.xquat[1:], scalar_first=True) * backwards
        np.testing.assert_allclose((Rotation.from_quat(turn[k]).inv() * there).magnitude(), 0.0, atol=1e-7)


def test_without_attitude_a_fish_is_where_one_that_lies_level_is(pike: Fish) -> None:
    random = np.random.default_rng(6)
    pose, angle = random.uniform(-1.0, 1.0, (4, 3)), random.uniform(-0.6, 0.6, (4, pike.joints))
    plane, space = link_poses(pike, pose, angle), link_poses(pike, pose, angle, np.zeros((4, 3)))
    np.testing.assert_allclose(space[0], plane[0], rtol=0, atol=1e-12)
    np.testing.assert_allclose(np.abs(np.sum(space[1] * plane[1], axis=2)), 1.0, rtol=0, atol=1e-12)


def test_camera_and_floor_follow_a_fish_that_sinks(pike: Fish) -> None:
    time = np.linspace(0.0, 5.0, 101)
    attitude = np.column_stack([np.zeros((101, 2)), -time])
    swim = Swim("simulated", time, np.zeros((101, 3)), np.zeros((101, 3)), np.zeros((101, 4)), attitude=attitude)
    drawing = drawn(Run("run", pike, (swim,)), 1.0)
    assert camera_path(drawing.figures, time)[50, 2] == pytest.approx(-time[50], abs=1e-3)
    assert max(line[0, 2] for line in floor_lines(drawing)) < -5.0


def test_log_shows_roll_pitch_and_heave_and_no_planar_forces(pike: Fish, tmp_path: Path) -> None:
    time = np.arange(20) / 100.0
    attitude = np.column_stack([0.1 * time, 0.2 * time, -0.3 * time])
    plane = simulate(pike, duration=0.19)
    write_log(replace(plane, attitude=attitude), tmp_path / "a.rrd")
    for k, name in enumerate(("roll", "pitch", "heave")):
        at, values = column(tmp_path / "a.rrd", f"/v1/attitude/{name}/simulated", "Scalars:scalars")
        np.testing.assert_allclose(values.ravel(), np.interp(at, time, attitude[:, k]), rtol=0, atol=1e-9)
    assert not any("force" in entity for entity in entities(tmp_path / "a.rrd"))
    write_log(plane, tmp_path / "b.rrd")
    assert not any("attitude" in entity for entity in entities(tmp_path / "b.rrd"))
