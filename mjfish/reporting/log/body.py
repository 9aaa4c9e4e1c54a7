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
    bend = np.concatenate([np.full((len(pose), 1), np.pi), joint_angle], axis=1).cumsum(axis=1)
    axis = np.stack([np.cos(bend), np.sin(bend)], axis=2)  # a link's x axis runs towards the tail
    length = np.array([link.length for link in fish.links])
    place = np.zeros((*bend.shape, 3))
    place[:, 1:, :2] = np.cumsum(length[:-1, None] * axis[:, :-1], axis=1)
    roll, pitch, heave = np.zeros((3, len(pose))) if attitude is None else attitude.T
    head = Rotation.from_euler("ZYX", np.column_stack([pose[:, 2], pitch, roll])).as_quat()
    every = Rotation.from_quat(np.repeat(head, bend.shape[1], axis=0))
    turn = (every * Rotation.from_euler("Z", bend.reshape(-1, 1))).as_quat()
    nose = np.column_stack([pose[:, :2], heave])
    return nose[:, None] + every.apply(place.reshape(-1, 3)).reshape(place.shape), turn.reshape(*bend.shape, 4)
