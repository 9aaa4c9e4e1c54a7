"""Markers of a mapping on a fish, and the smoother's fit to a track of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mjfish.arrays import BoolArray, FloatArray, readonly
from mjfish.data.importers.mapping import MarkersMap
from mjfish.data.importers.smooth import batch, beat, points
from mjfish.data.importers.smooth.basis import Basis
from mjfish.data.importers.smooth.batch import Fit
from mjfish.data.importers.smooth.chain import Chain, Marker, Plane
from mjfish.errors import InputError, UnknownNameError
from mjfish.fish import Fish

#: Harmonics of the beat: drag is quadratic, which makes odd ones up to the fifth.
HARMONICS = 5
#: Noise to begin with [m]: that of a marker which is lost half of the time.
_SIGMA = 3e-3
#: A marker sits where nobody believes it may if it is so many standard deviations of that belief off, and wanders if
#: its noise is so many times that of the others.
_BELIEVED, _WANDERS = 4.0, 4.0
#: Slips of markers that have none [m].
_NONE = 1e-6


@dataclass(frozen=True, eq=False)
class Marked:
    """Where the markers sit.

    Attributes:
        names: of the markers.
        lengths: of the links [m].
        markers: on them.
        planes: of markers at other heights.
        base: the two markers that define the head, front one first.
        behind: those on links behind the head.
        rolling: the plane whose slip measures the roll, and how far it lies below the base [m]; None: nothing does.
    """

    names: tuple[str, ...]
    lengths: FloatArray
    markers: tuple[Marker, ...]
    planes: tuple[Plane, ...]
    base: tuple[int, int]
    behind: tuple[int, ...]
    rolling: tuple[int, float] | None = None

    @staticmethod
    def of(table: MarkersMap, fish: Fish, place: Path) -> Marked:
        """Put the markers of a mapping on the links of its fish.

        Raises:
            UnknownNameError: no such link or marker.
            InputError: no two markers of the head whose place is exact, or too few on the other links.
        """
        names = tuple(entry.name for entry in table.markers)
        links = {link.name: index for index, link in enumerate(fish.links)}
        fronts = np.concatenate([[0.0], np.cumsum([link.length for link in fish.links])])
        for entry in table.markers:
            if entry.link not in links:
                raise UnknownNameError(f"link in {place}, marker {entry.name}", entry.link, links)
        markers = tuple(
            Marker(links[entry.link], entry.station - fronts[links[entry.link]], entry.along, entry.across)
            for entry in table.markers
        )
        for plane in table.planes:
            for name in plane.markers:
                if name not in names:
                    raise UnknownNameError(f"marker in {place}, planes", name, names)
        planes = tuple(
            Plane(tuple(names.index(name) for name in plane.markers), plane.shift, max(plane.slip, _NONE))
            for plane in table.planes
        )
        raised = {m for plane in planes for m in plane.markers}
        exact = [m for m, own in enumerate(markers) if own.link == 0 and own.along == own.across == 0.0]
        base = sorted((m for m in exact if m not in raised), key=lambda m: markers[m].station)
        behind = tuple(m for m, own in enumerate(markers) if own.link > 0)
        if len(base) < 2 or markers[base[0]].station == markers[base[-1]].station:
            raise InputError(
                f"{place}: markers: expected two on link '{fish.links[0].name}' at different stations, without along, "
                "across or plane: they give the scale and the pose; add them"
            )
        if len(behind) < fish.joints:
            raise InputError(
                f"{place}: markers: {len(behind)} behind the head, expected {fish.joints} or more, as many as joints; "
                "add them"
            )
        lengths = readonly([link.length for link in fish.links])
        rolling = next(((i, plane.below) for i, plane in enumerate(table.planes) if plane.below is not None), None)
        return Marked(names, lengths, markers, planes, (base[0], base[-1]), behind, rolling)

    def roll(self, fit: Fit) -> FloatArray | None:
        """Return the roll (n,) [rad], positive with port up: what lies below the base then slips to port."""
        if self.rolling is None:
            return None
        plane, below = self.rolling
        return np.asarray(-fit.coordinates()[:, 2 + len(self.lengths) + plane] / below)

    def without(self, dropped: Sequence[int], measured: FloatArray) -> FloatArray:
        """Return the points with some never seen."""
        seen = measured.copy()
        seen[:, list(dropped)] = np.nan
        return seen


@dataclass(frozen=True, eq=False)
class Track:
    """A fitted track.

    Attributes:
        fit: coordinates x, y, yaw, joint angles, slips.
        astray: (n, markers) where a marker was not where it belongs.
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
    exchanged, mended = 0, False
    while True:
        fit, chain = _fit(marked.without(dropped, measured), marked, rate)
        if not mended:
            mended = True
            put_back, found = points.exchanged(measured, fit)
            if found.any():
                measured, exchanged = put_back, int(found.sum())
                continue
        worst = _worst(fit, chain, marked, dropped)
        if worst is None:
            break
        dropped.append(worst)
        _enough(dropped, fit, measured, marked, path)
    astray = _astray(measured, fit, chain)
    return Track(fit, astray, tuple(dropped), exchanged)


