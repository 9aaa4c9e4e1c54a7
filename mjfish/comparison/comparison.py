"""Measured trials against rollouts of anyone's simulation: scores, best shifts in time, and what is not covered."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import minimize_scalar

from mjfish.data import Dataset, Role, Trial, columns, read_table
from mjfish.data.tables import SUFFIXES
from mjfish.errors import InputError
from mjfish.estimation.problem import Problem
from mjfish.estimation.residual import Agreement, Residual, agreement
from mjfish.files.plain_data import fields_of
from mjfish.files.result import Result
from mjfish.files.writing import check_suffix
from mjfish.fish.frames import CHANNELS
from mjfish.model import Model
from mjfish.noise import Noise
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
        found = np.full((len(time), len(CHANNELS)), np.nan)
        found[:, [CHANNELS.index(name) for name in self.channels]] = self._curves(
            np.clip(time, self.time[0], self.time[-1])
        )
        found[~self.covers(time)] = np.nan
        return found

    def covers(self, time: FloatArray) -> BoolArray:
        """Return which of the times (m,) the run goes over."""
        return np.asarray((time >= self.time[0] - _ROUNDING) & (time <= self.time[-1] + _ROUNDING))


def read_rollout(path: Path) -> SimulatedRun:
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
    columns.check_increasing(table["time"], path)
    return SimulatedRun(path, table["time"], np.stack([table[name] for name in channels], axis=1), channels)


def assign_rollouts(against: Sequence[Path], trials: Sequence[Trial]) -> tuple[dict[str, Path], tuple[Path, ...]]:
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
            if trial.name in found:
                raise InputError(
                    f"{file}: '{found[trial.name]}' is a rollout of the trial '{trial.name}' already; leave out one of "
                    "the two"
                )
            if trial.source is not None and trial.source.exists() and trial.source.samefile(file):
                raise InputError(
                    f"{file}: is the measurement of the trial '{trial.name}'; name the folder of the rollouts"
                )
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


#: Shifts are looked for up to here [s], but not beyond half a beat: there, the next beat would fit again.
LONGEST = 0.25
#: Nor beyond this share of the trial: the ends of what is shifted are not compared.
_SHARE = 0.1
_GRID = 0.0025


@dataclass(frozen=True)
class Shift:
    """What is measured at t agrees best with the rollout at t + `time`, as in the effect ``time_offset``.

    Attributes:
        time: [s].
        rmse: that is left then, over the samples that the shifted rollout covers; NaN of several channels together.
        nrmse: the same over the range of the measurement; of several channels the root of their mean square.
        at_limit: whether the best shift is the largest that was tried, so that a larger one may be better.
    """

    time: float
    rmse: float
    nrmse: float
    at_limit: bool


def reach(trial: Trial) -> float:
    """Return the largest shift [s] that is tried."""
    half_beats = [np.pi / segment.omega for segment in trial.drive]
    return float(min(LONGEST, _SHARE * (trial.time[-1] - trial.time[0]), *half_beats))


def best_shift(
    predict: Callable[[FloatArray], FloatArray],
    time: FloatArray,
    measured: FloatArray,
    span: FloatArray,
    longest: float,
) -> Shift | None:
    """Return the shift with the least sum over the channels of (RMSE / range)^2.

    Args:
        predict: times (m,) to velocities (m, k), NaN where there are none.
        time: (n,) of the samples [s].
        measured: (n, k).
        span: (k,) range of each channel.
        longest: shift that is tried [s].

    Returns:
        The shift; None where fewer than two samples are covered at every shift, or a channel has no range.
    """
    ends = np.all(np.isfinite(predict(time - longest)) & np.isfinite(predict(time + longest)), axis=1)
    if np.count_nonzero(ends) < 2 or not np.all(span > 0.0):
        return None

    def cost(shift: float) -> float:
        """Over the same samples for every shift: at one end a run may be harder to meet than at the other."""
        return float(np.sum(np.nanmean(((measured - predict(time + shift))[ends] / span) ** 2, axis=0)))

    grid = np.linspace(-longest, longest, 2 * int(np.ceil(longest / _GRID)) + 1)
    costs = [cost(float(shift)) for shift in grid]
    best = int(np.argmin(costs))
    around = (grid[max(best - 1, 0)], grid[min(best + 1, len(grid) - 1)])
    refined = minimize_scalar(cost, bounds=around, method="bounded", options={"xatol": 1e-6})
    shift = float(refined.x if refined.fun < costs[best] else grid[best])
    left = measured - predict(time + shift)
    rmse = np.sqrt(np.nanmean(left**2, axis=0))
    return Shift(
        time=shift,
        rmse=float(rmse[0]) if len(rmse) == 1 else float("nan"),
        nrmse=float(np.sqrt(np.mean((rmse / span) ** 2))),
        at_limit=best in (0, len(grid) - 1),
    )


#: Points that a beat needs so that a spline between them errs by 1e-3 of the range, root mean square.
_POINTS_A_BEAT = 12
#: Trials that a summary lists.
_LINES = 9


@dataclass(frozen=True)
class TrialComparison:
    """One trial against its rollout.

    Attributes:
        trial: its name.
        role: ``fit`` or ``held_out``.
        rollout: its file; None where there is none.
        status: ``covered``: the rollout goes over every sample that counts, ``partly``, or ``absent``.
        scores: of every channel in the file, whole and in parts, over the samples that are covered.
        shifts: by channel, and of all of them together by ``all``; without those that cannot be told.
        remarks: what a reader should know.
    """

    trial: str
    role: Role
    rollout: Path | None
    status: Literal["covered", "partly", "absent"]
    scores: tuple[Agreement, ...] = ()
    shifts: Mapping[str, Shift] = field(default_factory=dict)
    remarks: tuple[str, ...] = ()

    @property
    def channels(self) -> tuple[str, ...]:
        """Channels that were compared."""
        return tuple(score.channel for score in self.scores if score.part == "whole")

    @property
    def worst(self) -> float:
        """Largest nRMSE of a channel over the whole trial; NaN where one cannot be told, or there is no rollout."""
        return float(np.max([score.nrmse for score in self.scores if score.part == "whole"] or [np.nan]))


@dataclass(frozen=True)
class Comparison(Result):
    """Every trial of a dataset against its rollout.

    Attributes:
        dataset: its name.
        trials: in its order.
        unused: files that belong to no trial.
        bound: largest nRMSE that is good; None: any is.
    """

    dataset: str
    trials: tuple[TrialComparison, ...]
    unused: tuple[Path, ...]
    bound: float | None

    @property
    def failures(self) -> tuple[str, ...]:
        """Why the rollouts are not good, a line a trial; empty where they are."""
        lines = []
        for trial in self.trials:
            if trial.status != "covered":
                lines.append(trial.remarks[0])
            elif self.bound is not None and not trial.worst <= self.bound:
                lines.append(f"{trial.trial}: nRMSE {trial.worst:.4f} is beyond the bound {self.bound:g}")
        return tuple(lines)

    @property
    def passed(self) -> bool:
        """Whether every rollout is good."""
        return not self.failures

    def summary(self) -> str:
        """Return the worst nRMSE of each trial, at most ten lines."""
        lines = [
            f"{trial.trial}: nRMSE {trial.worst:.3g} at worst" if trial.channels else f"{trial.trial}: {trial.status}"
            for trial in self.trials
        ]
        if len(lines) > _LINES:
            lines = [*lines[: _LINES - 1], f"and {len(lines) - _LINES + 1} trials more"]
        good = "good" if self.passed else f"not good: {len(self.failures)} of {len(self.trials)}"
        return "\n".join([f"{self.dataset}: rollouts against measurements, {good}", *lines])

    def to_dict(self) -> dict[str, Any]:
        """Return the comparison as plain data, the content of its JSON file."""
        return {"schema": 1, "passed": self.passed, "failures": list(self.failures), **fields_of(self)}

    def rows(self) -> list[dict[str, Any]]:
        """Return a row a trial, channel and part for a table; shifts stand beside the whole trial."""
        rows = []
        for trial in self.trials:
            for score in trial.scores:
                shift = trial.shifts.get(score.channel) if score.part == "whole" else None
                row = {key: value for key, value in fields_of(score).items() if key != "horizon"}
                shifted = {"shift [s]": "time", "rmse_shifted": "rmse", "nrmse_shifted": "nrmse"}
                rows.append(row | {name: getattr(shift, of, None) for name, of in shifted.items()})
        return rows


def compare(dataset: Dataset, against: Sequence[str | Path], *, bound: float | None = None) -> Comparison:
    """Compare measured trials with rollouts of any simulation.

    Per trial and channel: RMSE, nRMSE = RMSE / (max - min of the measurement) ([Yu2016], below Table IV), fit in
    percent, and the shift in time at which the two agree best. Samples count as in a fit: those beside a step of the
    drive, and the ends where joint angles were measured, do not.

    Args:
        dataset: what was measured.
        against: CSV or Parquet files with a column ``time [s]`` and one or more of ``surge [m/s]``, ``sway [m/s]``,
            ``yaw_rate [rad/s]``, or folders of them. Files are named as the trials (``v1.csv``, ``v1/rollout.csv``);
            where there is a single trial and a single file, it may have any name.
        bound: largest nRMSE that is good; None: any is.

    Returns:
        The scores of every trial; `Comparison.passed` says whether all rollouts are good.

    Raises:
        InputError: a file is damaged, or belongs to no trial; the bound is no positive number.

    Example:
        >>> import mjfish
        >>> measured = mjfish.generate(mjfish.load_fish("pike"), ["v1"], duration=2.0, name="pool")
        >>> mjfish.simulate("pike", "v1", values={"c_d.tail": 3.0}, duration=2.0).write_table("v1.csv")
        >>> print(mjfish.compare(measured, ["v1.csv"], bound=0.01))
        pool: rollouts against measurements, not good: 1 of 1
        v1: nRMSE 0.0... at worst
    """
    if bound is not None and not 0.0 < bound < np.inf:
        raise InputError(f"the bound is {bound:g}, expected a finite nRMSE above 0, e.g. 0.1; correct it")
    found, unused = assign_rollouts([Path(path) for path in against], dataset.trials)
    runs = {name: read_rollout(path) for name, path in found.items()}
    held = {trial.name for trial in dataset.split()[1]}
    counted = Problem(Model(dataset.fish), dataset.trials, Noise.white(np.ones(3)))
    trials = []
    for index, trial in enumerate(dataset.trials):
        role: Role = "held_out" if trial.name in held else "fit"
        if trial.name not in runs:
            remark = f"{trial.name}: no rollout; expected a file {trial.name}.csv"
            trials.append(TrialComparison(trial.name, role, None, "absent", remarks=(remark,)))
        else:
            trials.append(_compared(trial, role, runs[trial.name], counted.mask(index)))
    return Comparison(dataset.name, tuple(trials), unused, bound)


def _compared(trial: Trial, role: Role, run: SimulatedRun, counted: BoolArray) -> TrialComparison:
    covered = counted & run.covers(trial.time)
    missed = int(np.count_nonzero(counted & ~covered))
    remarks = []
    if missed:
        remarks.append(
            f"{trial.name}: {run.source} runs from {run.time[0]:.4g} to {run.time[-1]:.4g} s and does not cover "
            f"{missed} of {np.count_nonzero(counted)} measured samples from {trial.time[0]:.4g} to "
            f"{trial.time[-1]:.4g} s; simulate all of it"
        )
    absent = [channel for channel in CHANNELS if channel not in run.channels]
    if absent:
        remarks.append(f"{trial.name}: {run.source} has no {' and no '.join(absent)}; not compared")
    remarks += _coarse(trial, run)
    residual = Residual(trial, role, run.at(trial.time), covered, covered)
    scores = agreement([residual], horizons=(), noise=Noise.white(np.ones(3))) if np.any(covered) else ()
    return TrialComparison(
        trial=trial.name,
        role=role,
        rollout=run.source,
        status="partly" if missed else "covered",
        scores=tuple(replace(score, role=role) for score in scores if score.channel in run.channels),
        shifts=_shifts(trial, run, counted),
        remarks=tuple(remarks),
    )


def _coarse(trial: Trial, run: SimulatedRun) -> list[str]:
    """Say where steps of a rollout are too long for its beat, or, where that is unknown, for the measurement."""
    beat = min((2.0 * np.pi / segment.omega for segment in trial.drive), default=0.0)
    enough = beat / _POINTS_A_BEAT if beat else 2.0 * float(np.max(np.diff(trial.time)))
    longest = float(np.max(np.diff(run.time)))
    if longest <= enough:
        return []
    why = f"a beat lasts {beat:.3g} s" if beat else f"the measured ones are half of {enough:.3g} s"
    return [
        f"{trial.name}: steps of {run.source} are up to {longest:.3g} s and {why}; what is between is guessed: "
        f"write it every {enough:.2g} s or more often"
    ]


def _shifts(trial: Trial, run: SimulatedRun, counted: BoolArray) -> dict[str, Shift]:
    groups = {name: [k] for k, name in enumerate(CHANNELS) if name in run.channels and trial.measured[k]}
    if not groups:
        return {}
    span = np.nanmax(trial.velocity, axis=0) - np.nanmin(trial.velocity, axis=0)
    measured = trial.velocity[counted]

    def best(own: list[int]) -> Shift | None:
        return best_shift(lambda at: run.at(at)[:, own], trial.time[counted], measured[:, own], span[own], reach(trial))

    found = {name: best(own) for name, own in {**groups, "all": [k for (k,) in groups.values()]}.items()}
    return {name: shift for name, shift in found.items() if shift is not None}
