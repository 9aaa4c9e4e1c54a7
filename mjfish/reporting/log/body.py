"""The body of the fish as solid meshes, one a link, and where the links are over time."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from mjfish.fish import Fish
from mjfish.fish.outline import section_at
from mjfish.mujoco.offscreen import Mesh
from mjfish.numerics.arrays import FloatArray

#: Rings of a link along its length, points of a ring, and rings of the round end in front.
_RINGS = 28
_AROUND = 32
_CAP = 6


def link_mesh(fish: Fish, index: int) -> Mesh:
    """Return the surface of one link in its frame, x towards the tail.

    Elliptic rings along the outline. Behind a joint the link begins with a round end half as long as it is wide, so
    that no wedge opens where the fish bends.
    """
    start = sum(link.length for link in fish.links[:index])
    length = fish.links[index].length
    r = length * (0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, _RINGS)))
    height, width = section_at(fish.sections, start + np.maximum(r, 1e-6))
    if index > 0:
        bow = np.linspace(np.pi / 2, 0.0, _CAP, endpoint=False)
        r = np.concatenate([-0.5 * width[0] * np.sin(bow), r])
        height = np.concatenate([height[0] * np.cos(bow), height])
        width = np.concatenate([width[0] * np.cos(bow), width])
    around = np.linspace(0.0, 2.0 * np.pi, _AROUND, endpoint=False)
    a, b = 0.5 * width[:, None], 0.5 * height[:, None]
    ring = np.stack([np.broadcast_to(r[:, None], (len(r), _AROUND)), a * np.cos(around), b * np.sin(around)], axis=2)
    vertices = np.concatenate([ring.reshape(-1, 3), [[r[0], 0.0, 0.0], [r[-1], 0.0, 0.0]]])
    return Mesh(vertices, _triangles(len(r)))


def _triangles(rings: int) -> NDArray[np.uint32]:
    """Return triangles of a tube of rings, closed at both ends by a fan around the last two vertices."""
    first = np.arange(_AROUND)
    following = (first + 1) % _AROUND
    starts = _AROUND * np.arange(rings - 1)[:, None]
    a, b = starts + first, starts + following
    sides = np.stack([a, b, a + _AROUND, b, b + _AROUND, a + _AROUND], axis=2).reshape(-1, 3)
    last = _AROUND * (rings - 1)
    front = np.stack([np.full(_AROUND, last + _AROUND), following, first], axis=1)
    back = np.stack([np.full(_AROUND, last + _AROUND + 1), last + first, last + following], axis=1)
    return np.concatenate([sides, front, back]).astype(np.uint32)


def normals(mesh: Mesh) -> FloatArray:
    """Return the mean direction (m, 3), by area, of the triangles at each vertex."""
    vertices, triangles = mesh.vertices, mesh.triangles
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    face = np.cross(b - a, c - a)
    total = np.zeros_like(vertices)
    for k in range(3):
        np.add.at(total, triangles[:, k], face)
    size = np.linalg.norm(total, axis=1, keepdims=True)
    return np.asarray(total / np.where(size > 0.0, size, 1.0))


def link_poses(
    fish: Fish, pose: FloatArray, joint_angle: FloatArray, attitude: FloatArray | None = None
) -> tuple[FloatArray, FloatArray]:
    """Return places (n, links, 3) [m] and quaternions x, y, z, w (n, links, 4) of the links' frames in the world.

    Args:
        fish: the fish.
        pose: (n, 3) of the nose in the forward frame.
        joint_angle: (n, joints) [rad].
        attitude: (n, 3) roll, pitch [rad] and heave [m]; None: in the plane.
    """
    if attitude is not None:
        return _in_space(pose, attitude, *link_poses(fish, np.zeros_like(pose), joint_angle))
    bend = np.concatenate([np.zeros((len(pose), 1)), np.cumsum(joint_angle, axis=1)], axis=1)
    heading = pose[:, 2:] + bend + np.pi  # a link's x axis runs towards the tail
    axis = np.stack([np.cos(heading), np.sin(heading)], axis=2)
    length = np.array([link.length for link in fish.links])
    reach = np.cumsum(length[:-1, None] * axis[:, :-1], axis=1)
    place = np.zeros((len(pose), len(length), 3))
    place[..., :2] = pose[:, None, :2]
    place[:, 1:, :2] += reach
    turn = np.zeros((len(pose), len(length), 4))
    turn[..., 2], turn[..., 3] = np.sin(0.5 * heading), np.cos(0.5 * heading)
    return place, turn


def _in_space(
    pose: FloatArray, attitude: FloatArray, place: FloatArray, turn: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return places and quaternions in the world of those in the frame of the head: yaw, then pitch, then roll."""
    head = Rotation.from_euler("ZYX", np.column_stack([pose[:, 2], attitude[:, 1], attitude[:, 0]]))
    nose = np.column_stack([pose[:, :2], attitude[:, 2]])
    every = Rotation.from_quat(np.repeat(head.as_quat(), place.shape[1], axis=0))
    turned = (every * Rotation.from_quat(turn.reshape(-1, 4))).as_quat()
    return nose[:, None] + every.apply(place.reshape(-1, 3)).reshape(place.shape), turned.reshape(turn.shape)
