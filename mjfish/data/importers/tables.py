"""Importers of tables of poses or velocities, in the units and axes of the laboratory.

Poses (time, x, y and yaw of a point of the head) become sensors of the place and of the heading, with the samples as
they are; velocities are taken as they are, too.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Generic, Protocol, TypeVar

import numpy as np

from mjfish.arrays import BoolArray, FloatArray, readonly
from mjfish.data import Dataset, Trial
from mjfish.data.importers.mapping import (
    ANGLES,
    LENGTHS,
    TIMES,
    PosesMap,
    VelocitiesMap,
    angle_columns,
    driven,
    fish_of,
    measured_angles,
    read_mapping,
    wave_drive,
)
from mjfish.data.importers.report import Cut, FileReport, ImportReport
from mjfish.data.importers.smoothing import FASTEST, SLOWEST, beat_frequency
from mjfish.data.importers.trials import (
    BEATS,
    SECONDS,
    assign_roles,
    check_distinct,
    longest,
    runs,
    stretch_names,
)
from mjfish.data.sensor import Kind, Sensor, cleaned, within
from mjfish.data.tables import read_columns
from mjfish.errors import InputError
from mjfish.fish import Fish
from mjfish.frames import CHANNELS
from mjfish.known import Beforehand

M = TypeVar("M", PosesMap, VelocitiesMap)

_FEWEST_POSES = 20
#: Longest gap between joint angles that a spline may bridge [s], and in steps.
_GAP, _STEPS = 0.1, 2.5
#: How well the place of a tracked point is known that nobody states: share of the length of the head, and sideways [m].
_SOMEWHERE, _ASIDE = 0.5, 0.01


@dataclass(frozen=True, eq=False)
class Columns:
    """Columns (n,) of a recorded file by name, and what a reader should know of them.

    `lossy`: the recorder may lose rows; velocities are cut there, not refused.
    """

    numbers: Mapping[str, FloatArray]
    notes: tuple[str, ...] = ()
    lossy: bool = False


class Read(Protocol):
    """Reads columns of a file."""

    def __call__(self, path: Path, time: str, names: Sequence[str]) -> Columns:
        """Return the column of the time, and others, by name; cells may be missing (NaN) but those of the time."""


def read_csv(path: Path, time: str, names: Sequence[str]) -> Columns:
    """Return columns of a CSV file with a header."""
    return Columns(read_columns(path, [time, *names], header=True, fewest=1, missing=True))


@dataclass(frozen=True, eq=False)
class _Source(Generic[M]):
    """What columns mean, the fish that swam, the mapping file (for messages), and how a file is read."""

    table: M
    fish: Fish
    file: Path
    read: Read = read_csv


@dataclass(frozen=True, eq=False)
class _Imported:
    name: str
    trials: tuple[Trial, ...]
    report: FileReport


def import_poses(
    files: Sequence[Path],
    held_out: Sequence[str] = (),
    mapping: Path | None = None,
    *,
    importer: str = "poses",
    read: Read = read_csv,
) -> tuple[Dataset, ImportReport]:
    """Turn pose tables into a dataset; joint angles are columns of the table, or a wave.

    Every run has a sensor ``position`` and a sensor ``heading``, with raw samples. Where the mapping does not say where
    the tracked point is, it is somewhere on the head: `Dataset.known` has the offset.

    Args:
        files: one a run; cells may be empty where nothing was tracked.
        held_out: names of trials or runs not to be fitted.
        mapping: the mapping file, of ``kind = "poses"``.
        importer: for the report.
        read: reads a file.

    Raises:
        MjfishError: the mapping or a file is not what it must be, or no stretch is long enough.
    """
    table = read_mapping(mapping, PosesMap, importer)
    assert mapping is not None  # noqa: S101 - read refuses None
    return _import_poses(files, held_out, _Source(table, fish_of(table, mapping), mapping, read), importer)


def _import_poses(
    files: Sequence[Path], held_out: Sequence[str], source: _Source[PosesMap], importer: str
) -> tuple[Dataset, ImportReport]:
    imported = [_import_pose_table(path, source) for path in files]
    check_distinct([run.name for run in imported], files)
    pairs = [(run.name, trial) for run in imported for trial in run.trials]
    known = {}
    if source.table.behind_nose is None:
        known = {
            "marker_offset.along": Beforehand(mean=0.0, sd=_SOMEWHERE * source.fish.links[0].length),
            "marker_offset.across": Beforehand(mean=0.0, sd=_ASIDE),
        }
    dataset = Dataset(
        name=f"poses {', '.join(run.name for run in imported)}",
        fish=source.fish,
        trials=assign_roles(pairs, held_out),
        known=known,
    )
    return dataset, ImportReport(importer, tuple(run.report for run in imported))


def _import_pose_table(path: Path, source: _Source[PosesMap]) -> _Imported:
    table = source.table
    columns = source.read(path, table.time, [table.x, table.y, table.yaw, *angle_columns(table)])
    numbers = columns.numbers
    _check_rows(numbers, table.time, path, _FEWEST_POSES)
    for name in (table.x, table.y, table.yaw, *angle_columns(table)):
        if not np.isfinite(numbers[name]).any():
            raise InputError(f"{path}: column '{name}' has no number, expected what was tracked; name another column")
    numbers, notes = _each_once(numbers, table.time, path)
    time = increasing(numbers[table.time] * TIMES[table.time_unit], path)
    pose = _in_metres(table, np.column_stack([numbers[name] for name in (table.x, table.y, table.yaw)]))
    joints = measured_angles(table, numbers, source.fish, source.file)
    begin = 0.0 if joints is None else float(time[0])
    kinds: tuple[tuple[Kind, slice], ...] = (("position", slice(0, 2)), ("heading", slice(2, 3)))
    sensors = tuple(
        cleaned(Sensor(kind, kind, time - begin, pose[:, at], station=table.behind_nose or 0.0, source=path), path)
        for kind, at in kinds
    )
    name = path.stem.removeprefix(table.prefix)
    whole = Trial(name, None, *_unseen(time - begin), sensors=sensors, source=path, **driven(table))
    if joints is None:
        own, cuts = [replace(whole, wave=wave_drive(table, source.fish, source.file, path))], tuple[Cut, ...]()
    else:
        own, cuts = _bridged(whole, joints, path)
    usable = np.isfinite(np.column_stack([pose] if joints is None else [pose, joints])).all(axis=1)
    seen = sensors[0].values
    report = FileReport(
        path=path,
        trials=tuple(trial.name for trial in own),
        frames=len(columns.numbers[table.time]),
        usable=int(usable.sum()),
        kept=sum(len(trial.sensors[0].time) for trial in own),
        beat=_beat(sensors[1]),
        speed=float(np.hypot(*(seen[-1] - seen[0])) / (sensors[0].time[-1] - sensors[0].time[0])),
        noise=None,
        cuts=cuts,
        notes=(*columns.notes, *notes, *(remark for sensor in sensors for remark in sensor.remarks)),
    )
    return _Imported(name, tuple(own), report)


def _unseen(time: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return times, and velocities (n, 3) that nobody measured."""
    return readonly(time), readonly(np.full((len(time), len(CHANNELS)), np.nan))


