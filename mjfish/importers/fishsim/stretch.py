"""Usable stretches of a file: long enough, the head seen throughout, at most one tail plate left out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mjfish.arrays import BoolArray
from mjfish.errors import InputError
from mjfish.importers.fishsim.markers import TAIL, MarkerFile
from mjfish.importers.fishsim.tracking import runs

#: Shortest stretch that is kept [beats].
BEATS = 2.0
#: Plates whose marker may be missing: the shape of the tail between its neighbours follows from their distance.
_DISPENSABLE = (4, 5, 6)
#: A marker is left out for the whole file only where keeping it would keep less than this share of the frames.
_ENOUGH = 0.5


@dataclass(frozen=True, eq=False)
class Stretches:
    """What is kept of a file.

    Attributes:
        kept: stretches [start, end) in frames.
        left_out: the tail marker that is not used, or None.
    """

    kept: tuple[tuple[int, int], ...]
    left_out: int | None

    @property
    def frames(self) -> int:
        """Number of frames kept."""
        return sum(b - a for a, b in self.kept)


def choose(file: MarkerFile, gone: BoolArray, beat_frames: float, whole: int) -> Stretches:
    """Choose the stretches to keep.

    A marker that comes and goes would make the joint angles jump each time, so that it is left out from the first
    frame to the last, and not only where it is lost.

    Args:
        file: for messages.
        gone: (n, 9) markers lost for longer than is filled.
        beat_frames: frames a beat.
        whole: frames in which every tail marker was found, for the message.

    Raises:
        InputError: no stretch is long enough; names the file, the markers and what to do.
    """
    fewest = int(np.ceil(BEATS * beat_frames))
    best = Stretches(_kept(gone, fewest), None)
    if best.frames < _ENOUGH * len(gone):
        for marker in _DISPENSABLE:
            other = Stretches(_kept(_without(gone, marker), fewest), marker)
            best = other if other.frames > best.frames else best
    if not best.kept:
        raise InputError(_refusal(file, gone, fewest, whole))
    return best


def _kept(gone: BoolArray, fewest: int) -> tuple[tuple[int, int], ...]:
    return tuple((a, b) for a, b in _whole(gone) if b - a >= fewest)


def _whole(gone: BoolArray) -> list[tuple[int, int]]:
    return runs(np.asarray(~gone.any(axis=1)))


def _without(gone: BoolArray, marker: int) -> BoolArray:
    """Return what is lost when one marker does not count."""
    others = gone.copy()
    others[:, marker] = False
    return others


def _refusal(file: MarkerFile, gone: BoolArray, fewest: int, whole: int) -> str:
    count = gone.sum(axis=0)
    named = ", ".join(f"{marker} in {count[marker]} frames" for marker in np.flatnonzero(count))
    candidates = [gone, *(_without(gone, marker) for marker in _DISPENSABLE)]
    longest = max(b - a for candidate in candidates for a, b in [*_whole(candidate), (0, 0)])
    what = "joint angles" if count[list(TAIL)].max() >= count.max() else "head pose"
    return (
        f"{file.path}: no {what} to be had: markers lost or swapped: {named}; all tail markers 3-8 are usable in "
        f"{whole} of {len(gone)} frames; with at most one of the plates' markers 4-6 left out, the longest usable "
        f"stretch has {longest} frames, expected {fewest} or more ({BEATS:g} beats); track these markers again, or "
        "leave this file out"
    )


def reasons(gone: BoolArray, stretches: Stretches, start: int, end: int) -> str:
    """Say why the frames [start, end) were cut."""
    count = gone[start:end].sum(axis=0)
    if stretches.left_out is not None:
        count[stretches.left_out] = 0
    markers = ", ".join(str(marker) for marker in np.flatnonzero(count))
    return f"marker {markers} lost" if markers else f"shorter than {BEATS:g} beats"
