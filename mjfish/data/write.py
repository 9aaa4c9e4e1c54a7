"""Writing a dataset, complete or not at all; what cannot be read back is refused."""

from __future__ import annotations

import shutil
import uuid
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np

from mjfish import fish as fishes
from mjfish.data import columns, dataset_toml
from mjfish.data.dataset_toml import Bounds, DatasetTable
from mjfish.data.read import build_sensor, build_trial
from mjfish.data.sensor import Sensor
from mjfish.data.tables import write_table
from mjfish.data.trial import Dataset, Trial, errors_to_columns
from mjfish.errors import InputError, MjfishError, located
from mjfish.errors.arguments import checked
from mjfish.files import tomlfile, writing
from mjfish.files.plain_data import plain
from mjfish.fish import Fish, fish_text, load_fish
from mjfish.fish.frames import CHANNELS
from mjfish.numerics.arrays import FloatArray
from mjfish.parameters import Parameter

#: First line of every dataset.toml written here: a folder with it may be overwritten, one made by hand may not.
MARK = "# Written by mjfish. SI units and radians; velocities are those of the nose: x forward, y to port, z up."
_FISH_FILE = "fish.toml"


@checked
def save(
    dataset: Dataset,
    folder: str | Path,
    *,
    suffix: Literal[".csv", ".parquet"] = ".csv",
    comments: Sequence[str] = (),
) -> Path:
    """Write dataset.toml and one table a trial, so that `load` gives every number back to the last bit.

    A fish that is not a shipped one goes along as fish.toml. Files of an older dataset in the folder are replaced,
    others are left alone.

    Args:
        dataset: validated as in `load` before anything is written.
        folder: absent, empty, or holding a dataset written by this function.
        suffix: of the tables.
        comments: lines for the top of dataset.toml.

    Returns:
        The path of the dataset.toml.

    Raises:
        MjfishError: the dataset is not valid, or the folder holds something else or cannot be written.
    """
    folder = Path(folder).resolve()
    raw = _raw(dataset, suffix)
    tables = _validated(dataset, raw)
    printable = ("# " + "".join(c if c.isprintable() else " " for c in line) for line in comments)
    stale = _replaceable(folder)
    partial = folder.with_name(f".{folder.name}.{uuid.uuid4().hex[:8]}.partial")
    try:
        partial.mkdir(parents=True)
        for file, table in tables.items():
            write_table(partial / file, {columns.header(name): values for name, values in table.items()})
        if raw["fish"] == _FISH_FILE:
            (partial / _FISH_FILE).write_text(fish_text(dataset.fish), encoding="utf-8")
        (partial / dataset_toml.FILE).write_text("\n".join([MARK, *printable, tomlfile.text(raw)]), encoding="utf-8")
        _publish(partial, folder, stale)
    except (OSError, UnicodeEncodeError) as error:
        raise InputError(f"{folder}: the dataset cannot be written: {error}; choose another place") from None
    finally:
        shutil.rmtree(partial, ignore_errors=True)
    return folder / dataset_toml.FILE


def check_folder(folder: str | Path) -> None:
    """Refuse a folder that `save` would refuse; for callers with long work before they save.

    Raises:
        InputError: it holds something else than a dataset written by `save`, or cannot be written to.
    """
    folder = Path(folder).resolve()
    writing.check_folder(folder)
    _replaceable(folder)


def _raw(dataset: Dataset, suffix: str) -> dict[str, Any]:
    """Return dataset.toml as plain tables."""
    fish, start = _fish_entry(dataset.fish)
    stated = () if dataset.noise is None else zip(CHANNELS, map(float, dataset.noise), strict=True)
    noise = {name: sigma for name, sigma in stated if not np.isnan(sigma)}
    trials = [
        {
            "name": trial.name,
            "file": f"{trial.name}{suffix}",
            "role": trial.role,
            "gaps": trial.gaps,
            "joints": "commanded" if trial.commanded else None,
            "hold": trial.hold if trial.commanded else None,
            "from_rest": trial.from_rest,
            # Nobody edits the modes, and Parquet keeps them small.
            "errors": None if trial.errors is None else f"{trial.name}.errors.parquet",
            "drive": plain(trial.drive) or (None if trial.wave is None else {"kind": "wave", **plain(trial.wave)}),
            "sensors": [_sensor(trial, sensor, dataset.fish, suffix) for sensor in trial.sensors],
        }
        for trial in dataset.trials
    ]
    raw = {
        "schema": 1, "name": dataset.name, "fish": fish, "clock": dataset.clock, "noise": noise,
        "tank": _tank(dataset), "start": start,
        "known": {name: one.model_dump(exclude_none=True) for name, one in dataset.known.items()},
        "filter": dataset_toml.filter_table(dataset.filter),
    }  # fmt: skip
    filled = {key: value for key, value in raw.items() if value not in (None, {})}
    return {**filled, "trials": [{key: value for key, value in trial.items() if value} for trial in trials]}


def _sensor(trial: Trial, sensor: Sensor, fish: Fish, suffix: str) -> dict[str, Any]:
    """Return the entry of a sensor."""
    known = {} if sensor.placed else {"known": False}
    table = {
        "kind": sensor.kind, "name": sensor.name, "file": f"{trial.name}.{sensor.name}{suffix}",
        "place": {"link": fish.links[sensor.link].name, "station": float(sensor.station), **known},
        "sigma": plain(sensor.sigma), "clock": "free" if sensor.free_clock else None,
    }  # fmt: skip
    return {key: value for key, value in table.items() if value is not None}


