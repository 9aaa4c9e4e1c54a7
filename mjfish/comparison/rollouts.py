"""Files of simulated swimming: which belongs to which trial, and what is in it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline

from mjfish.data import Trial, columns, read_table
from mjfish.data.cells import check_increasing
from mjfish.data.tables import SUFFIXES
from mjfish.errors import InputError
from mjfish.files.writing import check_suffix
from mjfish.fish.frames import CHANNELS
from mjfish.numerics.arrays import BoolArray, FloatArray

#: A file of this name, as `mjfish simulate` writes it, is called by its folder.
_ANONYMOUS = "rollout"
#: A sample this close to an end of a rollout is at that end [s]: rounding of times.
_ROUNDING = 1e-6


@dataclass(frozen=True, eq=False)
class SimulatedRun:
    """One file of simulated velocities.

    Attributes:
        source: the file.
        time: (n,) increasing [s].
        velocity: (n, k) of its channels.
        channels: those of surge, sway, yaw_rate that are in the file.
    """

    source: Path
    time: FloatArray
    velocity: FloatArray
    channels: tuple[str, ...]

    @cached_property
    def _curves(self) -> CubicSpline:
        return CubicSpline(self.time, self.velocity)

    def at(self, time: FloatArray) -> FloatArray:
        """Return the velocities (m, 3) at times (m,), NaN where the file has none; a cubic spline in between.

        Of the pike at 100 Hz that leaves 2e-4 of the range at most, and local cubics, such as Akima's, ten times as
        much. Where the drive steps a spline rings for some samples.
        """
        inside = np.where(self.covers(time), np.clip(time, self.time[0], self.time[-1]), self.time[0])
        found = np.full((len(time), len(CHANNELS)), np.nan)
        found[:, [CHANNELS.index(name) for name in self.channels]] = self._curves(inside)
        found[~self.covers(time)] = np.nan
        return found

    def covers(self, time: FloatArray) -> BoolArray:
        """Return which of the times (m,) the run goes over."""
        return np.asarray((time >= self.time[0] - _ROUNDING) & (time <= self.time[-1] + _ROUNDING))


def read(path: Path) -> SimulatedRun:
    """Read a rollout: ``time [s]`` and one or more of the channels; other known columns are left alone.

    Raises:
        InputError: the file is damaged or lacks what is needed; see `mjfish.data.read_table`.
    """
    table = read_table(path)
    found = ", ".join(map(columns.header, table))
    if "time" not in table:
        raise InputError(f"{path}: column '{columns.header('time')}' is missing; found {found}; add it")
    channels = tuple(name for name in CHANNELS if name in table)
    if not channels:
        raise InputError(
            f"{path}: has no velocity, expected one or more of {', '.join(map(columns.header, CHANNELS))}; found "
            f"{found}; add them"
        )
    if len(table["time"]) < 2:
        raise InputError(f"{path}: has 1 row, expected a run over the time of its trial; simulate longer")
    check_increasing(table["time"], path)
    return SimulatedRun(path, table["time"], np.stack([table[name] for name in channels], axis=1), channels)


def assign(against: Sequence[Path], trials: Sequence[Trial]) -> tuple[dict[str, Path], tuple[Path, ...]]:
    """Find the file of every trial by its name: ``v1.csv``, ``v1.parquet`` or ``v1/rollout.csv``.

    Args:
        against: folders that hold such files, and files; a single file may have any name where there is a single trial.
        trials: that were measured.

    Returns:
        Files by name of the trial, and those in folders that belong to none.

    Raises:
        InputError: nothing is found, two files for one trial, a file that belongs to none, or the measurement itself.
    """
    names = {trial.name.casefold(): trial for trial in trials}
    found: dict[str, Path] = {}
    unused: list[Path] = []
    for path in against:
        inside = _files(path)
        for file in inside:
            trial = names.get(_name(file).casefold())
            if trial is None and len(trials) == len(against) == len(inside) == 1:
                trial = trials[0]
            if trial is None and file == path:
                raise InputError(f"{file}: no trial is called '{_name(file)}'; {_expected(trials)}; rename the file")
            if trial is None:
                unused.append(file)
                continue
            _check_own(file, trial, found.get(trial.name))
            found[trial.name] = file
    if not found:
        listed = (
            ", ".join(sorted(f.name if f.stem != _ANONYMOUS else f"{_name(f)}/{f.name}" for f in unused)[:5])
            or "no tables"
        )
        where = ", ".join(map(str, against))
        raise InputError(f"{where}: no rollout of any trial; found {listed}; {_expected(trials)}")
    return found, tuple(unused)


def _files(path: Path) -> list[Path]:
    """Return the tables that a path stands for: itself, or those in a folder, and the rollouts in its folders."""
    if path.is_dir():
        here = [file for file in sorted(path.iterdir()) if file.suffix.lower() in SUFFIXES and file.is_file()]
        return here + sorted(path.glob(f"*/{_ANONYMOUS}.csv")) + sorted(path.glob(f"*/{_ANONYMOUS}.parquet"))
    if not path.exists():
        raise InputError(f"{path}: no such file or folder; name a folder of rollouts, or the files")
    check_suffix(path, *SUFFIXES)
    return [path]


def _name(file: Path) -> str:
    return file.resolve().parent.name if file.stem == _ANONYMOUS else file.stem


def _expected(trials: Sequence[Trial]) -> str:
    listed = ", ".join(f"{trial.name}.csv" for trial in trials[:5]) + (", ..." if len(trials) > 5 else "")
    return f"expected files named as the trials: {listed}, or folders so named with a {_ANONYMOUS}.csv"


def _check_own(file: Path, trial: Trial, other: Path | None) -> None:
    if other is not None:
        raise InputError(
            f"{file}: '{other}' is a rollout of the trial '{trial.name}' already; leave out one of the two"
        )
    if trial.source is not None and trial.source.exists() and trial.source.samefile(file):
        raise InputError(f"{file}: is the measurement of the trial '{trial.name}'; name the folder of the rollouts")
