"""The camera and the stage: what of a stretch is in the picture, and pictures of it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from mjfish.mujoco.offscreen import FIELD, Stage, Strokes
from mjfish.numerics.arrays import FloatArray
from mjfish.reporting.film.stretch import Stretch
from mjfish.reporting.log.drawing import COLOURS, FORCES, Drawing, Figure, camera_path, floor_height

#: The camera looks down so steeply [deg]: on a film, and on a still.
_TILT, _STEEP = -52.0, -62.0
#: Room around the fish, in lengths of it: on a film, and on a still.
_ROOM, _LITTLE = 0.45, 0.15
#: Spacing of the floor's lines, in lengths of the fish.
_SPACING = 0.5
#: Width of an arrow and of a path, in lengths of the fish.
_ARROW, _PATH = 0.014, 0.005
#: Arrows shorter than this are left out, and longer ones are cut, in lengths of the fish.
_SHORT, LONG = 0.02, 0.6
#: Points of a path, at most.
_POINTS = 160
#: Instants of a still: so far apart [lengths of the fish], and so many at most.
_APART, _INSTANTS = 1.15, 4


#: Width and height of a picture [pixels].
Size = tuple[int, int]


def frames(stretch: Stretch, size: Size, rate: float) -> Iterator[tuple[float, NDArray[np.uint8]]]:
    """Yield the times [s] and pictures (height, width, 3) of a film.

    The camera glides along with the fish and keeps all of them in view; their paths are drawn behind them.

    Args:
        stretch: that is shown.
        size: of the pictures.
        rate: of the film [pictures a second].
    """
    drawing = stretch.drawing
    count = max(2, round((stretch.end - stretch.start) * stretch.slowdown * rate))
    times = np.linspace(stretch.start, stretch.end, count)
    figures = [figure.at(times) for figure in drawing.figures]
    path = camera_path(figures, times)
    azimuth = _azimuth(figures)
    distance = _distance(figures, path, azimuth, drawing.length, size)
    with _stage(drawing, figures, size, drawing.length) as stage:
        for k, time in enumerate(times):
            strokes = [stroke for figure in figures for stroke in _line(figure, drawing.length, k + 1)]
            strokes += [stroke for figure in figures for stroke in _arrows(figure, k, drawing.length)]
            yield float(time), stage.picture(
                np.concatenate([figure.place[k] for figure in figures]),
                np.concatenate([figure.turn[k] for figure in figures]),
                strokes, target=path[k], distance=distance, azimuth=azimuth, elevation=_TILT,
            )  # fmt: skip


def still(stretch: Stretch, size: Size) -> tuple[FloatArray, NDArray[np.uint8]]:
    """Return instants (m,) [s] of a stretch and all of them in one picture (height, width, 3).

    They are a little more than a length of the fish apart.
    """
    drawing = stretch.drawing
    times = _instants(stretch)
    figures = [figure.at(times) for figure in drawing.figures]
    azimuth = _azimuth(figures)
    every = np.concatenate([p for figure in figures for p in (figure.place.reshape(-1, 3), _tails(figure))])
    right, deep = _axes(azimuth)
    across, up = every @ right, every @ deep
    middle = 0.5 * (across.min() + across.max()) * right + 0.5 * (up.min() + up.max()) * deep
    middle[2] = every[:, 2].mean()
    bent = [figure.at(times[k : k + 1]) for k in range(len(times)) for figure in figures]
    room = 2.0 * _LITTLE * drawing.length
    distance = _fitting(np.ptp(across) + room, np.ptp(up) + 2.0 * room, size, _STEEP)
    swum = np.linspace(times[0], times[-1], _POINTS)
    strokes = [stroke for figure in drawing.figures for stroke in _line(figure.at(swum), drawing.length)]
    strokes += [stroke for figure in bent for stroke in _arrows(figure, 0, drawing.length)]
    with _stage(drawing, bent, size, max(drawing.length, float(np.ptp(across)))) as stage:
        return times, stage.picture(
            np.concatenate([figure.place[0] for figure in bent]),
            np.concatenate([figure.turn[0] for figure in bent]),
            strokes, target=middle, distance=distance, azimuth=azimuth, elevation=_STEEP,
        )  # fmt: skip


def _stage(drawing: Drawing, figures: Sequence[Figure], size: Size, seen: float) -> Stage:
    """Return the stage with these figures, of which so much [m] is seen."""
    return Stage(
        [(mesh, figure.colour) for figure in figures for mesh in figure.meshes],
        width=size[0],
        height=size[1],
        floor=floor_height(figures, drawing.length),
        spacing=_SPACING * drawing.length,
        extent=3.0 * seen,
    )


def _instants(stretch: Stretch) -> FloatArray:
    """Return the times of a still [s], from the start on: so far apart that no two fish cover each other.

    Of a fish that does not get that far, both ends of the stretch.
    """
    times = np.linspace(stretch.start, stretch.end, 2000)
    path = camera_path(stretch.drawing.figures[:1], times)
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    apart = _APART * stretch.drawing.length
    count = min(int(way[-1] / apart) + 1, _INSTANTS)
    if count < 2:
        return np.array([stretch.start, stretch.end])
    return np.asarray(np.interp(apart * np.arange(count), way, times))


def _azimuth(figures: Sequence[Figure]) -> float:
    """Return the direction of the camera [deg]: across the way, so that the fish swim from left to right."""
    start, end = (np.mean([figure.path[k] for figure in figures], axis=0) for k in (0, -1))
    way = end - start
    heading = math.atan2(way[1], way[0])
    if np.linalg.norm(way) < 0.05:
        heading = float(np.mean([figure.heading()[0] for figure in figures]))
    return math.degrees(heading) + 90.0


def _axes(azimuth: float) -> tuple[FloatArray, FloatArray]:
    """Return the directions (3,) to the right and into the depth of the picture, both level."""
    angle = math.radians(azimuth)
    return np.array([math.sin(angle), -math.cos(angle), 0.0]), np.array([math.cos(angle), math.sin(angle), 0.0])


def _tails(figure: Figure) -> FloatArray:
    """Return the tips of the tail (n, 3) [m]."""
    reach = float(figure.meshes[-1].vertices[:, 0].max())
    return np.asarray(figure.place[:, -1] + Rotation.from_quat(figure.turn[:, -1]).apply([reach, 0.0, 0.0]))


def _distance(figures: Sequence[Figure], path: FloatArray, azimuth: float, length: float, size: Size) -> float:
    """Return how far away the camera must be to keep every fish in view at all times [m]."""
    right, deep = _axes(azimuth)
    ends = np.concatenate([p - path for figure in figures for p in (figure.path, _tails(figure))])
    across, deep_ = (2.0 * np.abs(ends @ axis).max() + 2.0 * _ROOM * length for axis in (right, deep))
    return _fitting(across, deep_, size, _TILT)


def _fitting(across: float, deep: float, size: Size, tilt: float) -> float:
    """Return the distance [m] from which a patch of the plane is seen."""
    upright = math.tan(math.radians(0.5 * FIELD))
    level = upright * size[0] / size[1]
    high = deep * abs(math.sin(math.radians(tilt)))
    nearer = 0.5 * deep * math.cos(math.radians(tilt))  # the near edge of the patch is nearer to the camera
    return max(0.5 * across / level, 0.5 * high / upright) + nearer


def _line(figure: Figure, length: float, last: int | None = None) -> list[Strokes]:
    """Return the path of a nose, up to sample `last`."""
    points = figure.path[:last]
    points = points[:: max(1, len(points) // _POINTS)]
    if len(points) < 2:
        return []
    red, green, blue, _ = COLOURS[figure.swimmer]
    return [Strokes(points[:-1], points[1:], 0.5 * _PATH * length, (red, green, blue, 200))]


def _arrows(figure: Figure, k: int, length: float) -> list[Strokes]:
    """Return the arrows on a fish, drawn above its back: inside the body nobody would see them."""
    strokes = []
    back = np.array([mesh.vertices[:, 2].max() for mesh in figure.meshes])
    for kind, (origins, vectors) in figure.arrows.items():
        reach = np.linalg.norm(vectors[k], axis=1)
        seen = reach > _SHORT * length
        if np.any(seen):
            shown = vectors[k][seen] * np.minimum(1.0, LONG * length / reach[seen])[:, None]
            start = origins[k][seen] + back[seen, None] * np.array([0.0, 0.0, 1.0])
            strokes.append(Strokes(start, start + shown, _ARROW * length, FORCES[kind], arrows=True))
    return strokes
