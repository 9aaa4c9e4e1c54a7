"""What is drawn of a run, on plain arrays: bodies, paths and arrows, for the viewer's log and for pictures alike."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from mjfish.fish import Fish
from mjfish.fish.outline import section_at
from mjfish.mujoco.offscreen import Colour, Mesh
from mjfish.numerics.arrays import FloatArray
from mjfish.reporting.log.scene import Run, Swim, Swimmer

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
    r = fish.links[index].length * (0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, _RINGS)))
    height, width = section_at(fish.sections, start + np.maximum(r, 1e-6))
    if index > 0:
        bow = np.linspace(np.pi / 2, 0.0, _CAP, endpoint=False)
        r = np.concatenate([-0.5 * width[0] * np.sin(bow), r])
        height, width = (np.concatenate([size[0] * np.cos(bow), size]) for size in (height, width))
    around = np.linspace(0.0, 2.0 * np.pi, _AROUND, endpoint=False)
    a, b = 0.5 * width[:, None], 0.5 * height[:, None]
    ring = np.stack([np.broadcast_to(r[:, None], (len(r), _AROUND)), a * np.cos(around), b * np.sin(around)], axis=2)
    vertices = np.concatenate([ring.reshape(-1, 3), [[r[0], 0.0, 0.0], [r[-1], 0.0, 0.0]]])
    return Mesh(vertices, _triangles(len(r)))


def _triangles(rings: int) -> NDArray[np.uint32]:
    """Return triangles of a tube of rings, closed at both ends by a fan around the last two vertices."""
    a = np.arange(_AROUND * rings).reshape(rings, _AROUND)
    b = np.roll(a, -1, axis=1)  # the next vertex of the ring
    sides = np.stack([a[:-1], b[:-1], a[1:], b[:-1], b[1:], a[1:]], axis=2).reshape(-1, 3)
    front = np.stack([np.full(_AROUND, a.size), b[0], a[0]], axis=1)
    back = np.stack([np.full(_AROUND, a.size + 1), a[-1], b[-1]], axis=1)
    return np.concatenate([sides, front, back]).astype(np.uint32)


def normals(mesh: Mesh) -> FloatArray:
    """Return the mean direction (m, 3), by area, of the triangles at each vertex."""
    a, b, c = np.moveaxis(mesh.vertices[mesh.triangles], 1, 0)
    face = np.cross(b - a, c - a)
    total = np.zeros_like(mesh.vertices)
    for corner in mesh.triangles.T:
        np.add.at(total, corner, face)
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
    turn = (every * Rotation.from_euler("Z", bend.reshape(-1, 1))).as_quat().reshape(*bend.shape, 4)
    return np.column_stack([pose[:, :2], heave])[:, None] + every.apply(place.reshape(-1, 3)).reshape(place.shape), turn


#: Red, green, blue, alpha of each swimmer, bodies and curves alike.
COLOURS: dict[str, Colour] = {
    "measured": (205, 208, 214, 255),
    "nominal": (229, 138, 60, 150),
    "extended": (46, 168, 178, 200),
    "simulated": (46, 168, 178, 200),
}
#: Opacity of a body whose joints nobody measured: those of the command are drawn.
GHOST = 140
#: Kinds of force, as they are called in the log and in `mjfish.ode.forces.LinkForces`.
FORCES: dict[str, Colour] = {
    "drag": (232, 84, 100, 255),
    "added_mass": (136, 150, 255, 255),
    "load": (226, 204, 70, 255),
}
#: At three instants of four no arrow is longer than this share of the fish.
_REACH = 0.5
#: The camera's point ignores what is faster than this [s], so that it does not wag with the fish.
_SMOOTHING = 0.3
#: Of the floor below the lowest nose, in lengths of the fish.
_DEPTH = 0.25


@dataclass(frozen=True, eq=False)
class Figure:
    """One fish as it is drawn; n samples.

    Attributes:
        swimmer: who it is.
        words: what it is, for a legend.
        ghost: whether its joints are those of the command, because nobody measured them.
        time: (n,) increasing [s].
        path: (n, 3) of the nose [m].
        meshes: one a link.
        place: (n, links, 3) of the links' frames [m].
        turn: (n, links, 4) quaternions x, y, z, w of them.
        arrows: by kind of force, where each begins (n, links, 3) and how far it reaches (n, links, 3) [m].
        error: of the velocity, see `Run.error`; None where there is nothing to compare it with.
    """

    swimmer: Swimmer
    words: str
    ghost: bool
    time: FloatArray
    path: FloatArray
    meshes: tuple[Mesh, ...]
    place: FloatArray
    turn: FloatArray
    arrows: Mapping[str, tuple[FloatArray, FloatArray]]
    error: float | None = None

    @property
    def colour(self) -> Colour:
        """Colour of the body."""
        red, green, blue, alpha = COLOURS[self.swimmer]
        return red, green, blue, GHOST if self.ghost else alpha

    def middle(self) -> FloatArray:
        """Return the middle of the body (n, 3) [m]."""
        return np.asarray(self.place.mean(axis=1))

    def at(self, time: FloatArray) -> Figure:
        """Return the figure at other times (m,), linear between its samples and at rest beyond them."""
        index = np.clip(np.searchsorted(self.time, time, side="right") - 1, 0, max(len(self.time) - 2, 0))
        following = np.minimum(index + 1, len(self.time) - 1)
        width = np.maximum(self.time[following] - self.time[index], 1e-12)
        share = np.clip((time - self.time[index]) / width, 0.0, 1.0)

        def between(values: FloatArray) -> FloatArray:
            s = share.reshape(-1, *([1] * (values.ndim - 1)))
            return np.asarray((1.0 - s) * values[index] + s * values[following])

        turn = between(_continuous(self.turn))
        return replace(
            self,
            time=time,
            path=between(self.path),
            place=between(self.place),
            turn=turn / np.maximum(np.linalg.norm(turn, axis=2, keepdims=True), 1e-12),
            arrows={kind: (between(begin), between(reach)) for kind, (begin, reach) in self.arrows.items()},
        )

    def moved(self, turn: float, origin: FloatArray, to: FloatArray) -> Figure:
        """Return the figure turned about the vertical by `turn` [rad], and `origin` (3,) moved to `to` (3,)."""
        turned = Rotation.from_rotvec([0.0, 0.0, turn])

        def shifted(points: FloatArray) -> FloatArray:
            return np.asarray(turned.apply((points - origin).reshape(-1, 3)).reshape(points.shape) + to)

        turns = (turned * Rotation.from_quat(self.turn.reshape(-1, 4))).as_quat().reshape(self.turn.shape)
        arrows = {
            kind: (shifted(begin), turned.apply(reach.reshape(-1, 3)).reshape(reach.shape))
            for kind, (begin, reach) in self.arrows.items()
        }
        return replace(self, path=shifted(self.path), place=shifted(self.place), turn=turns, arrows=arrows)

    def onto(self, other: Figure, time: float) -> Figure:
        """Return the figure with the nose and the heading of another at a time [s]."""
        own, there = (figure.at(np.array([time])) for figure in (self, other))
        return self.moved(float(there.heading()[0] - own.heading()[0]), own.path[0], there.path[0])

    def heading(self) -> FloatArray:
        """Return the heading of the head (n,) [rad], x towards y."""
        return np.unwrap(2.0 * np.arctan2(self.turn[:, 0, 2], self.turn[:, 0, 3]) - np.pi)


@dataclass(frozen=True, eq=False)
class Drawing:
    """One run as it is drawn.

    Attributes:
        name: of the trial or the drive.
        source: of the dataset or the fish.
        held_out: whether nothing was fitted to it; None for a simulation.
        length: of the fish [m].
        figures: one a swimmer, the measured one first if there is one.
        scale: length of an arrow of 1 N [m/N].
    """

    name: str
    source: str
    held_out: bool | None
    length: float
    figures: tuple[Figure, ...]
    scale: float


def drawn(run: Run, scale: float, source: str = "") -> Drawing:
    """Return a run as it is drawn, its arrows at a scale [m/N]."""
    meshes = tuple(link_mesh(run.fish, k) for k in range(len(run.fish.links)))
    figures = tuple(_figure(run, swim, meshes, scale) for swim in run.swims)
    compared = any(swim.swimmer == "measured" for swim in run.swims)
    return Drawing(run.name, source, run.held_out if compared else None, run.fish.length, figures, scale)


def _figure(run: Run, swim: Swim, meshes: tuple[Mesh, ...], scale: float) -> Figure:
    place, turn = link_poses(run.fish, swim.pose, swim.joint_angle, swim.attitude)
    arrows: dict[str, tuple[FloatArray, FloatArray]] = {}
    if (forces := swim.forces) is not None:
        for kind in FORCES:
            wrench: FloatArray = getattr(forces, kind)
            if np.any(wrench):
                origins, vectors = np.zeros((2, *place.shape))
                origins[..., :2] = forces.point(wrench)
                vectors[..., :2] = scale * wrench[..., :2]
                arrows[kind] = origins, vectors
    words, error = swim.words or swim.swimmer, run.error(swim.swimmer)
    return Figure(swim.swimmer, words, swim.ghost, swim.time, swim.nose, meshes, place, turn, arrows, error)


def _continuous(turn: FloatArray) -> FloatArray:
    """Return quaternions (n, links, 4) whose sign does not jump over time."""
    if len(turn) < 2:
        return turn
    flips = np.where(np.einsum("nlk,nlk->nl", turn[1:], turn[:-1]) < 0.0, -1.0, 1.0)
    return np.asarray(turn * np.concatenate([np.ones_like(flips[:1]), np.cumprod(flips, axis=0)])[..., None])


def arrow_scale(runs: Sequence[Run]) -> float:
    """Return the length of an arrow of 1 N [m/N], one for all runs, rounded to one digit."""
    forces = [swim.forces for run in runs for swim in run.swims if swim.forces is not None]
    every = (np.stack([getattr(own, kind) for kind in FORCES]) for own in forces)
    largest = [np.linalg.norm(own[..., :2], axis=3).max(axis=(0, 2)) for own in every]
    typical = float(np.quantile(np.concatenate([np.zeros(1), *largest]), 0.75))
    return float(f"{_REACH * runs[-1].fish.length / typical:.0e}") if typical > 0.0 else 1.0


def camera_path(figures: Sequence[Figure], time: FloatArray) -> FloatArray:
    """Return the point that the camera looks at (n, 3) [m]: the middle of all bodies, their wagging smoothed away.

    Args:
        figures: that are kept in view.
        time: (n,) increasing [s].
    """
    middle = np.mean([figure.at(time).middle() for figure in figures], axis=0)
    if len(time) < 2:
        return np.asarray(middle)
    step = float(np.median(np.diff(time)))
    return np.asarray(gaussian_filter1d(middle, _SMOOTHING / step, axis=0, mode="nearest"))


def reach(figures: Sequence[Figure], path: FloatArray, time: FloatArray) -> float:
    """Return how far from the camera's point (n, 3) at times (n,) any nose or joint is, at most [m]."""
    points = (np.concatenate([own.path[:, None], own.place], axis=1) for own in (f.at(time) for f in figures))
    return max(float(np.linalg.norm(own - path[:, None], axis=2).max()) for own in points)


def beat_paths(figure: Figure, measured: Figure, starts: FloatArray) -> list[FloatArray]:
    """Return the path of a nose in pieces (k, 3) [m], each begun with the measured nose and heading at a start."""
    pieces = []
    for start, end in itertools.pairwise([*starts, np.inf]):
        within = (figure.time >= start - 1e-9) & (figure.time <= end + 1e-9)
        if np.count_nonzero(within) > 1:
            pieces.append(figure.onto(measured, float(start)).path[within])
    return pieces


def floor_height(figures: Sequence[Figure], length: float) -> float:
    """Return the height of the floor [m], below everything that swims."""
    return min(float(figure.path[:, 2].min()) for figure in figures) - _DEPTH * length
