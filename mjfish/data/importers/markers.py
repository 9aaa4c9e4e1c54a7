"""Importer of marker tracks: pixels of markers on the links, seen by a camera from above."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mjfish.arrays import BoolArray, FloatArray
from mjfish.data import Dataset
from mjfish.data.importers import roles, rows
from mjfish.data.importers.mapping import MarkersMap, fish_of, read
from mjfish.data.importers.marked import Marked, Track, fit_track
from mjfish.data.importers.recording import Recording, record, with_noise
from mjfish.data.importers.report import FileReport, ImportReport
from mjfish.errors import InputError
from mjfish.fish import Fish

#: A second: less cannot hold a beat.
_LEAST_SECONDS = 1.0
_ABOUT = "give a marker file as the mapping describes it"


@dataclass(frozen=True, eq=False)
class _Imported:
    """One file: its trials without roles, its report, and whether a marker had to be left out."""

    name: str
    recording: Recording
    report: FileReport
    complete: bool


def import_files(
    files: Sequence[Path], held_out: Sequence[str] = (), mapping: Path | None = None, *, importer: str = "markers"
) -> tuple[Dataset, ImportReport]:
    """Turn marker tracks into a dataset with measured joint angles.

    Velocities are those of the nose in the forward frame; the world of the pose is the camera's (x to the right of the
    image, y up the image), its origin at the nose at the start of each trial. The noise of the dataset is the rms over
    its fit trials.

    Args:
        files: one a run.
        held_out: names of trials or runs not to be fitted. If empty, runs with a marker left out are held out where
            others are complete.
        mapping: the mapping file, of ``kind = "markers"``.
        importer: name for the report.

    Raises:
        InputError: a file is not a marker file, or has no stretch of two beats with all that is needed.
        UnknownNameError: `held_out` names nothing, or the mapping names no link of the fish.
    """
    table = read(mapping, MarkersMap, importer)
    assert mapping is not None  # noqa: S101 - read refuses None
    fish = fish_of(table, mapping)
    marked = Marked.of(table, fish, mapping)
    imported = [_import(path, table, marked, fish) for path in files]
    names = [run.name for run in imported]
    roles.distinct(names, files)
    pairs = [(run.name, trial) for run in imported for trial in run.recording.trials]
    doubtful = [not run.complete for run in imported for _ in run.recording.trials]
    dataset = Dataset(
        name=f"{importer} {', '.join(names)}",
        fish=fish,
        trials=roles.assign(pairs, held_out, doubtful),
    )
    dataset = with_noise(dataset, [run.recording for run in imported])
    return dataset, ImportReport(importer, tuple(run.report for run in imported))


def _import(path: Path, table: MarkersMap, marked: Marked, fish: Fish) -> _Imported:
    position, scale = metres(path, table, marked)
    track = fit_track(position, marked, table.rate, path)
    name = path.stem.removeprefix(table.prefix)
    seen, reasons = _seen(track, marked)
    recording = record(track.fit, fish.joints, seen, reasons, name, path, marked.roll(track.fit))
    report = FileReport(
        path=path,
        trials=tuple(trial.name for trial in recording.trials),
        frames=len(position),
        usable=int((~track.astray[:, marked.behind]).all(axis=1).sum()),
        kept=sum(len(trial.time) for trial in recording.trials),
        beat=track.fit.beat,
        speed=float(np.concatenate([trial.velocity[:, 0] for trial in recording.trials]).mean()),
        noise=(float(recording.noise[0]), float(recording.noise[1]), float(recording.noise[2])),
        alike=recording.alike,
        joint_noise=recording.joint_noise,
        cuts=recording.cuts,
        notes=_notes(track, marked, recording, scale),
    )
    return _Imported(name, recording, report, not track.dropped)


def metres(path: Path, table: MarkersMap, marked: Marked) -> tuple[FloatArray, float]:
    """Return the markers (n, markers, 2) in metres, y up, by the known distance of the first two, and the scale."""
    columns = [name for entry in table.markers for name in (entry.columns or (f"X{entry.name}", f"Y{entry.name}"))]
    read_columns = rows.read(
        path, columns, header=table.header, missing=table.missing, about=_ABOUT,
        fewest=int(np.ceil(_LEAST_SECONDS * table.rate)),
    )  # fmt: skip
    raw = np.stack([read_columns[name] for name in columns], axis=1).reshape(-1, len(table.markers), 2)
    first, second = marked.base
    apart = float(np.nanmedian(np.hypot(*(raw[:, second] - raw[:, first]).T)))
    if not apart > 0.0:
        a, b = table.markers[first].name, table.markers[second].name
        raise InputError(f"{path}: markers {a} and {b} lie on each other, which leaves no scale; track them again")
    scale = abs(table.markers[second].station - table.markers[first].station) / apart
    # The mirror turns an image's left-handed pair (x right, y down) into a right-handed one with z up.
    return raw * [scale, -scale if table.y == "down" else scale], scale


def _seen(track: Track, marked: Marked) -> tuple[BoolArray, dict[int, str]]:
    """Return the frames in which every marker that is used was in its place, and who was lost in the others."""
    used = [m for m in range(len(marked.names)) if m not in track.dropped]
    lost = ~track.fit.kept[:, used]
    reasons = {
        int(frame): "marker " + ", ".join(marked.names[used[m]] for m in np.flatnonzero(lost[frame]))
        for frame in np.flatnonzero(lost.any(axis=1))
    }
    return np.asarray(~lost.any(axis=1)), reasons


def _notes(track: Track, marked: Marked, recording: Recording, scale: float) -> tuple[str, ...]:
    notes = [
        f"marker {marked.names[m]} lost in {int(track.astray[:, m].sum())} frames and not used"
        for m in sorted(track.dropped)
    ]
    if track.exchanged:
        notes.append(f"markers exchanged in {track.exchanged} frames and put back")
    if recording.bridged:
        notes.append(f"{recording.bridged} frames with lost markers bridged")
    spread = 1e3 * float(np.median(track.fit.sigma / np.sqrt(track.fit.frames)))
    notes.append(
        f"markers known to {spread:.2g} mm ({spread / scale / 1e3:.2g} pixels), errors alike over "
        f"{float(np.median(track.fit.frames)):.0f} frames"
    )
    return tuple(notes)