def _tank(dataset: Dataset) -> Any:
    """Return the table of the one tank that all trials swam in."""
    tanks = {trial.tank for trial in dataset.trials}
    if len(tanks) > 1:
        raise InputError(
            "the dataset cannot be saved: its trials have different tanks, a file has one; save them apart"
        )
    return plain(next(iter(tanks), None))


def _fish_entry(fish: Fish) -> tuple[str, dict[str, dict[str, float]]]:
    """Return a shipped fish's name and what ``[start]`` must say to make it this one, or the name of a fish file."""
    if fish.name in fishes.shipped():
        shipped = load_fish(fish.name)
        pairs = zip(shipped.parameters, fish.parameters, strict=True)
        start = {new.name: changed for old, new in pairs if (changed := _changed(old, new))}
        if dataset_toml.with_start(shipped, {name: Bounds(**bounds) for name, bounds in start.items()}, Path()) == fish:
            return fish.name, start
    return _FISH_FILE, {}


def _changed(old: Parameter, new: Parameter) -> dict[str, float]:
    return {key: getattr(new, key) for key in ("start", "low", "high") if getattr(new, key) != getattr(old, key)}


def _validated(dataset: Dataset, raw: dict[str, Any]) -> dict[str, dict[str, FloatArray]]:
    """Return the columns of every file, having passed them through all that `load` checks."""
    file = Path(dataset_toml.FILE)
    with located("the dataset cannot be saved"):
        table = tomlfile.parse(raw, DatasetTable, str(file))
        dataset_toml.check(table, file)
        if raw["fish"] == _FISH_FILE:
            tomlfile.parse(dataset.fish.model_dump(by_alias=True), Fish, _FISH_FILE)
        tables = {}
        for number, (entry, trial) in enumerate(zip(table.trials, dataset.trials, strict=True), start=1):
            own, key = _columns(trial), f"{file}: trials.{number}"
            tables[str(entry.file)] = own
            for name, values in own.items():
                columns.check_finite(values, Path(str(entry.file)), f"column '{columns.header(name)}'")
            for told, sensor in zip(entry.sensors, trial.sensors, strict=True):
                tables[told.file] = dict(zip(("time", *sensor.channels), (sensor.time, *sensor.values.T), strict=True))
            sensors = [
                build_sensor(told, tables[told.file], dataset.fish, Path(told.file), f"{key}.sensors.{place}")
                for place, told in enumerate(entry.sensors, start=1)
            ]
            build_trial(entry, own, dataset.fish, Path(str(entry.file)), key, trial.tank, sensors)
            if entry.errors is not None:
                tables[entry.errors] = errors_to_columns(trial)
    return tables


def _columns(trial: Trial) -> dict[str, FloatArray]:
    """Return the arrays of a trial as columns by name."""
    samples = np.size(trial.time)
    told = np.flatnonzero(trial.measured)
    names = {tuple(CHANNELS[k] for k in told): trial.velocity[:, told]}
    if trial.pose is not None:
        has_position = not np.isnan(trial.pose[:, :2]).all()
        names |= {columns.POSE: trial.pose} if has_position else {("yaw",): trial.pose[:, 2:]}
    if trial.roll is not None:
        names["roll",] = np.reshape(trial.roll, (-1, 1))
    if trial.joint_angle is not None:
        names[tuple(columns.joint(k + 1) for k in range(trial.joint_angle.shape[-1]))] = trial.joint_angle
    table = {"time": np.asarray(trial.time, dtype=np.float64)}
    for labels, values in names.items():
        if np.shape(values) != (samples, len(labels)):
            raise InputError(
                f"trial '{trial.name}': {', '.join(labels)} have shape {np.shape(values)}, expected "
                f"{(samples, len(labels))}: a row for every time and a column for each; correct it"
            )
        table.update({label: np.asarray(values[:, i], dtype=np.float64) for i, label in enumerate(labels)})
    return table


def _replaceable(folder: Path) -> list[Path]:
    """Return the files of the dataset in `folder`; refuse a folder that holds anything but one of ours."""
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder}: is a file, expected a folder; choose another name")
    if not folder.exists() or not any(folder.iterdir()):
        return []
    file = folder / dataset_toml.FILE
    remedy = "choose another folder, or empty this one yourself"
    if not file.is_file():
        raise InputError(
            f"{folder}: holds files and no {dataset_toml.FILE}, expected an empty folder or a dataset; {remedy}"
        )
    try:
        old = tomlfile.read(file, DatasetTable)
    except MjfishError as error:
        raise InputError(f"{folder}: holds a dataset that cannot be read; {remedy} ({error})") from None
    if not file.read_text(encoding="utf-8").startswith(MARK.partition(".")[0]):
        raise InputError(f"{folder}: holds a dataset that mjfish did not write, expected one that it did; {remedy}")
    names = [
        dataset_toml.FILE,
        *(file for trial in old.trials for file in (trial.file, trial.errors) if file),
        *(sensor.file for trial in old.trials for sensor in trial.sensors),
        *([_FISH_FILE] if old.fish == _FISH_FILE else []),
    ]
    return [folder / name for name in names if Path(name).name == name]


def _publish(partial: Path, folder: Path, stale: list[Path]) -> None:
    """Move the finished files of `partial` into place; dataset.toml goes first and comes last."""
    if not folder.exists():
        partial.rename(folder)
        return
    fresh = sorted(partial.iterdir(), key=lambda file: file.name == dataset_toml.FILE)
    for file in fresh:
        target = folder / file.name
        if target.exists() and target not in stale:
            raise InputError(f"{target}: is no file of the old dataset, and would be overwritten; move it away")
    for target in stale:
        target.unlink(missing_ok=True)
    for file in fresh:
        file.replace(folder / file.name)
