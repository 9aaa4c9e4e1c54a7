"""Importer of velocity tables: time, surge, sway and yaw rate, in the units and axes of the laboratory."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mjfish.arrays import readonly
from mjfish.data import Dataset, Trial
from mjfish.data.importers import driven, roles, rows
from mjfish.data.importers.mapping import ANGLES, LENGTHS, TIMES, VelocitiesMap, fish_of, read
from mjfish.data.importers.report import FileReport, ImportReport
from mjfish.errors import InputError
from mjfish.fish import Fish

_FEWEST = 7


@dataclass(frozen=True, eq=False)
class _Place:
    """The mapping, the fish that it names, and its file."""

    table: VelocitiesMap
    fish: Fish
    file: Path


def import_files(
    files: Sequence[Path], held_out: Sequence[str] = (), mapping: Path | None = None
) -> tuple[Dataset, ImportReport]:
    """Turn velocity tables into a dataset.

    Velocities of a point d behind the nose are carried to the nose, sway_nose = sway + d yaw_rate. Nothing is smoothed.

    Args:
        files: one a run.
        held_out: names of trials not to be fitted.
        mapping: the mapping file, of ``kind = "velocities"``.

    Raises:
        MjfishError: the mapping or a file is not what it must be.
    """
    table = read(mapping, VelocitiesMap, "velocities")
    assert mapping is not None  # noqa: S101 - read refuses None
    place = _Place(table, fish_of(table, mapping), mapping)
    trials = [_trial(path, place) for path in files]
    roles.distinct([trial.name for trial in trials], files)
    dataset = Dataset(
        name=f"velocities {', '.join(trial.name for trial in trials)}",
        fish=place.fish,
        trials=roles.assign([(trial.name, trial) for trial in trials], held_out),
        noise=None if table.noise is None else readonly(table.noise),
    )
    return dataset, ImportReport("velocities", tuple(_report(trial, table) for trial in trials))


def _trial(path: Path, place: _Place) -> Trial:
    table = place.table
    names = (table.time, table.surge, table.sway, table.yaw_rate)
    joints = driven.columns(table)
    numbers = rows.read(path, [*names, *joints], header=True, fewest=_FEWEST)
    length, angle = LENGTHS[table.length_unit], ANGLES[table.angle_unit]
    surge = numbers[table.surge] * (length if table.surge_to == "front" else -length)
    sway = numbers[table.sway] * (length if table.sway_to == "port" else -length)
    turn = numbers[table.yaw_rate] * (angle if table.turn_to == "port" else -angle)
    time = numbers[table.time] * TIMES[table.time_unit]
    if not np.all(np.diff(time) > 0.0):
        row = int(np.flatnonzero(np.diff(time) <= 0.0)[0]) + 3
        raise InputError(f"{path}: row {row}, column '{table.time}': not after the row before; sort the rows by time")
    return Trial(
        name=path.stem.removeprefix(table.prefix),
        role=None,
        time=readonly(time),
        velocity=readonly(np.column_stack([surge, sway + table.behind_nose * turn, turn])),
        joint_angle=driven.angles(table, numbers, place.fish, place.file),
        wave=driven.wave(table, place.fish, place.file),
        source=path,
    )


def _report(trial: Trial, table: VelocitiesMap) -> FileReport:
    assert trial.source is not None  # noqa: S101 - set in _trial
    samples = len(trial.time)
    return FileReport(
        path=trial.source,
        trials=(trial.name,),
        frames=samples,
        usable=samples,
        kept=samples,
        beat=None,
        speed=float(trial.velocity[:, 0].mean()),
        noise=table.noise,
        notes=() if table.noise is not None else ("noise not stated: estimated from the fit",),
    )
