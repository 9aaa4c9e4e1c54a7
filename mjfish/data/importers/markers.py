"""Importer of marker tracks: pixels of markers on the links, seen by a camera from above.

Markers of a mapping are put on the links of a fish (`placed`), a track of them is smoothed (`fit_track`), exchanged
markers are put back, and markers that are not where they belong are left out.

Three lines head the file of DeepLabCut [Mathis2018] of one animal: ``scorer``, ``bodyparts``, ``coords``. Every body
part has the columns x, y [pixels] and likelihood; the first column numbers the frames. A marker of the mapping has the
name of its body part.

[Mathis2018] A. Mathis and others, DeepLabCut: markerless pose estimation of user-defined body parts with deep learning,
Nature Neuroscience 21.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, pairwise, product
from pathlib import Path

import numpy as np
from scipy.ndimage import median_filter

from mjfish.data import Dataset
from mjfish.data.importers.chain import Chain, Marked
from mjfish.data.importers.mapping import LAYOUTS, MarkersMap, read_mapping
from mjfish.data.importers.smoothing import Basis, Fit, beat_frequency, smooth
from mjfish.data.importers.trials import Cut, ImportReport, Run, assembled, record, stretch_names, with_noise
from mjfish.data.tables import read_sheet, recognise
from mjfish.errors import InputError, UnknownNameError, located
from mjfish.fish import Fish
from mjfish.numerics.arrays import BoolArray, FloatArray

#: A point is off where it is this many sigma from where it belongs.
_OFF = 4.0
#: Frames of the running median.
_MEDIAN_FRAMES = 9


def steadied(measured: FloatArray) -> FloatArray:
    """Return points (n, points, 2) without jumps and gaps, to start a fit from."""
    filled, frames = measured.copy(), np.arange(len(measured))
    good: BoolArray = np.asarray(np.isfinite(measured).all(axis=2))
    for point, axis in product(np.flatnonzero(good.any(axis=0)), range(2)):
        there = good[:, point]
        filled[:, point, axis] = np.interp(frames, frames[there], measured[there, point, axis])
    return np.asarray(median_filter(filled, size=(_MEDIAN_FRAMES, 1, 1), mode="nearest"))


def undo_exchanges(measured: FloatArray, fit: Fit) -> tuple[FloatArray, BoolArray]:
    """Put points back that were exchanged with another one.

    Where two points are off and each lies where the other belongs, they were exchanged.

    Args:
        measured: (n, points, 2).
        fit: of them.

    Returns:
        The points with exchanges undone, and in which frames (n,) there was one.
    """
    belongs = measured - fit.residual
    reach = _OFF * np.maximum(fit.sigma, np.median(fit.sigma))
    off = ~fit.counted & np.isfinite(measured).all(axis=2)
    mended, found = measured.copy(), np.zeros(len(measured), dtype=np.bool_)
    for a, b in combinations(range(measured.shape[1]), 2):
        crossed = off[:, a] & off[:, b]
        crossed &= np.hypot(*(measured[:, a] - belongs[:, b]).T) < reach[b]
        crossed &= np.hypot(*(measured[:, b] - belongs[:, a]).T) < reach[a]
        mended[crossed, a], mended[crossed, b] = measured[crossed, b], measured[crossed, a]
        found |= crossed
    return mended, found


#: Harmonics of the beat: drag is quadratic, which makes odd ones up to the fifth.
HARMONICS = 5
#: Noise to begin with [m]: that of a marker which is lost half of the time.
_SIGMA = 3e-3
#: A marker sits where nobody believes it may if it is so many standard deviations of that belief off, and wanders if
#: its noise is so many times that of the others.
_BELIEVED, _WANDERS = 4.0, 4.0


def placed(table: MarkersMap, fish: Fish, place: Path) -> Marked:
    """Put the markers of a mapping on the links of its fish.

    Raises:
        UnknownNameError: no such link or marker.
        InputError: no two markers of the head whose place is exact, or too few on the other links.
    """
    names = tuple(entry.name for entry in table.markers)
    links = {link.name: index for index, link in enumerate(fish.links)}
    for entry in table.markers:
        if entry.link not in links:
            raise UnknownNameError(f"link in {place}, marker {entry.name}", entry.link, links)
    for name in (name for plane in table.planes for name in plane.markers):
        if name not in names:
            raise UnknownNameError(f"marker in {place}, planes", name, names)
    lengths = np.array([link.length for link in fish.links])
    link = np.array([links[entry.link] for entry in table.markers])
    station = np.array([entry.station for entry in table.markers]) - (np.cumsum(lengths) - lengths)[link]
    doubts = np.array([(entry.along, entry.across) for entry in table.markers])
    inside = np.array([[name in plane.markers for plane in table.planes] for name in names], dtype=np.float64)
    exact = np.flatnonzero((link == 0) & ~doubts.any(axis=1) & ~inside.any(axis=1))
    base = sorted(map(int, exact), key=lambda m: float(station[m]))
    behind = tuple(map(int, np.flatnonzero(link)))
    if len(base) < 2 or station[base[0]] == station[base[-1]]:
        raise InputError(
            f"{place}: markers: expected two on link '{fish.links[0].name}' at different stations, without along, "
            "across or plane: they give the scale and the pose; add them"
        )
    if len(behind) < fish.joints:
        raise InputError(
            f"{place}: markers: {len(behind)} behind the head, expected {fish.joints} or more, as many as joints; "
            "add them"
        )
    shift, slip = (np.array([getattr(plane, name) for plane in table.planes]) for name in ("shift", "slip"))
    rolling = next(((i, plane.below) for i, plane in enumerate(table.planes) if plane.below is not None), None)
    return Marked(names, lengths, link, station, doubts, inside, shift, slip, (base[0], base[-1]), behind, rolling)


def _roll(marked: Marked, fit: Fit) -> FloatArray | None:
    """Return the roll (n,) [rad], positive with port up: what lies below the base then slips to port."""
    if marked.rolling is None:
        return None
    plane, below = marked.rolling
    return np.asarray(-fit.coordinates()[:, 3 + marked.joints + plane] / below)


@dataclass(frozen=True, eq=False)
class Track:
    """A fitted track.

    Attributes:
        fit: coordinates x, y, yaw, joint angles, slips.
        astray: (n, markers) where a marker was not where it belongs, one that is not used too.
        dropped: markers that are not used at all.
        exchanged: frames in which markers had to be put back.
    """

    fit: Fit
    astray: BoolArray
    dropped: tuple[int, ...]
    exchanged: int


def fit_track(measured: FloatArray, marked: Marked, rate: float, path: Path) -> Track:
    """Fit a track; markers that wander, or sit where nobody believes they may, are left out one after the other.

    Args:
        measured: (n, markers, 2) [m].
        marked: where they sit.
        rate: frames a second [Hz].
        path: the file, for messages.

    Raises:
        InputError: too few markers are left for the pose or the joint angles.
    """
    dropped: list[int] = []
    fit, chain = _fit(measured, dropped, marked, rate, path)
    measured, found = undo_exchanges(measured, fit)
    if found.any():
        fit, chain = _fit(measured, dropped, marked, rate, path)
    while (worst := _worst(fit, chain, marked, dropped)) is not None:
        dropped.append(worst)
        left = len(marked.behind) - len(dropped)
        if left < marked.joints:
            named = ", ".join(marked.names[m] for m in sorted(dropped))
            raise InputError(
                f"{path}: no joint angles to be had: markers {named} are lost, exchanged or not where they belong, "
                f"which leaves {left} behind the head, expected {marked.joints} or more; track these markers again, or "
                "leave this file out"
            )
        fit, chain = _fit(measured, dropped, marked, rate, path)
    off = np.hypot(*np.moveaxis(measured - chain.at(fit.coordinates(), fit.shared)[0], -1, 0))
    astray = np.asarray(~(off < _OFF * np.maximum(fit.sigma, np.median(fit.sigma))))
    return Track(fit, astray, tuple(dropped), int(found.sum()))


def _fit(measured: FloatArray, dropped: Sequence[int], marked: Marked, rate: float, path: Path) -> tuple[Fit, Chain]:
    used = measured.copy()
    used[:, dropped] = np.nan
    chain, time = Chain(used, marked), np.arange(len(measured)) / rate
    start, lateral = _start(steadied(used), marked, chain)
    hertz, periodic = beat_frequency(time, lateral)
    first = hertz if periodic else None
    with located(str(path)):
        return smooth(chain, Basis.of(time, first, HARMONICS), first, start, _SIGMA), chain


def _start(seen: FloatArray, marked: Marked, chain: Chain) -> tuple[FloatArray, FloatArray]:
    """Return coordinates (n, k) to start from, a tail bent alike at every joint, and how it swings (n,) [m]."""
    front, rear = marked.base
    ahead = seen[:, front] - seen[:, rear]
    ahead = ahead / np.hypot(*ahead.T)[:, None]
    present = [m for m in marked.behind if np.isfinite(seen[:, m]).all()]
    ordered = sorted(present, key=lambda m: (marked.link[m], marked.station[m]))
    fin = seen[:, ordered[-1]] - seen[:, rear]
    lateral = ahead[:, 0] * fin[:, 1] - ahead[:, 1] * fin[:, 0]
    yaw = np.unwrap(np.arctan2(ahead[:, 1], ahead[:, 0]))
    along = seen[:, ordered[-1]] - seen[:, ordered[0]]
    bend = np.angle(np.exp(1j * (np.arctan2(along[:, 1], along[:, 0]) - yaw - np.pi)))
    start = np.zeros((len(seen), chain.coordinates))
    start[:, :2] = seen[:, front] + marked.station[front] * ahead
    start[:, 2] = yaw
    start[:, 3 : 3 + marked.joints] = 2.0 * bend[:, None] / (1 + marked.joints)
    return start, lateral


def _worst(fit: Fit, chain: Chain, marked: Marked, dropped: Sequence[int]) -> int | None:
    """Return the marker behind the head that is least where it belongs, None where all are."""
    offsets = np.abs(chain.places(fit.shared)) / np.maximum(marked.doubts, 1e-6)
    usual = float(np.median([fit.sigma[m] for m in range(len(marked.names)) if m not in dropped]))
    candidates = {
        m: max(float(offsets[m].max()) / _BELIEVED, float(fit.sigma[m]) / usual / _WANDERS)
        for m in marked.behind
        if m not in dropped
    }
    worst = max(candidates, key=lambda m: candidates[m])
    return worst if candidates[worst] > 1.0 else None


#: A second: less cannot hold a beat.
_LEAST_SECONDS = 1.0
#: Longest piece of a film that is smoothed at once [s]: time and memory go with the cube of its length.
_LONGEST_SECONDS = 10.0


def import_markers(
    files: Sequence[Path],
    held_out: Sequence[str] = (),
    mapping: Path | None = None,
    *,
    importer: str = "markers",
    read: Callable[[Path, MarkersMap], FloatArray] | None = None,
) -> tuple[Dataset, ImportReport]:
    """Turn marker tracks into a dataset with measured joint angles.

    Velocities are those of the nose in the forward frame; the world of the pose is the camera's (x to the right of the
    image, y up the image), its origin at the nose at the start of each trial. The noise of the dataset is the rms over
    its fit trials. A file of more than ten seconds becomes several trials, and has as many rows in the report.

    Args:
        files: one a run.
        held_out: names of trials or runs not to be fitted. If empty, runs with a marker left out are held out where
            others are complete.
        mapping: the mapping file, of ``kind = "markers"``.
        importer: name for the report.
        read: gives the points (n, markers, 2) of a file, NaN where lost; None: from the columns that the mapping names.

    Raises:
        InputError: a file is not a marker file, or has no stretch of two beats with all that is needed.
        UnknownNameError: `held_out` names nothing, or the mapping names no link of the fish.
    """
    table, fish, place = read_mapping(mapping, MarkersMap, importer)
    marked = placed(table, fish, place)
    runs = [run for path in files for run in _import(path, table, marked, (read or read_points)(path, table))]
    dataset, report = assembled(runs, fish, held_out, importer, importer)
    return with_noise(dataset, runs), report


def _import(path: Path, table: MarkersMap, marked: Marked, points: FloatArray) -> list[Run]:
    """Import a file, a long one in pieces of equal length; those that cannot be used are cut out, if others can."""
    position, scale = metres(path, points, table, marked)
    found: list[Run] = []
    cuts: list[Cut] = []
    count = int(np.ceil(len(position) / (_LONGEST_SECONDS * table.rate)))
    ends = [len(position) * k // count for k in range(count + 1)]
    name = path.stem.removeprefix(table.prefix)
    for label, (first, end) in zip(stretch_names(name, count), pairwise(ends), strict=True):
        try:
            piece = _piece(position[first:end], scale, table, marked, path, label, first / table.rate)
            found.append(replace(piece, name=name))
        except InputError as error:
            if count == len(cuts) + 1:  # all before it were lost, too
                raise
            cuts.append(Cut(first / table.rate, end / table.rate, str(error)))
    report = replace(found[0].report, cuts=(*found[0].report.cuts, *cuts))
    return [replace(found[0], report=report), *found[1:]]


def _piece(
    position: FloatArray, scale: float, table: MarkersMap, marked: Marked, path: Path, label: str, begin: float
) -> Run:
    """Import a piece of a film, under a name of its own, that begins at a time of the file [s]."""
    track = fit_track(position, marked, table.rate, path)
    seen, reasons = _seen(track, marked)
    trials, report = record(track.fit, marked.joints, seen, reasons, label, path, _roll(marked, track.fit))
    report = replace(
        report,
        usable=int((~track.astray[:, marked.behind]).all(axis=1).sum()),
        cuts=tuple(replace(cut, start=cut.start + begin, end=cut.end + begin) for cut in report.cuts),
        notes=_notes(track, marked, report.notes, scale),
    )
    return Run(label, trials, report, not track.dropped)


def read_points(path: Path, table: MarkersMap) -> FloatArray:
    """Return the points of the markers (n, markers, 2) in the units of the file, NaN where one is lost."""
    columns = [name for entry in table.markers for name in (entry.columns or (f"X{entry.name}", f"Y{entry.name}"))]
    sheet = read_sheet(path, table, names=None if table.header else columns)
    return np.stack([sheet.numbers(name, missing=table.missing) for name in columns], axis=1).reshape(
        -1, len(table.markers), 2
    )


def metres(path: Path, raw: FloatArray, table: MarkersMap, marked: Marked) -> tuple[FloatArray, float]:
    """Return points (n, markers, 2) in metres, y up, by the known distance of the first two markers, and the scale."""
    fewest = int(np.ceil(_LEAST_SECONDS * table.rate))
    if len(raw) < fewest:
        raise InputError(f"{path}: has {len(raw)} frames, expected {fewest} or more; give a longer track")
    first, second = marked.base
    distance = np.hypot(*(raw[:, second] - raw[:, first]).T)
    a, b = table.markers[first].name, table.markers[second].name
    if not np.isfinite(distance).any():
        raise InputError(f"{path}: markers {a} and {b} are never seen at once, which leaves no scale; track them again")
    apart = float(np.nanmedian(distance))
    if not apart > 0.0:
        raise InputError(f"{path}: markers {a} and {b} lie on each other, which leaves no scale; track them again")
    scale = abs(table.markers[second].station - table.markers[first].station) / apart
    # The mirror turns an image's left-handed pair (x right, y down) into a right-handed one with z up.
    return raw * [scale, -scale if table.y == "down" else scale], scale


def _seen(track: Track, marked: Marked) -> tuple[BoolArray, dict[int, str]]:
    """Return the frames in which every marker that is used was in its place, and who was lost in the others."""
    used = [m for m in range(len(marked.names)) if m not in track.dropped]
    lost = ~track.fit.counted[:, used]
    reasons = {
        int(frame): "marker " + ", ".join(marked.names[used[m]] for m in np.flatnonzero(lost[frame]))
        for frame in np.flatnonzero(lost.any(axis=1))
    }
    return np.asarray(~lost.any(axis=1)), reasons


def _notes(track: Track, marked: Marked, bridged: Sequence[str], scale: float) -> tuple[str, ...]:
    notes = [
        f"marker {marked.names[m]} lost in {int(track.astray[:, m].sum())} frames and not used"
        for m in sorted(track.dropped)
    ]
    notes += [f"markers exchanged in {track.exchanged} frames and put back"] if track.exchanged else []
    spread = 1e3 * float(np.median(track.fit.sigma / np.sqrt(track.fit.frames)))
    return (
        *notes,
        *bridged,
        f"markers known to {spread:.2g} mm ({spread / scale / 1e3:.2g} pixels), errors correlated over "
        f"{float(np.median(track.fit.frames)):.0f} frames",
    )


def import_fishsim(
    files: Sequence[Path], held_out: Sequence[str] = (), mapping: Path | None = None
) -> tuple[Dataset, ImportReport]:
    """Import marker files of the folder Data/Markers of the repository, see `import_markers`."""
    return import_markers(files, held_out, mapping or LAYOUTS / "fishsim.toml", importer="fishsim")


_HEADS = ("scorer", "bodyparts", "coords")
_COORDINATES = ("x", "y", "likelihood")


def import_deeplabcut(
    files: Sequence[Path], held_out: Sequence[str] = (), mapping: Path | None = None
) -> tuple[Dataset, ImportReport]:
    """Import tracks of DeepLabCut, see `import_markers`; a point below the mapping's ``likelihood`` is lost.

    Raises:
        MjfishError: as of `import_markers`; a file is no such CSV, or has several animals.
    """
    return import_markers(files, held_out, mapping, importer="deeplabcut", read=read_tracks)


def read_tracks(path: Path, table: MarkersMap) -> FloatArray:
    """Return the points of the mapping's markers (n, markers, 2) [pixels]; NaN where the tracker was not sure.

    Raises:
        InputError: no such file, no CSV of DeepLabCut, of several animals, or a cell that is no number.
        UnknownNameError: no such body part.
    """
    parts = _body_parts(path, table)
    columns = ["frame", *(f"{part} {coordinate}" for part in parts for coordinate in _COORDINATES)]
    sheet = read_sheet(path, _below(table, len(_HEADS)), names=columns)
    points = np.empty((sheet.cells.num_rows, len(table.markers), 2))
    for m, entry in enumerate(table.markers):
        if entry.name not in parts:
            raise UnknownNameError(f"body part in {path}", entry.name, parts)
        x, y, likelihood = (sheet.numbers(f"{entry.name} {coordinate}", missing=True) for coordinate in _COORDINATES)
        points[:, m] = np.column_stack([x, y])
        points[~(likelihood >= table.likelihood), m] = np.nan
    return points


def _body_parts(path: Path, table: MarkersMap) -> list[str]:
    """Return the body parts of a file that is laid out as DeepLabCut does."""
    heads: list[tuple[str, ...]] = []
    for number, head in enumerate(_HEADS):
        heads.append(recognise(path, _below(table, number)).headers)
        if heads[-1][:1] == ("individuals",):
            raise InputError(f"{path}: has tracks of several animals; export those of one")
        if heads[-1][:1] != (head,) or (heads[2:] and heads[2][1:4] != _COORDINATES):
            raise InputError(
                f"{path}: no CSV of DeepLabCut, expected lines that begin with {', '.join(_HEADS)} and columns "
                f"{', '.join(_COORDINATES)}; import it as 'markers' with a mapping file"
            )
    return list(heads[1][1 :: len(_COORDINATES)])


def _below(table: MarkersMap, lines: int) -> MarkersMap:
    """Return the mapping of what lies below the first lines of a table."""
    return table.model_copy(update={"skip": (table.skip or 0) + lines})