def _each_once(
    numbers: Mapping[str, FloatArray], time: str, path: Path
) -> tuple[dict[str, FloatArray], tuple[str, ...]]:
    """Return columns without rows that repeat the one before, and a note on them."""
    stack = np.column_stack([*numbers.values()])
    again = np.zeros(len(stack), dtype=np.bool_)
    again[1:] = np.diff(numbers[time]) == 0.0
    same = np.all((stack[1:] == stack[:-1]) | np.isnan(stack[1:]) & np.isnan(stack[:-1]), axis=1)
    wrong = np.flatnonzero(again[1:] & ~same)
    if wrong.size:
        row = int(wrong[0]) + 1
        raise InputError(
            f"{path}: row {row + 2}, column '{time}': the time of the row before is repeated, with other numbers, "
            "expected every frame once; remove one of the two rows"
        )
    note = (f"{int(again.sum())} repeated rows left out",) if again.any() else ()
    return {name: values[~again] for name, values in numbers.items()}, note


def _bridged(whole: Trial, joints: FloatArray, path: Path) -> tuple[list[Trial], tuple[Cut, ...]]:
    """Return the stretches of a run in which a spline may follow the joints (n, joints), as trials; what was cut."""
    rows = np.flatnonzero(np.isfinite(joints).all(axis=1))
    time = whole.time[rows]
    steps = np.diff(time)
    edges = np.flatnonzero(steps > max(_GAP, _STEPS * float(np.median(steps)))) + 1
    parts = [part for part in np.split(rows, edges) if whole.time[part[-1]] - whole.time[part[0]] >= SECONDS]
    if not parts:
        raise InputError(
            f"{path}: no stretch of {SECONDS:g} s or more in which all joint angles were recorded; record longer, or "
            "leave this file out"
        )
    trials = []
    for name, part in zip(stretch_names(whole.name, len(parts)), parts, strict=True):
        first, last = float(whole.time[part[0]]), float(whole.time[part[-1]])
        sensors = (within(sensor, first, last, path) for sensor in whole.sensors)
        trials.append(
            replace(
                whole,
                name=name,
                time=readonly(whole.time[part] - first),
                velocity=readonly(whole.velocity[part]),
                joint_angle=readonly(joints[part]),
                sensors=tuple(replace(sensor, time=sensor.time - first) for sensor in sensors),
                from_rest=whole.from_rest and part[0] == 0,
            )
        )
    inside = np.zeros(len(whole.time), dtype=np.bool_)
    for part in parts:
        inside[part[0] : part[-1] + 1] = True
    cuts = (Cut(float(whole.time[a]), float(whole.time[b - 1]), "joint angles lost") for a, b in runs(~inside))
    return trials, tuple(cuts)


