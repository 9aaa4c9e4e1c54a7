"""Bodies, paths and the camera of a log, on plain arrays."""

from __future__ import annotations

import numpy as np
import pytest

from mjfish.drive.motion import JointMotion
from mjfish.fish import Fish
from mjfish.fish.outline import section_at
from mjfish.ode.forces import link_forces
from mjfish.reporting.log.drawing import arrow_scale, camera_path, drawn, link_mesh, link_poses, normals
from mjfish.reporting.log.recording import floor_lines
from mjfish.reporting.log.scene import Run, Swim, placed, travelled


@pytest.mark.parametrize("index", range(5))
def test_the_mesh_of_a_link_is_closed_faces_outwards_and_holds_the_volume_of_its_outline(
    pike: Fish, index: int
) -> None:
    """By the divergence theorem; a hole, or faces turned inwards, spoil the volume."""
    mesh = link_mesh(pike, index)
    vertices, triangles, outward = mesh.vertices, mesh.triangles, normals(mesh)
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    volume = np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0
    start = sum(link.length for link in pike.links[:index])
    station = start + np.linspace(1e-9, pike.links[index].length, 4001)
    height, width = section_at(pike.sections, station)
    expected = np.trapezoid(np.pi / 4.0 * height * width, station)
    if index > 0:
        expected += np.pi / 12.0 * width[0] ** 2 * height[0]  # half an ellipsoid in front of the joint
    assert volume == pytest.approx(expected, rel=0.04)
    edges = np.sort(np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]), axis=1)
    assert np.all(np.unique(edges, axis=0, return_counts=True)[1] == 2)
    outwards = np.einsum("ij,ij->i", outward[:, 1:], vertices[:, 1:])
    assert np.mean(outwards >= -1e-12) == 1.0


def test_links_are_where_the_forces_act(pike: Fish) -> None:
    rng = np.random.default_rng(3)
    angle = rng.uniform(-0.6, 0.6, (4, 3, pike.joints))
    motion = JointMotion(np.arange(5.0), angle, np.zeros_like(angle), np.zeros_like(angle))
    pose = rng.uniform(-1.0, 1.0, (4, 3))
    forces = link_forces(pike, motion, np.column_stack([np.zeros((4, 3)), pose]))
    place, turn = link_poses(pike, pose, angle[:, 0])
    np.testing.assert_allclose(place[..., :2], forces.joint, atol=1e-12)
    z, w = turn[..., 2], turn[..., 3]
    axis = np.stack([1.0 - 2.0 * z**2, 2.0 * z * w], axis=2)  # the x axis turned by the quaternion
    np.testing.assert_allclose(axis, forces.axis, atol=1e-12)


def test_a_stretched_fish_at_the_origin_lies_behind_its_nose(pike: Fish) -> None:
    place, _ = link_poses(pike, np.zeros((1, 3)), np.zeros((1, pike.joints)))
    np.testing.assert_allclose(place[0, :, 0], [0.0, *-np.cumsum([link.length for link in pike.links[:-1]])])


def test_steady_surge_and_yaw_rate_make_a_circle_to_port() -> None:
    time = np.linspace(0.0, 2.0 * np.pi, 2001)
    velocity = np.tile([0.5, 0.0, 1.0], (len(time), 1))
    pose = travelled(time, velocity, np.array([1.0, 2.0, 0.0]))
    expected = [1.0 + 0.5 * np.sin(time), 2.5 - 0.5 * np.cos(time), time]
    np.testing.assert_allclose(pose.T, expected, atol=1e-6)


def test_forces_move_and_turn_with_the_fish_and_keep_their_moments(pike: Fish) -> None:
    time = np.array([0.0, 1.0, 2.0])
    angle = np.zeros((2, 3, pike.joints))
    state = np.array([[0.3, 0.2, 0.1], [0.5, -0.1, 0.3], [0.4, 0.0, -0.2]])
    seen = link_forces(pike, JointMotion(time, angle, angle, angle), state)
    pose = np.array([[1.0, 2.0, np.pi / 2], [0.0, 0.0, 0.0]])
    at, origin = np.array([1.0, 1.5]), np.zeros((3, 3))
    moved = placed(seen, time, origin, at, pose)
    np.testing.assert_allclose(moved.drag[0, :, 0], -seen.drag[1, :, 1], atol=1e-14)
    np.testing.assert_allclose(moved.drag[0, :, 1], seen.drag[1, :, 0], atol=1e-14)
    np.testing.assert_allclose(moved.drag[..., 2][0], seen.drag[1, :, 2], atol=1e-14)
    np.testing.assert_allclose(moved.joint[0, 2], [1.0, 2.0 + seen.joint[1, 2, 0]], atol=1e-14)
    np.testing.assert_allclose(moved.added_mass[1], 0.5 * (seen.added_mass[1] + seen.added_mass[2]), atol=1e-14)
    origin = np.array([[3.0, -1.0, 0.4], [2.0, 1.0, 2.0], [0.0, 5.0, -1.0]])
    elsewhere = link_forces(pike, JointMotion(time, angle, angle, angle), np.column_stack([state, origin]))
    again = placed(elsewhere, time, origin, at, pose)
    for name in ("joint", "axis", "drag", "added_mass", "load"):
        np.testing.assert_allclose(getattr(again, name), getattr(moved, name), atol=1e-13)


def _swim(pike: Fish, frequency: float) -> Swim:
    time = np.linspace(0.0, 5.0, 251)
    wag = 0.03 * np.sin(2.0 * np.pi * frequency * time)
    pose = np.column_stack([0.4 * time, wag, np.zeros_like(time)])
    return Swim("simulated", time, np.zeros((251, 3)), pose, np.zeros((251, pike.joints)))


def test_the_camera_glides_along_and_does_not_wag(pike: Fish) -> None:
    swim = _swim(pike, 3.0)
    path = camera_path(drawn(Run("a", pike, (swim,)), 1.0).figures, swim.time)
    middle = slice(60, -60)
    assert np.ptp(path[middle, 1]) < 0.02 * np.ptp(swim.pose[middle, 1])
    behind = swim.pose[middle, 0] - path[middle, 0]
    assert np.all((behind > 0.2 * pike.length) & (behind < 0.8 * pike.length))


def test_the_floor_lies_below_everything_that_swims(pike: Fish) -> None:
    swim = _swim(pike, 3.0)
    ends = np.array(floor_lines(drawn(Run("a", pike, (swim,)), 1.0)))
    assert np.all(ends.min(axis=(0, 1))[:2] < swim.pose[:, :2].min(axis=0))
    assert np.all(ends.max(axis=(0, 1))[:2] > swim.pose[:, :2].max(axis=0))
    assert np.all(ends[..., 2] < -max(max(section.height) for section in pike.sections) / 2.0)


def test_arrows_without_any_force_have_a_scale_all_the_same(pike: Fish) -> None:
    assert arrow_scale([Run("a", pike, (_swim(pike, 1.0),))]) == 1.0