def _fit(measured: FloatArray, marked: Marked, rate: float) -> tuple[Fit, Chain]:
    chain = Chain(measured, marked.lengths, marked.markers, marked.planes)
    time = np.arange(len(measured)) / rate
    start, lateral = _start(points.steadied(measured), marked, chain)
    hertz, periodic = beat.frequency(time, lateral)
    first = hertz if periodic else None
    return batch.fit(chain, Basis.of(time, first, HARMONICS), first, start, _SIGMA), chain


def _start(seen: FloatArray, marked: Marked, chain: Chain) -> tuple[FloatArray, FloatArray]:
    """Return coordinates (n, k) to start from, a tail bent alike at every joint, and how it swings (n,) [m]."""
    front, rear = marked.base
    ahead = seen[:, front] - seen[:, rear]
    ahead = ahead / np.hypot(*ahead.T)[:, None]
    present = [m for m in marked.behind if np.isfinite(seen[:, m]).all()]
    last = max(present, key=lambda m: (marked.markers[m].link, marked.markers[m].station))
    fin = seen[:, last] - seen[:, rear]
    lateral = ahead[:, 0] * fin[:, 1] - ahead[:, 1] * fin[:, 0]
    yaw = np.unwrap(np.arctan2(ahead[:, 1], ahead[:, 0]))
    first = min(present, key=lambda m: (marked.markers[m].link, marked.markers[m].station))
    along = seen[:, last] - seen[:, first]
    bend = np.angle(np.exp(1j * (np.arctan2(along[:, 1], along[:, 0]) - yaw - np.pi)))
    start = np.zeros((len(seen), chain.coordinates))
    start[:, :2] = seen[:, front] + marked.markers[front].station * ahead
    start[:, 2] = yaw
    start[:, 3 : 3 + chain.joints] = 2.0 * bend[:, None] / (1 + chain.joints)
    return start, lateral


def _worst(fit: Fit, chain: Chain, marked: Marked, dropped: Sequence[int]) -> int | None:
    """Return the marker behind the head that is least where it belongs, None where all are."""
    offsets = np.abs(chain.places(fit.shared)) / np.maximum(chain.doubts, 1e-6)
    usual = float(np.median([fit.sigma[m] for m in range(len(marked.names)) if m not in dropped]))
    candidates = {
        m: max(float(offsets[m].max()) / _BELIEVED, float(fit.sigma[m]) / usual / _WANDERS)
        for m in marked.behind
        if m not in dropped
    }
    worst = max(candidates, key=lambda m: candidates[m])
    return worst if candidates[worst] > 1.0 else None


def _enough(dropped: Sequence[int], fit: Fit, measured: FloatArray, marked: Marked, path: Path) -> None:
    left = len(marked.behind) - len(dropped)
    joints = len(marked.lengths) - 1
    if left < joints:
        named = ", ".join(f"{marked.names[m]}" for m in sorted(dropped))
        raise InputError(
            f"{path}: no joint angles to be had: markers {named} are lost, exchanged or not where they belong, which "
            f"leaves {left} behind the head, expected {joints} or more; track these markers again, or leave this file "
            "out"
        )


def _astray(measured: FloatArray, fit: Fit, chain: Chain) -> BoolArray:
    """Return where markers (n, markers) are not where they belong, those too that were not used."""
    value = chain.at(fit.coordinates(), fit.shared).value
    off = np.hypot(*np.moveaxis(measured - value, -1, 0))
    usual = 4.0 * np.maximum(fit.sigma, np.median(fit.sigma))
    return np.asarray(~(off < usual))
