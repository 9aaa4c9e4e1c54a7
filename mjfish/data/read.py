"""Reading a dataset: dataset.toml, the fish, and the tables of numbers of trials and of their sensors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from mjfish.data import columns, dataset_toml, validation
from mjfish.data.dataset_toml import DatasetTable, Law, Noise, SensorTable, TrialTable
from mjfish.data.sensor import CHANNELS_OF, ON_HEAD, PLACED, Sensor, cleaned, within
from mjfish.data.tables import SUFFIXES, read_sheet, read_table
from mjfish.data.trial import Dataset, Tank, Trial, errors_from_columns
from mjfish.drive.cpg import DriveSegment
from mjfish.drive.wave import Wave
from mjfish.errors import InputError, located, system_refusals
from mjfish.files import tomlfile
from mjfish.fish import Fish, load_fish
from mjfish.fish.frames import CHANNELS
from mjfish.numerics.arrays import FloatArray, readonly


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
            tables = any(own.suffix.lower() == ".csv" for own in Path(path).iterdir())
            raise InputError(
                f"{path}: has no {dataset_toml.FILE}, expected the folder of a dataset; "
                + (f"make one of its CSV files by 'mjfish dataset new DIR {path}/*.csv', or " if tables else "")
                + "give another folder"
            )
    if file.suffix.lower() in SUFFIXES:
        is_csv = file.suffix.lower() == ".csv"
        raise InputError(
            f"{path}: is a {file.suffix[1:].upper()} file, expected the folder of a dataset, with its "
            f"{dataset_toml.FILE}; "
            + (f"make one of it by 'mjfish dataset new DIR {path}'" if is_csv else "name its folder, if that has one")
        )
    table = tomlfile.read(file, DatasetTable)
    dataset_toml.check(table, file)
    with located(f"{file}: fish"), system_refusals():
        fish = load_fish(table.fish, relative_to=file.parent)
    fish = dataset_toml.with_start(fish, table.start, file)
    tank = None if table.tank is None else Tank(table.tank.x, table.tank.y)
    trials = []
    for number, entry in enumerate(table.trials, start=1):
        key = f"{file}: trials.{number}"
        source = file.parent / (entry.file or entry.sensors[0].file)
        with located(key):
            numbers = {} if entry.file is None else read_table(source, missing=CHANNELS if entry.gaps else ())
            modes = None if entry.errors is None else read_table(file.parent / entry.errors)
            sensors = tuple(
                read_sensor(sensor, fish, file.parent / sensor.file, f"sensors.{place}")
                for place, sensor in enumerate(entry.sensors, start=1)
            )
        trial = build_trial(entry, numbers, fish, source, key, tank, sensors)
        if modes is not None:
            trial = replace(trial, errors=errors_from_columns(modes, trial, file.parent / str(entry.errors)))
        trials.append(trial)
    return Dataset(
        name=table.name,
        fish=fish,
        trials=tuple(trials),
        noise=_sigmas(table.noise, trials, file),
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
    sensors: Sequence[Sensor] = (),
) -> Trial:
    """Put a trial together from its entry in dataset.toml and its columns, and validate it.

    Args:
        entry: of ``[[trials]]``.
        numbers: columns by name, each (n,) and finite; with `gaps` in the entry, velocities may be NaN. Without any,
            the times are those of the longest sensor. Without velocities, times may have gaps.
        fish: that swam.
        source: file of the columns, for messages.
        key: of the entry in its file, for messages.
        tank: it swam in.
        sensors: as read; what is outside of the run is left out here.

    Raises:
        InputError: see `load`.
    """
    if not numbers:
        time = max(sensors, key=lambda sensor: float(sensor.time[-1] - sensor.time[0])).time
        numbers = {"time": readonly(time[time >= 0.0] if entry.drive or (entry.wave and entry.wave.ramp) else time)}
    else:
        _check_measured(numbers, sensors, source)
    if entry.gaps and not entry.drive and entry.wave is None:
        raise InputError(
            f"{key}.gaps: samples may be missing only where a CPG drives the fish, or a wave, for the joints move on "
            "meanwhile; cut the recording into two trials"
        )
    if entry.gaps:
        numbers = _recorded(numbers, source)
    time = numbers["time"]
    validation.check_times(time, source, gaps=entry.gaps or not any(name in numbers for name in CHANNELS))
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
        validation.check_cpg(time, drive, fish, source, f"{key}.drive")
    if joints is not None:
        validation.check_angles(time, joints, source)
    pose = _pose(numbers, source)
    if tank is not None and pose is not None:
        validation.check_in_tank(pose, tank, source)
    return Trial(
        name=entry.name,
        role=entry.role,
        time=time,
        velocity=readonly(np.stack([numbers.get(name, np.full(len(time), np.nan)) for name in CHANNELS], axis=1)),
        drive=drive,
        joint_angle=joints,
        pose=pose,
        roll=numbers.get("roll"),
        source=source,
        gaps=entry.gaps,
        wave=wave,
        tank=tank,
        commanded=entry.joints == "commanded",
        hold=entry.hold,
        from_rest=entry.from_rest,
        sensors=tuple(within(s, float(time[0]), float(time[-1]), s.source or source) for s in sensors),
    )


def _check_measured(numbers: Mapping[str, FloatArray], sensors: Sequence[Sensor], source: Path) -> None:
    """Refuse columns without times, and a trial in which nothing was measured."""
    found = ", ".join(map(columns.header, numbers))
    if "time" not in numbers:
        raise InputError(f"{source}: column '{columns.header('time')}' is missing; found {found}; add it")
    if not sensors and not any(name in numbers for name in CHANNELS):
        raise InputError(
            f"{source}: no velocity; found {found}; expected one of {', '.join(map(columns.header, CHANNELS))}; "
            "add it, or what was measured instead as [[trials.sensors]]"
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
    measured = [numbers[name] for name in CHANNELS if name in numbers]
    if not measured:
        return numbers
    kept = np.all(np.isfinite(measured), axis=0)
    if not kept.any():
        raise InputError(
            f"{source}: no row has all of the velocities; give them at the same times, or leave out a column"
        )
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


def _sigmas(noise: Noise | None, trials: Sequence[Trial], file: Path) -> FloatArray | None:
    """Return the stated sigmas (3,), NaN of velocities that no trial has."""
    if noise is None:
        return None
    stated = [getattr(noise, name) for name in CHANNELS]
    for channel, (name, sigma) in enumerate(zip(CHANNELS, stated, strict=True)):
        having = [trial.name for trial in trials if trial.measured[channel]]
        if having and sigma is None:
            raise InputError(
                f"{file}: noise.{name}: this key is missing, and trial '{having[0]}' has {name}; add it, or leave out "
                "[noise] to have all estimated"
            )
    return readonly([np.nan if sigma is None else sigma for sigma in stated])


def _joints(numbers: Mapping[str, FloatArray], fish: Fish, source: Path) -> FloatArray | None:
    given = [name for name in numbers if name.startswith(columns.JOINT)]
    expected = [columns.joint(number) for number in range(1, fish.joints + 1)]
    if not given:
        return None
    for name in expected:
        if name not in given:
            raise InputError(
                f"{source}: column '{columns.header(name)}' is missing, expected one for each of the {fish.joints} "
                f"joints of fish '{fish.name}'; add it, or remove all joint columns"
            )
    if len(given) > fish.joints:
        last = max(given, key=lambda name: int(name.removeprefix(columns.JOINT)))
        raise InputError(
            f"{source}: column '{columns.header(last)}', but fish '{fish.name}' has {fish.joints} joints; remove it, "
            "or name the right fish in dataset.toml"
        )
    return readonly(np.stack([numbers[name] for name in expected], axis=1))


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


def read_sensor(entry: SensorTable, fish: Fish, source: Path, key: str) -> Sensor:
    """Read the file of a sensor and validate it.

    Args:
        entry: of ``[[trials.sensors]]``.
        fish: that carries it.
        source: its file.
        key: of the entry in dataset.toml, for messages.

    Raises:
        InputError: a file, column, place or number that is not what it must be.
        UnknownNameError: a header that the file does not have.
    """
    wanted = ("time", *CHANNELS_OF[entry.kind])
    if not entry.columns:
        return build_sensor(entry, read_table(source, missing=wanted[1:]), fish, source, key)
    unnamed = [name for name in wanted if name not in entry.columns]
    unknown = [name for name in entry.columns if name not in wanted]
    if unnamed or unknown:
        raise InputError(
            f"{key}.columns: {', '.join(map(repr, unknown or unnamed))} {'unknown' if unknown else 'missing'}, "
            f"expected the header of each of {', '.join(wanted)}; correct it"
        )
    sheet = read_sheet(source)
    numbers = {name: sheet.numbers(entry.columns[name], missing=name != "time") for name in wanted}
    return build_sensor(entry, numbers, fish, source, key, sheet.layout.first_line)


def build_sensor(
    entry: SensorTable,
    numbers: Mapping[str, FloatArray],
    fish: Fish,
    source: Path,
    key: str,
    first_line: int | None = None,
) -> Sensor:
    """Put a sensor together from its entry and its columns by name.

    Args:
        entry: see `read_sensor`.
        numbers: columns (n,) by name; the time increases.
        fish: see `read_sensor`.
        source: its file.
        key: see `read_sensor`.
        first_line: of the numbers in the file, see `row_name`.

    Raises:
        InputError: as `read_sensor`.
    """
    channels, (link, station) = CHANNELS_OF[entry.kind], _place(entry, fish, key)
    for name in ("time", *channels):
        if name not in numbers:
            found = ", ".join(map(columns.header, numbers))
            raise InputError(
                f"{source}: column '{columns.header(name)}' is missing; found {found}; add it, or say in {key}.columns "
                "which header it has"
            )
    if entry.sigma and len(entry.sigma) != len(channels):
        raise InputError(
            f"{key}.sigma: {len(entry.sigma)} numbers, expected one for each of {', '.join(channels)}; "
            "correct it, or leave it out to have it estimated"
        )
    sensor = Sensor(
        name=entry.label,
        kind=entry.kind,
        time=numbers["time"],
        values=np.stack([numbers[name] for name in channels], axis=1),
        link=link,
        station=station,
        placed=entry.place is None or entry.place.known,
        sigma=np.array(entry.sigma) if entry.sigma else None,
        free_clock=entry.clock == "free",
        source=source,
    )
    return cleaned(sensor, source, first_line)


def _place(entry: SensorTable, fish: Fish, key: str) -> tuple[int, float]:
    """Return link and station of a sensor."""
    names = [link.name for link in fish.links]
    if entry.place is None:
        if entry.kind in PLACED:
            raise InputError(
                f"{key}.place: missing, expected where the {entry.kind} sits, for its reading depends on it; add "
                f'place = {{link = "{names[0]}", station = 0.0}}, the station in m behind the front of the link'
            )
        return 0, 0.0
    if entry.place.link not in names:
        raise InputError(
            f"{key}.place.link: no link '{entry.place.link}' in fish '{fish.name}', expected one of "
            f"{', '.join(names)}; correct it"
        )
    link, station = names.index(entry.place.link), entry.place.station
    if entry.kind in ON_HEAD and link > 0:
        raise InputError(
            f"{key}.place.link: '{entry.place.link}', expected '{names[0]}', for a {entry.kind} is predicted on the "
            "head only; leave the sensor out"
        )
    if station > fish.links[link].length:
        raise InputError(
            f"{key}.place.station: {station:g} m is off the link '{names[link]}', which is "
            f"{fish.links[link].length:g} m long; correct it, or name the link behind"
        )
    return link, station
