"""Films and stills of swimming fish, drawn by MuJoCo without a window.

In reading order: what of a run is shown and where the fish begin; the camera and the stage; the words over a picture;
what is written.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

import imageio.v2 as imageio
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont
from scipy.spatial.transform import Rotation

from mjfish.files import writing
from mjfish.mujoco.offscreen import FIELD, Stage, Strokes
from mjfish.numerics.arrays import FloatArray
from mjfish.numerics.formats import percent
from mjfish.reporting.log.drawing import COLOURS, FORCES, Drawing, Figure, camera_path, floor_height

#: Beats of a stretch that is shown slowly, and of one whose instants stand beside each other.
BEATS, BEATS_OF_STILL = 8, 14
#: A beat is slowed so far that it lasts this long [s].
_BEAT_LASTS = 0.7
#: Frequencies that count as beats [Hz].
_SLOWEST = 0.2


@dataclass(frozen=True, eq=False)
class Stretch:
    """A stretch of a run.

    Attributes:
        drawing: the run, its fish moved to where they begin.
        start, end: of the stretch [s].
        slowdown: how many times slower than it was swum it is shown.
        anchored: whether simulated fish were moved onto the measured one at the start.
    """

    drawing: Drawing
    start: float
    end: float
    slowdown: int = 1
    anchored: bool = False


def whole(drawing: Drawing) -> Stretch:
    """Return all of a run, as fast as it was swum; simulated fish begin where the measured one does."""
    return _anchored(drawing, *_ends(drawing), 1)


def steady(drawing: Drawing, count: int = BEATS) -> Stretch:
    """Return so many last beats of a run, slowed."""
    beat, (first, end) = beats(drawing), _ends(drawing)
    return _anchored(drawing, max(first, end - count * beat), end, _slowdown(beat))


def worst(drawing: Drawing, count: int = BEATS) -> Stretch:
    """Return so many beats over which the nominal fish goes furthest from the measured one, slowed.

    At the start of these the simulated fish are moved onto the measured one, place and heading: what is seen then is
    what goes wrong within them, not what has added up before.
    """
    beat, (first, last) = beats(drawing), _ends(drawing)
    starts = np.arange(first, max(last - count * beat, first) + 1e-9, max(beat, 0.1))
    choices = [_anchored(drawing, start, min(start + count * beat, last), _slowdown(beat)) for start in starts]
    return max(choices, key=_error)


def beats(drawing: Drawing) -> float:
    """Return the time of one beat [s]: the strongest frequency of the angle between tail and head."""
    figure = drawing.figures[0]
    step = float(np.median(np.diff(figure.time)))
    even = figure.at(np.arange(figure.time[0], figure.time[-1], step))
    bend = np.unwrap(2.0 * np.arctan2(even.turn[:, -1, 2], even.turn[:, -1, 3])) - even.heading()
    power = np.abs(np.fft.rfft((bend - bend.mean()) * np.hanning(len(bend)), n=8 * len(bend))) ** 2
    frequency = np.fft.rfftfreq(8 * len(bend), step)
    power[frequency < _SLOWEST] = 0.0
    return float(1.0 / frequency[np.argmax(power)]) if power.max() > 0.0 else 1.0


def _slowdown(beat: float) -> int:
    return max(1, round(_BEAT_LASTS / beat))


def _ends(drawing: Drawing) -> tuple[float, float]:
    """Return the times between which there is every fish [s], or nearly: one that diverged ends earlier."""
    return float(drawing.figures[0].time[0]), max(float(figure.time[-1]) for figure in drawing.figures)


def _anchored(drawing: Drawing, start: float, end: float, slowdown: int) -> Stretch:
    first, *others = drawing.figures
    if first.swimmer != "measured":
        return Stretch(drawing, start, end, slowdown)
    moved = replace(drawing, figures=(first, *(figure.onto(first, start) for figure in others)))
    return Stretch(moved, start, end, slowdown, anchored=len(others) > 0)


def _error(stretch: Stretch) -> float:
    """Return how far the nominal nose is from the measured one at the end [m]; 0 where one of them is absent."""
    ends = [figure.at(np.array([stretch.end])) for figure in stretch.drawing.figures]
    noses = [figure.path[0] for figure in ends if figure.swimmer in ("measured", "nominal")]
    return float(np.linalg.norm(noses[1] - noses[0])) if len(noses) == 2 else 0.0


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
    steps = np.diff(camera_path(stretch.drawing.figures[:1], times), axis=0)
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(steps, axis=1))])
    apart = _APART * stretch.drawing.length
    count = min(int(way[-1] / apart) + 1, _INSTANTS)
    return np.asarray(np.interp(apart * np.arange(count), way, times) if count > 1 else times[[0, -1]])


def _azimuth(figures: Sequence[Figure]) -> float:
    """Return the direction of the camera [deg]: across the way, so that the fish swim from left to right."""
    start, end = (np.mean([figure.path[k] for figure in figures], axis=0) for k in (0, -1))
    way = end - start
    near = np.linalg.norm(way) < 0.05
    heading = float(np.mean([figure.heading()[0] for figure in figures])) if near else math.atan2(way[1], way[0])
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
    colour = (*COLOURS[figure.swimmer][:3], 200)
    return [Strokes(points[:-1], points[1:], 0.5 * _PATH * length, colour)] if len(points) > 1 else []


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


Colour = tuple[int, int, int]
Item = TypeVar("Item")
#: Height of the letters, in heights of the picture, and of the smallest that can be read [pixels].
_LETTERS, _SMALLEST = 0.032, 13
_INK, _MUTED, _SHADE = (240, 243, 246), (190, 203, 212), (10, 20, 28, 165)
_FORCE_NAMES = {"drag": "drag", "added_mass": "added mass", "load": "added by the cause"}


@dataclass(frozen=True)
class Caption:
    """The words over the pictures of a stretch.

    Attributes:
        title: whose run it is.
        legend: colour and words of every fish, then of every force.
        notes: how it is shown.
    """

    title: str
    legend: tuple[tuple[Colour, str], ...]
    notes: tuple[str, ...]


def caption_of(stretch: Stretch, instants: Sequence[float] | None = None) -> Caption:
    """Return the words of a stretch; of a still, with its instants [s]."""
    drawing = stretch.drawing
    part = {None: "", True: ", held-out run", False: ", fitted run"}[drawing.held_out]
    title = f"{drawing.source}{part or ','} {drawing.name}" if drawing.source else drawing.name
    legend = []
    for figure in drawing.figures:
        ghost = " (joints as commanded)" if figure.ghost else ""
        error = "" if figure.error is None else f", error {percent(figure.error, 2)}".replace("\N{NO-BREAK SPACE}", " ")
        legend.append((COLOURS[figure.swimmer][:3], f"{figure.words}{ghost}{error}"))
    kinds = [kind for kind in FORCES if any(kind in figure.arrows for figure in drawing.figures)]
    legend += [(FORCES[kind][:3], f"force: {_FORCE_NAMES[kind]}") for kind in kinds]
    pace = f"{stretch.slowdown} times slower than swum" if stretch.slowdown > 1 else "as fast as swum"
    shown = [f"{stretch.start:.1f} to {stretch.end:.1f} s, {pace}"]
    if instants is not None:
        shown = [f"at {', '.join(f'{time:.2f}' for time in instants)} s"]
    if stretch.anchored:
        shown.append(f"all begin at one place at {stretch.start:.1f} s")
    if kinds:
        bearer = next(figure.words for figure in drawing.figures if figure.arrows)
        on = f" on the fish {bearer}" if len(drawing.figures) > 1 else ""
        shown.append(f"forces{on}, 1 N is {100.0 * drawing.scale:.3g} cm")
        if _cut(stretch):
            shown.append(f"cut at {100.0 * LONG * drawing.length:.0f} cm")
    return Caption(title, tuple(legend), tuple(shown))


def _cut(stretch: Stretch) -> bool:
    """Return whether an arrow is longer than what is drawn of it."""
    arrows = ((figure.time, vectors) for figure in stretch.drawing.figures for _, vectors in figure.arrows.values())
    within = (vectors[(time >= stretch.start) & (time <= stretch.end)] for time, vectors in arrows)
    return any(np.any(np.linalg.norm(vectors, axis=2) > LONG * stretch.drawing.length) for vectors in within)


def captioned(picture: NDArray[np.uint8], caption: Caption, time: float | None = None) -> Image.Image:
    """Return a picture (height, width, 3) with its caption, and the time [s] if there is one."""
    image = Image.fromarray(picture).convert("RGB")
    draw = ImageDraw.Draw(image, "RGBA")
    size = max(_SMALLEST, round(_LETTERS * image.height))
    font, small = ImageFont.load_default(size), ImageFont.load_default(max(_SMALLEST, round(0.85 * size)))
    margin, width, gap = size, image.width - 2 * size, 1.4 * size

    def wide(entry: tuple[Colour, str]) -> float:
        return size + draw.textlength(entry[1], font=small)

    lines = _lines(caption.legend, lambda line: sum(map(wide, line)) + gap * (len(line) - 1), width)
    draw.rectangle((0, 0, image.width, margin + round(1.5 * size) * (1 + len(lines))), fill=_SHADE)
    draw.text((margin, 0.6 * margin), caption.title, font=font, fill=_INK)
    if time is not None:
        draw.text((image.width - margin, 0.6 * margin), f"{time:.2f} s", font=font, fill=_INK, anchor="ra")
    y = 0.6 * margin + 1.6 * size
    for line in lines:
        x = 0.0
        for entry in line:
            draw.ellipse((margin + x, y + 0.12 * size, margin + x + 0.7 * size, y + 0.82 * size), fill=entry[0])
            draw.text((margin + x + size, y), entry[1], font=small, fill=_INK)
            x += wide(entry) + gap
        y += 1.5 * size
    notes = _lines(caption.notes, lambda line: draw.textlength("; ".join(line), font=small), width)
    top = image.height - round(1.35 * size * len(notes) + 0.6 * size)
    draw.rectangle((0, top, image.width, image.height), fill=_SHADE)
    for k, note in enumerate(notes):
        draw.text((margin, top + 0.35 * size + 1.35 * size * k), "; ".join(note), font=small, fill=_MUTED)
    return image


def _lines(items: Sequence[Item], length: Callable[[Sequence[Item]], float], width: float) -> list[list[Item]]:
    """Return the items in lines that are not longer than the width, one item a line at least."""
    lines: list[list[Item]] = []
    for item in items:
        if lines and length([*lines[-1], item]) <= width:
            lines[-1].append(item)
        else:
            lines.append([item])
    return lines


SUFFIXES = (".mp4", ".gif", ".png")
#: Pictures a second; those of a GIF last whole hundredths of a second.
_RATES = {".mp4": 30.0, ".gif": 20.0}
_SIZES = {".mp4": (1280, 720), ".gif": (720, 406), ".png": (1600, 560)}
#: Colours of a GIF.
_PALETTE = 256


def write(path: Path, stretch: Stretch, progress: Callable[[str, float], None] = lambda _what, _done: None) -> None:
    """Write a film or a still, by the suffix of `path`, whole or not at all.

    Args:
        path: ends in .mp4, .gif or .png; a file that is there is replaced.
        stretch: that is shown.
        progress: told what is done and the share that is.

    Raises:
        InputError: another suffix, the file cannot be written, or this machine cannot draw.
    """
    writing.check_suffix(path, *SUFFIXES)
    with writing.whole(path) as partial:
        if path.suffix.lower() == ".png":
            progress("drawing", 0.0)
            instants, picture = still(stretch, _SIZES[".png"])
            captioned(picture, caption_of(stretch, instants.tolist())).save(partial, optimize=True)
        else:
            _film(partial, stretch, progress)


def _film(path: Path, stretch: Stretch, progress: Callable[[str, float], None]) -> None:
    suffix, caption = path.suffix.lower(), caption_of(stretch)

    def pictures() -> Iterator[Image.Image]:
        for time, picture in frames(stretch, _SIZES[suffix], _RATES[suffix]):
            progress("drawing", (time - stretch.start) / (stretch.end - stretch.start))
            yield captioned(picture, caption, time)

    if suffix == ".gif":
        first, *others = (
            image.quantize(_PALETTE, Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE) for image in pictures()
        )
        duration = round(1000.0 / _RATES[suffix])
        first.save(path, save_all=True, append_images=others, duration=duration, loop=0, optimize=False)
        return
    opened: Any = imageio.get_writer(path, fps=_RATES[suffix], codec="libx264", quality=7, macro_block_size=2)
    with opened as writer:
        for image in pictures():
            writer.append_data(np.asarray(image))
