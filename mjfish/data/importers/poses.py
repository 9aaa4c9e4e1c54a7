"""Importer of pose tables: time, x, y and yaw of a point of the head, smoothed as marker tracks are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mjfish.arrays import BoolArray, FloatArray, readonly
from mjfish.data import Dataset
from mjfish.data.importers import driven, roles, rows
from mjfish.data.importers.mapping import ANGLES, LENGTHS, TIMES, PosesMap, fish_of, read
from mjfish.data.importers.marked import HARMONICS
from mjfish.data.importers.recording import Recording, record, with_noise
from mjfish.data.importers.report import FileReport, ImportReport
from mjfish.data.importers.smooth import batch, beat
from mjfish.data.importers.smooth.basis import Basis
from mjfish.data.importers.smooth.batch import Fit
from mjfish.data.importers.smooth.observation import Itself
from mjfish.errors import InputError
from mjfish.fish import Fish

_FEWEST = 20
#: Noise to begin with, of lengths [m] and angles [rad].
_SIGMA = 3e-3


@dataclass(frozen=True, eq=False)
class _Imported:
    name: str
    recording: Recording
    report: FileReport


def import_files(
    files: Sequence[Path], held_out: Sequence[str] = (), mapping: Path | None = None
) -> tuple[Dataset, ImportReport]:
    """Turn pose tables into a dataset; joint angles are columns of the table, or a wave.

    Args:
        files: one a run; cells may be empty where nothing was tracked.
        held_out: names of trials or runs not to be fitted.
        mapping: the mapping file, of ``kind = "poses"``.

    Raises:
        MjfishError: the mapping or a file is not what it must be, or no stretch is long enough.
    """
    table = read(mapping, PosesMap, "poses")
    assert mapping is not None  # noqa: S101 - read refuses None
    fish = fish_of(table, mapping)
    imported = [_import(path, table, fish, mapping) for path in files]
    roles.distinct([run.name for run in imported], files)
    pairs = [(run.name, trial) for run in imported for trial in run.recording.trials]
    dataset = Dataset(
        name=f"poses {', '.join(run.name for run in imported)}",
        fish=fish,
        trials=roles.assign(pairs, held_out),
    )
    dataset = with_noise(dataset, [run.recording for run in imported])
    return dataset, ImportReport("poses", tuple(run.report for run in imported))


def _import(path: Path, table: PosesMap, fish: Fish, mapping: Path) -> _Imported:
    names = [table.time, table.x, table.y, table.yaw, *driven.columns(table)]
    numbers = rows.read(path, names, header=True, fewest=_FEWEST, missing=True)
    time = _time(numbers[table.time] * TIMES[table.time_unit], path)
    pose = _at_nose(table, np.column_stack([numbers[name] for name in (table.x, table.y, table.yaw)]))
    joints = driven.angles(table, numbers, fish, mapping)
    measured = pose if joints is None else np.column_stack([pose, joints])
    count = 0 if joints is None else joints.shape[1]
    fit = _fit(time, measured)
    seen: BoolArray = np.asarray(np.isfinite(measured).all(axis=1))
    name = path.stem.removeprefix(table.prefix)
    recording = record(fit, count, seen, {int(frame): "pose" for frame in np.flatnonzero(~seen)}, name, path)
    law = driven.wave(table, fish, mapping)
    recording = recording.driven_by(law)
    report = FileReport(
        path=path,
        trials=tuple(trial.name for trial in recording.trials),
        frames=len(time),
        usable=int(seen.sum()),
        kept=sum(len(trial.time) for trial in recording.trials),
        beat=fit.beat,
        speed=float(np.concatenate([trial.velocity[:, 0] for trial in recording.trials]).mean()),
        noise=(float(recording.noise[0]), float(recording.noise[1]), float(recording.noise[2])),
        alike=recording.alike,
        joint_noise=recording.joint_noise,
        cuts=recording.cuts,
        notes=(f"{recording.bridged} frames without a pose bridged",) if recording.bridged else (),
    )
    return _Imported(name, recording, report)


def _time(time: FloatArray, path: Path) -> FloatArray:
    """Refuse times that do not increase."""
    wrong = np.flatnonzero(~(np.diff(time) > 0.0))
    if wrong.size:
        raise InputError(
            f"{path}: row {int(wrong[0]) + 3}: its time is not after that of the row before; sort the rows"
        )
    return readonly(time)


def _at_nose(table: PosesMap, raw: FloatArray) -> FloatArray:
    """Return x, y [m], yaw [rad] of the nose (n, 3), y up, from those of the tracked point in its own axes."""
    length, angle = LENGTHS[table.length_unit], ANGLES[table.angle_unit]
    mirror = 1.0 if table.axes == "y_up" else -1.0
    yaw = mirror * angle * (raw[:, 2] - table.yaw_zero)
    known = np.isfinite(yaw)
    yaw[known] = np.unwrap(yaw[known])
    x = length * raw[:, 0] + table.behind_nose * np.cos(yaw)
    y = mirror * length * raw[:, 1] + table.behind_nose * np.sin(yaw)
    return np.column_stack([x, y, yaw])


def _fit(time: FloatArray, measured: FloatArray) -> Fit:
    rate = np.arange(len(time))
    start = np.column_stack(
        [np.interp(rate, rate[np.isfinite(own)], own[np.isfinite(own)]) for own in np.transpose(measured)]
    )
    hertz, periodic = beat.frequency(time, start[:, 2])
    first = hertz if periodic else None
    return batch.fit(Itself(measured[:, :, None]), Basis.of(time, first, HARMONICS), first, start, _SIGMA)
