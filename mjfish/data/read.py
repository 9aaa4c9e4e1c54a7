"""Reading a dataset: dataset.toml, the fish, and one table of numbers a trial."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from mjfish import tomlfile
from mjfish.arrays import FloatArray, readonly
from mjfish.data import columns, dataset_toml, error_modes, validation
from mjfish.data.dataset_toml import DatasetTable, Law, Noise, TrialTable
from mjfish.data.tables import read_table
from mjfish.data.trial import Dataset, Tank, Trial
from mjfish.drive.cpg import DriveSegment
from mjfish.drive.wave import Wave
from mjfish.errors import InputError, located
from mjfish.fish import Fish, load_fish
from mjfish.frames import CHANNELS


def load_dataset(path: str | Path) -> Dataset:
    """Read a dataset and validate every number of it.

    Args:
        path: the folder, or its dataset.toml.

    Returns:
        The trials with times (n,) [s] and velocities (n, 3) [m/s, rad/s] of the nose, and the fish.

    Raises:
        MjfishError: something is not what it must be; the message names the file, the row or key, what was found,
            what was expected and what to do.

    Example:
        >>> import mjfish
        >>> from mjfish.data import save
        >>> path = save(mjfish.generate("pike", ["v1"], duration=2.0), "pool")
        >>> [trial.name for trial in mjfish.load_dataset("pool").trials]
        ['v1']
    """
    file = Path(path)
    if file.is_dir():
        file = file / dataset_toml.FILE
        if not file.is_file():
            raise InputError(
                f"{path}: has no {dataset_toml.FILE}, expected the folder of a dataset; give another folder"
            )
    table = tomlfile.read(file, DatasetTable)
    dataset_toml.check(table, file)
    fish = dataset_toml.with_start(_fish(table.fish, file), table.start, file)
    tank = None if table.tank is None else Tank(table.tank.x, table.tank.y)
    trials = []
    for number, entry in enumerate(table.trials, start=1):
        source = file.parent / entry.file
        with located(f"{file}: trials.{number}"):
            numbers = read_table(source, missing=CHANNELS if entry.gaps else ())
            modes = None if entry.errors is None else read_table(file.parent / entry.errors)
        trial = build_trial(entry, numbers, fish, source, f"{file}: trials.{number}", tank)
        if modes is not None:
            trial = replace(trial, errors=error_modes.from_columns(modes, trial, file.parent / str(entry.errors)))
        trials.append(trial)
    return Dataset(
        name=table.name,
        fish=fish,
        trials=tuple(trials),
        noise=_sigmas(table.noise),
        clock=table.clock,
        source=file,
        known=table.known,
        filter=dataset_toml.filter_of(table.filter),
    )


def build_trial(
    entry: TrialTable,
    numbers: Mapping[str, FloatArray],
    fish: Fish,
    source: Path,
    key: str,
    tank: Tank | None = None,
) -> Trial:
    """Put a trial together from its entry in dataset.toml and its columns, and validate it.

    Args:
        entry: of ``[[trials]]``.
        numbers: columns by name, each (n,) and finite; with `gaps` in the entry, velocities may be NaN.
        fish: that swam.
        source: file of the columns, for messages.
        key: of the entry in its file, for messages.
        tank: it swam in.

    Raises:
        InputError: see `load`.
    """
    missing = [name for name in columns.REQUIRED if name not in numbers]
    if missing:
        found = ", ".join(map(columns.header, numbers))
        raise InputError(f"{source}: column '{columns.header(missing[0])}' is missing; found {found}; add it")
    if entry.gaps and not entry.drive and entry.wave is None:
        raise InputError(
            f"{key}.gaps: samples may be missing only where a CPG drives the fish, or a wave, for the joints move on "
            "meanwhile; cut the recording into two trials"
        )
    if entry.gaps:
        numbers = _recorded(numbers, source)
    time = numbers["time"]
    validation.check_times(time, source, gaps=entry.gaps)
    drive = tuple(DriveSegment(segment.start, segment.omega, segment.bias) for segment in entry.drive)
    joints = _joints(numbers, fish, source)
    wave = None if entry.wave is None else wave_of(entry.wave, fish, f"{key}.drive")
    _check_one_drive(bool(drive) or wave is not None, joints, fish, source, key)
    if entry.joints == "commanded" and joints is None:
        raise InputError(
            f"{key}.joints: 'commanded', but {source} has no columns of joint angles, expected what the servos were "
            "told; add the columns, or remove the key"
        )
    if wave is not None:
        validation.check_wave(time, wave, source, f"{key}.drive")
    if drive:
        validation.check_segments(drive, fish, f"{key}.drive")
        validation.check_cpg_time(time, drive, source, f"{key}.drive")
    if joints is not None:
        validation.check_angles(time, joints, source)
    pose = _pose(numbers, source)
    if tank is not None and pose is not None:
        validation.check_in_tank(pose, tank, source)
    return Trial(
        name=entry.name,
        role=entry.role,
        time=time,
        velocity=readonly(np.stack([numbers[name] for name in CHANNELS], axis=1)),
        drive=drive,
        joint_angle=joints,
        pose=pose,
        roll=numbers.get("roll"),
        source=source,
        gaps=entry.gaps,
        wave=wave,
        tank=tank,
        commanded=entry.joints == "commanded",
    )


def wave_of(law: Law, fish: Fish, key: str, unit: float = 1.0) -> Wave:
    """Return the wave of a joint law whose angles are in `unit` [rad]; `key` is where it stands.

    Raises:
        InputError: there is not one of everything a joint.
    """
    bias = law.bias or (0.0,) * fish.joints
    for name, values in (("amplitude", law.amplitude), ("phase", law.phase), ("bias", bias)):
        if len(values) != fish.joints:
            raise InputError(
                f"{key}.{name}: {len(values)} numbers, expected {fish.joints}, one for each joint of fish "
                f"'{fish.name}'; correct it"
            )
    amplitude, phase, bias = (tuple(unit * value for value in row) for row in (law.amplitude, law.phase, bias))
    return Wave(law.frequency, amplitude, phase, bias, law.ramp, law.free)


def _recorded(numbers: Mapping[str, FloatArray], source: Path) -> Mapping[str, FloatArray]:
    """Leave out samples whose velocity is missing: where a CPG drives the fish, its motion is known without them."""
    kept = np.all(np.isfinite([numbers[name] for name in CHANNELS]), axis=0)
    if not kept.any():
        raise InputError(f"{source}: no row has all of surge, sway and yaw rate; give a recording of the three")
    return {name: readonly(values[kept]) for name, values in numbers.items()}


def _check_one_drive(driven: bool, joints: FloatArray | None, fish: Fish, source: Path, key: str) -> None:
    """Refuse a trial that says twice how the joints moved, or not at all."""
    first, last = columns.header(columns.joint(1)), columns.header(columns.joint(fish.joints))
    if driven and joints is not None:
        raise InputError(
            f"{key}.drive: {source} has measured joint angles too, expected one of the two; remove [[trials.drive]] to "
            f"drive the model by the measured angles, or the columns '{first}' to '{last}' to drive it by the CPG"
        )
    if not driven and joints is None:
        raise InputError(
            f"{key}: no drive, and {source} has no joint angles; add [[trials.drive]] with start, omega and bias, "
            f"[trials.drive] of kind 'wave', or the columns '{first}' to '{last}'"
        )


def _fish(name: str, file: Path) -> Fish:
    with located(f"{file}: fish"):
        try:
            return load_fish(name, relative_to=file.parent)
        except OSError as error:
            raise InputError(f"'{name}' cannot be read: {error}; correct the path") from None


def _sigmas(noise: Noise | None) -> FloatArray | None:
    return None if noise is None else readonly([noise.surge, noise.sway, noise.yaw_rate])


def _joints(numbers: Mapping[str, FloatArray], fish: Fish, source: Path) -> FloatArray | None:
    found = {number: name for name in numbers if (number := columns.joint_number(name)) is not None}
    if not found:
        return None
    for number in range(1, fish.joints + 1):
        if number not in found:
            raise InputError(
                f"{source}: column '{columns.header(columns.joint(number))}' is missing, expected one for each of the "
                f"{fish.joints} joints of fish '{fish.name}'; add it, or remove all joint columns"
            )
    if len(found) > fish.joints:
        extra = found[max(found)]
        raise InputError(
            f"{source}: column '{columns.header(extra)}', but fish '{fish.name}' has {fish.joints} joints; remove it, "
            "or name the right fish in dataset.toml"
        )
    return readonly(np.stack([numbers[columns.joint(number)] for number in range(1, fish.joints + 1)], axis=1))


def _pose(numbers: Mapping[str, FloatArray], source: Path) -> FloatArray | None:
    given = [name for name in columns.POSE if name in numbers]
    if not given:
        return None
    if given not in (["yaw"], list(columns.POSE)):
        missing = next(name for name in columns.POSE if name not in numbers)
        beside = " and ".join(map(columns.header, given))
        raise InputError(
            f"{source}: column '{columns.header(missing)}' is missing beside {beside}, expected x, y and yaw, or yaw "
            "alone; add it or remove the others"
        )
    unknown = np.full_like(numbers["time"], np.nan)
    return readonly(np.stack([numbers.get(name, unknown) for name in columns.POSE], axis=1))
