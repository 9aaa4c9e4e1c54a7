"""Importer of the runs of a one-joint fish, the public data of giorgosmamakoukas/DerivativeBasedKoopman (MIT).

    mjfish import tools/importers/tail_fish.py FILES --out FOLDER

A file has no header. Its columns are time [s], velocity along and across the body [m/s], yaw rate [rad/s], heading
[rad], x and y [m] of a tracked point. Its name says what the tail was told: ``Amp20Bias-30.txt`` is 20 degrees about
-30 degrees. Neither phase nor frequency is recorded. The frequency is read from the yaw rate of the whole record, whose
average it is to a small part of a turn; the phase is free in a fit. How far the tail really swings, and where its zero
is, is not known either: both are free, alike for all runs.

The velocities were differentiated and smoothed. Their noise above the third harmonic of the beat has the spectrum of a
derivative behind a Gaussian of 0.05 s, which takes a fifth of the motion at 2 Hz: predictions go through it too.

[Mamakoukas2021] G. Mamakoukas, M. Castano, X. Tan and T. Murphey, Derivative-based Koopman operators for real-time
control of robotic systems, IEEE Transactions on Robotics 37.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import Field

from mjfish.data import Dataset, Trial
from mjfish.data.columns import LARGEST, check_increasing
from mjfish.data.dataset_toml import GaussianTable, filter_of
from mjfish.data.importers.smoothing import beat_frequency
from mjfish.data.importers.tables import check_length
from mjfish.data.importers.trials import FileReport, ImportReport, Run, assembled
from mjfish.drive.wave import Wave
from mjfish.errors import InputError
from mjfish.files import size_limited, tomlfile
from mjfish.files.tomlfile import Table
from mjfish.fish import load_fish
from mjfish.fish.parameter_priors import ParameterPrior
from mjfish.numerics.arrays import FloatArray, readonly

#: Amplitude and bias [deg] in the name of a file.
_NAME = re.compile(r"Amp(?P<amplitude>\d+)Bias(?P<bias>-?\d+)")
_COLUMNS = ("time", "velocity along", "velocity across", "yaw rate", "heading", "x", "y")
_FEWEST = 20
SETTINGS = Path(__file__).with_suffix(".toml")
#: How well the average phase of a record is known at either end, as the average frequency tells it [rad].
_TURN = 0.05


class Goal(Table):
    """What is asked of the held-out runs: error of the mean speed [m/s], nRMSE of the yaw rate [-]."""

    speed: float
    yaw_rate: float


class Study(Table):
    """What the study does with the runs, see the comments of the file of settings."""

    held_out: str
    called: str
    goal: Goal
    reference: dict[str, tuple[float, float, float, float]]


class Settings(Table):
    """What is known of all runs beside what their files say, and what is done with them."""

    schema_: Literal[1] = Field(alias="schema")
    known: dict[str, ParameterPrior]
    filter: GaussianTable
    study: Study


def import_files(
    files: Sequence[Path], held_out: Sequence[str] = (), mapping: Path | None = None
) -> tuple[Dataset, ImportReport]:
    """Turn files of the one-joint fish into a dataset of the shipped fish ``one_joint``.

    The tracked point is taken to be the centre of mass of the body, and carried to the nose. A positive bias turns the
    recorded heading down, as a positive angle of the joint does.

    Args:
        files: one a run, named like ``Amp20Bias-30.txt``; another ending tells repeats apart, ``Amp20Bias-30_2.txt``.
        held_out: names of trials not to be fitted.
        mapping: not needed.

    Raises:
        InputError: a file is missing, its name says no amplitude and bias, or it is no table of seven numbers a row.
        UnknownNameError: `held_out` names nothing.
    """
    if mapping is not None:
        raise InputError(f"{mapping}: this importer takes no mapping file, the layout is known; leave out --map")
    fish, beforehand = load_fish("one_joint"), tomlfile.read(SETTINGS, Settings)
    trials = [_trial(path, fish.links[0].com) for path in files]
    runs = [Run(trial.name, (trial,), _report(trial, path)) for trial, path in zip(trials, files, strict=True)]
    dataset, report = assembled(runs, fish, held_out, "tail_fish", "one-joint fish")
    own = {f"{trial.name}:wave.frequency": ParameterPrior(sd=_TURN / _length(trial)) for trial in trials}
    known, name = {**beforehand.known, **own}, f"one-joint fish, {len(trials)} runs"
    return replace(dataset, name=name, known=known, filter=filter_of(beforehand.filter)), report


def _report(trial: Trial, path: Path) -> FileReport:
    samples = len(trial.time)
    return FileReport(
        path=path,
        trials=(trial.name,),
        frames=samples,
        usable=samples,
        kept=samples,
        beat=None if trial.wave is None else trial.wave.frequency,
        speed=float(trial.velocity[:, 0].mean()),
        notes=("noise not stated: estimated from the fit",),
    )


def _trial(path: Path, behind: float) -> Trial:
    found = _NAME.search(path.stem)
    if found is None:
        raise InputError(
            f"{path}: its name says no amplitude and bias, expected e.g. Amp20Bias-30.txt; rename it, or import it as "
            "'velocities' with a mapping file"
        )
    amplitude, bias = (math.radians(float(found[group])) for group in ("amplitude", "bias"))
    table = _read(path)
    time, along, across, turn = table[:, 0], table[:, 1], table[:, 2], table[:, 3]
    check_increasing(time, path, 1, "time")
    check_length(time, path)
    heading = np.unwrap(table[:, 4])
    frequency, _ = beat_frequency(time, turn)
    cos, sin = np.cos(heading), np.sin(heading)
    pose = np.column_stack([table[:, 5] + behind * cos, table[:, 6] + behind * sin, heading])
    return Trial(
        name=path.stem,
        role=None,
        time=readonly(time),
        velocity=readonly(np.column_stack([along, across + behind * turn, turn])),
        pose=readonly(pose),
        wave=Wave(frequency, (amplitude,), (0.0,), (bias,), free=True),
        source=path,
    )


def _length(trial: Trial) -> float:
    """Return by how much [rad] the phase at either end moves as the frequency rises by 1 Hz, that mid-record fixed."""
    return math.pi * float(trial.time[-1] - trial.time[0])


def _read(path: Path) -> FloatArray:
    """Return the table (n, 7) of a file.

    Raises:
        InputError: it cannot be read, or is no such table.
    """
    try:
        text = size_limited.read_text(path, size_limited.TABLE, "give the text file of a run", rows=True)
        if not text.strip():
            raise ValueError("no rows")
        table = np.loadtxt(text.split("\n"), ndmin=2, comments=None)
    except InputError:
        raise
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}; correct its name") from None
    except ValueError as error:
        raise InputError(f"{path}: {error}; expected rows of seven numbers: {', '.join(_COLUMNS)}") from None
    if table.shape[1] != len(_COLUMNS) or len(table) < _FEWEST:
        raise InputError(
            f"{path}: {len(table)} rows of {table.shape[1]} numbers, expected {_FEWEST} rows or more of seven: "
            f"{', '.join(_COLUMNS)}"
        )
    wrong = np.argwhere(~(np.abs(table) <= LARGEST))
    if len(wrong):
        row, column = wrong[0]
        raise InputError(
            f"{path}: row {row + 1}, {_COLUMNS[column]}: no finite number up to {LARGEST:g}; correct or remove the row"
        )
    return np.asarray(table, dtype=np.float64)
