"""Importers of tables of poses or velocities, in the units and axes of the laboratory.

Poses (time, x, y and yaw of a point of the head) become sensors of the place and of the heading, with the samples as
they are; velocities are taken as they are, too.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from mjfish.data import Dataset, Trial
from mjfish.data.columns import check_increasing
from mjfish.data.importers.mapping import (
    ANGLES,
    LENGTHS,
    TIMES,
    JointColumns,
    PosesMap,
    VelocitiesMap,
    joint_angle_remarks,
    measured_angles,
    read_mapping,
    wave_drive,
)
from mjfish.data.importers.recognition import KEYS
from mjfish.data.importers.smoothing import FASTEST, SLOWEST, beat_frequency
from mjfish.data.importers.trials import (
    BEATS,
    SECONDS,
    Cut,
    FileReport,
    ImportReport,
    Run,
    assembled,
    runs,
    stretch_names,
)
from mjfish.data.sensor import FEWEST, Kind, Sensor, cleaned, within
from mjfish.data.tables import read_sheet
from mjfish.data.validation import count_beats, longest_gap
from mjfish.errors import InputError
from mjfish.fish import Fish
from mjfish.fish.frames import CHANNELS
from mjfish.numerics.arrays import BoolArray, FloatArray, readonly
from mjfish.numerics.block_angular import IntArray

#: Fewest rows of a file, by the kind of its mapping.
_FEWEST_ROWS = {"poses": 20, "velocities": 7}
#: Sensors of a pose, and their columns.
_SEEN: tuple[tuple[Kind, slice], ...] = (("position", slice(0, 2)), ("heading", slice(2, 3)))


@dataclass(frozen=True, eq=False)
class Columns:
    """Columns (n,) of a recorded file by name, that of the time in s, and what a reader should know of them.

    `first_line`: of the numbers in the file, see `row_name`.
    """

    numbers: Mapping[str, FloatArray]
    notes: tuple[str, ...] = ()
    first_line: int | None = None


def read_csv(path: Path, table: PosesMap | VelocitiesMap, names: Sequence[str]) -> Columns:
    """Return the column of the time [s], and others, of a CSV file with a header."""
    sheet = read_sheet(path, table)
    time, dates = sheet.seconds(table.time, TIMES[table.time_unit])
    if dates and not all(law.free for law in (*table.waves.values(), table.wave) if law is not None):
        raise InputError(
            f"{path}: column '{table.time}': {dates}, expected the clock of the drive, 0 where it starts; subtract its "
            "start, or say free = true in the mapping file (leave out --synchronised)"
        )
    # Places and headings may be absent, velocities not.
    numbers = {table.time: time, **{name: sheet.numbers(name, missing=isinstance(table, PosesMap)) for name in names}}
    return Columns(numbers, tuple(filter(None, (*sheet.layout.notes, dates))), first_line=sheet.layout.first_line)


#: Returns the column of the time [s] of a file, and others, by name; cells may be missing (NaN) but those of the time.
Read = Callable[[Path, PosesMap | VelocitiesMap, Sequence[str]], Columns]


def import_tables(
    files: Sequence[Path],
    held_out: Sequence[str] = (),
    mapping: Path | None = None,
    *,
    model: type[PosesMap] | type[VelocitiesMap],
    importer: str,
    read: Read = read_csv,
) -> tuple[Dataset, ImportReport]:
    """Turn tables of poses or of velocities into a dataset; joint angles are columns of the table, or a wave.

    Of poses, every run has a sensor ``position`` and a sensor ``heading``, with raw samples, and no velocities. Where
    the mapping does not say where the tracked point is, it is somewhere on the head: `Dataset.known` has the offset.
    Velocities of a point d behind the nose are carried to the nose, sway_nose = sway + d yaw_rate. Nothing is smoothed.

    Args:
        files: one a run; cells of poses may be empty where nothing was tracked.
        held_out: names of trials or runs not to be fitted.
        mapping: the mapping file.
        model: what it must hold.
        importer: for the report.
        read: reads a file.

    Raises:
        MjfishError: the mapping or a file is not what it must be, or no stretch is long enough.
    """
    table, fish, place = read_mapping(mapping, model, importer)
    return import_mapped(files, held_out, table, fish, place, importer, read)


def import_mapped(
    files: Sequence[Path],
    held_out: Sequence[str],
    table: PosesMap | VelocitiesMap,
    fish: Fish,
    place: Path,
    importer: str | None = None,
    read: Read = read_csv,
) -> tuple[Dataset, ImportReport]:
    """Turn tables into a dataset, as `import_tables` does, by a mapping that may be in no file.

    Args:
        files: one a run.
        held_out: names of trials or runs not to be fitted.
        table: what columns and units mean; its `fish` is not read.
        fish: that swam.
        place: of the mapping, for messages.
        importer: for the report; left out: the kind of the mapping.
        read: reads a file.

    Raises:
        MjfishError: as of `import_tables`.
    """
    if isinstance(table, PosesMap):
        behind, head = table.behind_nose, fish.links[0].length
        if behind is not None and not 0.0 <= behind <= head:
            raise InputError(
                f"{place}: behind_nose: {behind:g} m, expected a point of the head, 0 to {head:g} m; leave it out "
                "to have it fitted, or give the track of a point of the head"
            )
    found = [_run(path, table, fish, place, read) for path in files]
    dataset, report = assembled(found, fish, held_out, importer or table.kind, table.kind)
    stated = isinstance(table, VelocitiesMap) and table.noise
    return replace(dataset, noise=readonly(stated) if stated else None), report


def _run(path: Path, table: PosesMap | VelocitiesMap, fish: Fish, mapping: Path, read: Read) -> Run:
    """Return the trials of a file, and what was done to it."""
    joints = table.joints or JointColumns(columns=())
    names = (*(getattr(table, key) for key in KEYS[table.kind][1:]), *joints.columns)
    columns = read(path, table, names)
    frames, fewest = len(columns.numbers[table.time]), _FEWEST_ROWS[table.kind]
    if frames < fewest:
        raise InputError(f"{path}: has {frames} rows, expected one a frame and {fewest} or more; give a longer track")
    numbers, notes = _each_once(columns, table, names, path)
    time = readonly(numbers[table.time])
    check_length(time, path)
    velocity, sensors = _measured(table, time, np.column_stack([numbers[name] for name in names[:3]]), path)
    whole = Trial(
        name=path.stem.removeprefix(table.prefix),
        role=None,
        time=time,
        velocity=readonly(velocity),
        joint_angle=measured_angles(table, numbers, fish, mapping),
        wave=wave_drive(table, fish, mapping, path),
        source=path,
        sensors=sensors,
        commanded=joints.are == "commanded",
        hold=joints.hold,
        from_rest=table.from_rest,
    )
    complete: BoolArray = np.asarray(np.isfinite(np.column_stack([numbers[name] for name in names])).all(axis=1))
    parts, beat = _stretches_of_joints(whole) if sensors else (_stretches(whole, complete, path), None)
    labels = stretch_names(whole.name, len(parts))
    trials = tuple(_part(whole, rows, label) for rows, label in zip(parts, labels, strict=True))
    speed = noise = None
    if isinstance(table, VelocitiesMap):
        trials = (whole,) if complete.all() else trials
        speed, noise = float(np.concatenate([trial.velocity[:, 0] for trial in trials]).mean()), table.noise
        notes += () if noise else ("noise not stated: estimated from the fit",)
    else:
        notes += tuple(remark for sensor in sensors for remark in sensor.remarks)
        notes += (f"a sample every {1e3 * whole.step:.4g} ms", *joint_angle_remarks(table, whole))
    report = FileReport(
        path=path,
        trials=tuple(trial.name for trial in trials),
        frames=frames,
        usable=int(complete.sum()),
        kept=sum(len(trial.sensors[0].time if trial.sensors else trial.time) for trial in trials),
        beat=beat,
        speed=speed,
        noise=noise,
        cuts=tuple(_cuts(time, parts, names[3:] if sensors else names, numbers)),
        notes=notes,
    )
    return Run(whole.name, trials, report)


def _measured(
    table: PosesMap | VelocitiesMap, time: FloatArray, point: FloatArray, path: Path
) -> tuple[FloatArray, tuple[Sensor, ...]]:
    """Return velocities (n, 3) of the nose, and sensors, of columns (n, 3) of a point in its own units and axes.

    Of poses there are sensors alone, of x, y [m], yaw [rad] of the point, y up and yaw anticlockwise.
    """
    length, angle = LENGTHS[table.length_unit], ANGLES[table.angle_unit]
    if isinstance(table, VelocitiesMap):
        positive = np.array([table.surge_to == "front", table.sway_to == "port", table.turn_to == "port"])
        velocity = point * np.where(positive, 1.0, -1.0) * [length, length, angle]
        velocity[:, 1] += table.behind_nose * velocity[:, 2]
        return velocity, ()
    positive = np.array([True, table.axes == "y_up", table.port_positive])
    pose = (point - [0.0, 0.0, table.yaw_zero]) * np.where(positive, 1.0, -1.0) * [length, length, angle]
    place, known = table.behind_nose or 0.0, table.behind_nose is not None
    sensors = (Sensor(kind, kind, time, pose[:, at], station=place, placed=known, source=path) for kind, at in _SEEN)
    return np.full((len(time), len(CHANNELS)), np.nan), tuple(cleaned(sensor, path) for sensor in sensors)


def _each_once(
    columns: Columns, table: PosesMap | VelocitiesMap, names: Sequence[str], path: Path
) -> tuple[Mapping[str, FloatArray], tuple[str, ...]]:
    """Return columns whose times increase, and notes; rows of poses that repeat the one before are left out."""
    numbers, notes = columns.numbers, columns.notes
    if isinstance(table, VelocitiesMap):
        check_increasing(numbers[table.time], path, columns.first_line, table.time)
        return numbers, notes
    for name in names:
        if not np.isfinite(numbers[name]).any():
            raise InputError(f"{path}: column '{name}' has no number, expected what was tracked; name another column")
    rows = np.column_stack([*numbers.values()])
    same = np.all((rows[1:] == rows[:-1]) | np.isnan(rows[1:]) & np.isnan(rows[:-1]), axis=1)
    check_increasing(numbers[table.time], path, columns.first_line, table.time, repeated=np.asarray(same))
    notes += (f"{int(same.sum())} repeated rows left out",) if same.any() else ()
    return {name: values[np.append(True, ~same)] for name, values in numbers.items()}, notes


def _stretches_of_joints(whole: Trial) -> tuple[list[IntArray], float | None]:
    """Return the rows of each stretch of a run in which the joints are known, and the beat [Hz].

    A law knows them from its ramp on. Recorded ones are known in rows that have them all, and in short gaps between.
    """
    time, angle = whole.time, np.asarray(whole.joint_angle)  # a mapping has joints or a law
    if whole.wave is not None:
        return [np.flatnonzero(time >= (0.0 if whole.wave.ramp > 0.0 else -np.inf))], whole.wave.frequency
    found = _joined(time, angle, np.flatnonzero(np.isfinite(angle).all(axis=1)))
    kept = [rows for rows in found if len(found) == 1 or _long_enough(whole, rows)]
    if not kept:
        seconds = max((float(np.ptp(time[rows])) for rows in found), default=0.0)
        raise InputError(
            f"{whole.source}: the longest stretch without a gap in the joint angles lasts {seconds:.3g} s, expected "
            f"{BEATS:g} beats, with poses; record longer, or leave this file out"
        )
    longest_ = max(kept, key=len)
    beats = count_beats(time[longest_], angle[longest_])
    return kept, None if beats is None else beats / float(np.ptp(time[longest_]))


def _joined(time: FloatArray, angle: FloatArray, rows: IntArray) -> list[IntArray]:
    """Return the stretches of rows whose joint angles (n, joints) a spline may join."""
    if len(rows) < FEWEST:
        return []
    apart = np.flatnonzero(np.diff(time[rows]) > longest_gap(time[rows], angle[rows])) + 1
    return [more for part in np.split(rows, apart) for more in _joined(time, angle, part)] if apart.size else [rows]


def _long_enough(whole: Trial, rows: IntArray) -> bool:
    """Whether a stretch lasts long enough for a trial, and has samples of every sensor."""
    first, last = whole.time[rows[[0, -1]]]
    beats = count_beats(whole.time[rows], np.asarray(whole.joint_angle)[rows])
    seen = [np.count_nonzero((s.time >= first) & (s.time <= last)) >= FEWEST for s in whole.sensors]
    return all(seen) and (last - first >= SECONDS if beats is None else beats >= BEATS)


def check_length(time: FloatArray, path: Path) -> None:
    """Refuse a record whose times cannot show a beat: too short, or with too few rows for its length."""
    rows, seconds = len(time), float(np.ptp(time))
    if rows < 2.0 * SLOWEST * seconds or seconds * FASTEST <= 1.0:
        raise InputError(
            f"{path}: {rows} rows over {seconds:g} s, expected those of a fish that beats at {SLOWEST:g} to "
            f"{FASTEST:g} Hz; correct the times, or their unit (--time-unit, time_unit in a mapping file)"
        )


def _stretches(trial: Trial, complete: BoolArray, path: Path) -> list[IntArray]:
    """Return the rows of each stretch of complete ones that is long enough for a trial; all where all are complete."""
    if complete.all():
        return [np.arange(len(complete))]
    least = _FEWEST_ROWS["velocities"]
    if complete.sum() < least:
        raise InputError(f"{path}: has {complete.sum()} complete rows, expected {least} or more; record longer")
    check_length(trial.time[complete], path)
    beat, periodic = beat_frequency(trial.time[complete], trial.velocity[complete, 2])
    seconds = BEATS / beat if periodic else SECONDS
    fewest = max(int(np.ceil(seconds / trial.step)), least)
    kept = [np.arange(a, b) for a, b in runs(complete) if b - a >= fewest]
    if not kept:
        longest = max(b - a for a, b in runs(complete))
        raise InputError(
            f"{path}: the longest stretch without a gap has {longest} rows, expected {fewest} or more "
            f"({seconds:.3g} s); record longer, or leave this file out"
        )
    return kept


def _part(trial: Trial, rows: IntArray, name: str) -> Trial:
    """Return some rows (k,) of a trial as one of its own; a joint law keeps the clock of the file."""
    time, angle = trial.time[rows], trial.joint_angle
    begin = 0.0 if trial.wave is not None else float(time[0])
    sensors = (within(sensor, float(time[0]), float(time[-1]), str(trial.source)) for sensor in trial.sensors)
    return replace(
        trial,
        name=name,
        time=readonly(time - begin),
        velocity=readonly(trial.velocity[rows]),
        joint_angle=None if angle is None else readonly(angle[rows]),
        sensors=tuple(replace(sensor, time=sensor.time - begin) for sensor in sensors),
        from_rest=trial.from_rest and int(rows[0]) == 0,
    )


def _cuts(
    time: FloatArray, kept: Sequence[IntArray], names: Sequence[str], numbers: Mapping[str, FloatArray]
) -> Iterator[Cut]:
    """Yield what lies outside of the stretches that were kept, and which of the columns were lost there."""
    lost = np.ones(len(time), dtype=np.bool_)
    for rows in kept:
        lost[rows[0] : rows[-1] + 1] = False
    for a, b in runs(lost):
        missing = {name: np.isnan(numbers[name][a:b]) for name in names}
        why = f"{', '.join(name for name, absent in missing.items() if absent.any())} lost"
        why += "" if np.any([*missing.values()], axis=0).all() else ", or too short a stretch"
        yield Cut(float(time[a]), float(time[min(b, len(time) - 1)]), why if names else "before the drive starts")