def _beat(heading: Sensor) -> float | None:
    """Return the frequency at which a heading swings [Hz]; None where it does not."""
    found, periodic = beat_frequency(heading.time, heading.values[:, 0])
    return found if periodic else None


def _check_rows(numbers: Mapping[str, FloatArray], time: str, path: Path, fewest: int) -> None:
    """Refuse a file with few rows, or with a row without a time."""
    rows = len(numbers[time])
    if rows < fewest:
        raise InputError(f"{path}: has {rows} rows, expected one a frame and {fewest} or more; give a longer track")
    lost = np.flatnonzero(~np.isfinite(numbers[time]))
    if lost.size:
        raise InputError(f"{path}: row {int(lost[0]) + 2}, column '{time}': missing, expected a time; correct it")


def increasing(time: FloatArray, path: Path, headers: int = 1) -> FloatArray:
    """Return the times of a file, or refuse such that do not increase; rows are counted with the lines above them."""
    wrong = np.flatnonzero(~(np.diff(time) > 0.0))
    if wrong.size:
        raise InputError(
            f"{path}: row {int(wrong[0]) + 2 + headers}: its time is not after that of the row before; sort the rows"
        )
    check_length(time, path)
    return readonly(time)


def check_length(time: FloatArray, path: Path) -> None:
    """Refuse a record whose times cannot show a beat: too short, or with too few rows for its length."""
    rows, seconds = len(time), float(np.ptp(time))
    if rows < 2.0 * SLOWEST * seconds or seconds * FASTEST <= 1.0:
        raise InputError(
            f"{path}: {rows} rows over {seconds:g} s, expected those of a fish that beats at {SLOWEST:g} to "
            f"{FASTEST:g} Hz; correct the times, or their unit"
        )


def _in_metres(table: PosesMap, raw: FloatArray) -> FloatArray:
    """Return x, y [m], yaw [rad] of the tracked point (n, 3), y up and yaw anticlockwise, from its own axes."""
    length, angle = LENGTHS[table.length_unit], ANGLES[table.angle_unit]
    mirror = 1.0 if table.axes == "y_up" else -1.0
    return np.column_stack(
        [length * raw[:, 0], mirror * length * raw[:, 1], mirror * angle * (raw[:, 2] - table.yaw_zero)]
    )


def import_mapped(
    files: Sequence[Path], held_out: Sequence[str], table: PosesMap | VelocitiesMap, fish: Fish, place: Path
) -> tuple[Dataset, ImportReport]:
    """Turn CSV tables into a dataset, as `import_poses` and `import_velocities` do, by a mapping that is in no file.

    Args:
        files: one a run.
        held_out: names of trials or runs not to be fitted.
        table: what columns and units mean; its `fish` is not read.
        fish: that swam.
        place: of the mapping, for messages.

    Raises:
        MjfishError: as of these importers.
    """
    if isinstance(table, PosesMap):
        return _import_poses(files, held_out, _Source(table, fish, place), table.kind)
    return _import_velocities(files, held_out, _Source(table, fish, place), table.kind)


_FEWEST_VELOCITIES = 7


def import_velocities(
    files: Sequence[Path],
    held_out: Sequence[str] = (),
    mapping: Path | None = None,
    *,
    importer: str = "velocities",
    read: Read = read_csv,
) -> tuple[Dataset, ImportReport]:
    """Turn velocity tables into a dataset.

    Velocities of a point d behind the nose are carried to the nose, sway_nose = sway + d yaw_rate. Nothing is smoothed.

    Args:
        files: one a run.
        held_out: names of trials not to be fitted.
        mapping: the mapping file, of ``kind = "velocities"``.
        importer: for the report.
        read: reads a file.

    Raises:
        MjfishError: the mapping or a file is not what it must be.
    """
    table = read_mapping(mapping, VelocitiesMap, importer)
    assert mapping is not None  # noqa: S101 - read refuses None
    return _import_velocities(files, held_out, _Source(table, fish_of(table, mapping), mapping, read), importer)


def _import_velocities(
    files: Sequence[Path], held_out: Sequence[str], source: _Source[VelocitiesMap], importer: str
) -> tuple[Dataset, ImportReport]:
    table = source.table
    runs_ = [_velocity_run(path, source) for path in files]
    check_distinct([run.name for run in runs_], files)
    dataset = Dataset(
        name=f"velocities {', '.join(run.name for run in runs_)}",
        fish=source.fish,
        trials=assign_roles([(run.name, trial) for run in runs_ for trial in run.trials], held_out),
        noise=None if table.noise is None else readonly(table.noise),
    )
    return dataset, ImportReport(importer, tuple(run.report for run in runs_))


@dataclass(frozen=True, eq=False)
class _VelocityRun:
    name: str
    trials: tuple[Trial, ...]
    report: FileReport


def _velocity_run(path: Path, source: _Source[VelocitiesMap]) -> _VelocityRun:
    whole, columns = _velocity_trial(path, source)
    names = [name for name in columns.numbers if name != source.table.time]
    numbers = np.column_stack([columns.numbers[name] for name in names])
    complete: BoolArray = np.asarray(np.isfinite(numbers).all(axis=1))
    if complete.all():
        report = velocity_report(whole, source.table.noise, notes=columns.notes)
        return _VelocityRun(whole.name, (whole,), report)
    kept = _stretches(whole, complete, path)
    trials = tuple(
        _part(whole, slice(a, b), label)
        for label, (a, b) in zip(stretch_names(whole.name, len(kept)), kept, strict=True)
    )
    inside = np.zeros(len(complete), dtype=np.bool_)
    for a, b in kept:
        inside[a:b] = True
    last = len(inside) - 1
    cuts = tuple(
        Cut(float(whole.time[a]), float(whole.time[min(b, last)]), _why(complete[a:b], names, columns.numbers, a))
        for a, b in runs(~inside)
    )
    parts = replace(whole, time=readonly(whole.time[inside]), velocity=readonly(whole.velocity[inside]))
    report = velocity_report(parts, source.table.noise, notes=columns.notes)
    report = replace(
        report,
        trials=tuple(trial.name for trial in trials),
        frames=len(inside),
        usable=int(complete.sum()),
        cuts=cuts,
    )
    return _VelocityRun(whole.name, trials, report)


def _stretches(trial: Trial, complete: BoolArray, path: Path) -> list[tuple[int, int]]:
    """Return the stretches of complete rows that are long enough for a trial."""
    if complete.sum() < _FEWEST_VELOCITIES:
        raise InputError(
            f"{path}: has {complete.sum()} complete rows, expected {_FEWEST_VELOCITIES} or more; record longer"
        )
    check_length(trial.time[complete], path)
    beat, periodic = beat_frequency(trial.time[complete], trial.velocity[complete, 2])
    seconds = BEATS / beat if periodic else SECONDS
    fewest = max(int(np.ceil(seconds / float(np.median(np.diff(trial.time))))), _FEWEST_VELOCITIES)
    kept = [(a, b) for a, b in runs(complete) if b - a >= fewest]
    if not kept:
        raise InputError(
            f"{path}: the longest stretch without a gap has {longest(runs(complete))} rows, expected {fewest} or more "
            f"({seconds:.3g} s); record longer, or leave this file out"
        )
    return kept


def _part(trial: Trial, rows: slice, name: str) -> Trial:
    """Return some rows of a trial as one of its own; a joint law keeps the clock of the file."""
    begin = 0.0 if trial.wave is not None else trial.time[rows.start]
    angle = trial.joint_angle
    return replace(
        trial,
        name=name,
        time=readonly(trial.time[rows] - begin),
        velocity=readonly(trial.velocity[rows]),
        joint_angle=None if angle is None else readonly(angle[rows]),
    )


def _why(complete: BoolArray, names: Sequence[str], numbers: Mapping[str, FloatArray], start: int) -> str:
    rows = slice(start, start + len(complete))
    lost = [name for name in names if not np.isfinite(numbers[name][rows]).all()]
    return f"{', '.join(lost)} lost" if not complete.any() else f"{', '.join(lost)} lost, or too short a stretch"


def _velocity_trial(path: Path, source: _Source[VelocitiesMap]) -> tuple[Trial, Columns]:
    table = source.table
    names = (table.surge, table.sway, table.yaw_rate, *angle_columns(table))
    columns = source.read(path, table.time, names)
    numbers = columns.numbers
    _check_rows(numbers, table.time, path, _FEWEST_VELOCITIES)
    for name in names:
        lost = np.flatnonzero(~np.isfinite(numbers[name]))
        if lost.size and not columns.lossy:
            raise InputError(
                f"{path}: row {int(lost[0]) + 2}, column '{name}': missing, expected a finite number; correct it or "
                "cut the track there"
            )
    length, angle = LENGTHS[table.length_unit], ANGLES[table.angle_unit]
    surge = numbers[table.surge] * (length if table.surge_to == "front" else -length)
    sway = numbers[table.sway] * (length if table.sway_to == "port" else -length)
    turn = numbers[table.yaw_rate] * (angle if table.turn_to == "port" else -angle)
    time = numbers[table.time] * TIMES[table.time_unit]
    if not np.all(np.diff(time) > 0.0):
        row = int(np.flatnonzero(np.diff(time) <= 0.0)[0]) + 3
        raise InputError(f"{path}: row {row}, column '{table.time}': not after the row before; sort the rows by time")
    check_length(time, path)
    trial = Trial(
        name=path.stem.removeprefix(table.prefix),
        role=None,
        time=readonly(time),
        velocity=readonly(np.column_stack([surge, sway + table.behind_nose * turn, turn])),
        joint_angle=measured_angles(table, numbers, source.fish, source.file),
        wave=wave_drive(table, source.fish, source.file, path),
        source=path,
        **driven(table),
    )
    return trial, columns


def velocity_report(
    trial: Trial,
    noise: tuple[float, float, float] | None = None,
    beat: float | None = None,
    notes: tuple[str, ...] = (),
) -> FileReport:
    """Return the report of a file of velocities that were all taken as they are.

    Args:
        trial: made of it.
        noise: sigma of the channels that is stated.
        beat: frequency that was read from it [Hz].
        notes: what a reader should know besides.
    """
    assert trial.source is not None  # noqa: S101 - set in _trial
    samples = len(trial.time)
    return FileReport(
        path=trial.source,
        trials=(trial.name,),
        frames=samples,
        usable=samples,
        kept=samples,
        beat=beat,
        speed=float(trial.velocity[:, 0].mean()),
        noise=noise,
        notes=notes if noise is not None else (*notes, "noise not stated: estimated from the fit"),
    )
