"""The tables of ``dataset.toml``."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, model_validator

from mjfish.data.sensor import Kind
from mjfish.data.trial import Clock, Filter, GaussianFilter, Hold, Role, restored_filter
from mjfish.errors import InputError, UnknownNameError, located
from mjfish.files.plain_data import fields_of
from mjfish.files.tomlfile import Table, consistent, required
from mjfish.fish import KINDS, Fish
from mjfish.fish.parameter_priors import ParameterPrior

#: Name of the file that makes a folder a dataset.
FILE = "dataset.toml"

Number = Annotated[float, Field(strict=True)]


_NAMED = required(lambda name: name and "\0" not in name, "expected the name of a file; correct it")
#: By the name alone: a link in the folder is the user's own word.
_INSIDE = required(
    lambda name: not Path(name).anchor and Path(os.path.normpath(name)).parts[:1] != (os.pardir,),
    "leaves the folder of the dataset, expected a file in it; copy it there, or link to it",
)
FileName = Annotated[str, _NAMED, _INSIDE]
TrialName = Annotated[
    str,
    required(
        re.compile(r"\w(?:[\w .+-]{0,98}[\w+-])?").fullmatch,
        "a trial's name is also a file name: letters, digits, spaces and . + - _ only, beginning with a letter or "
        "digit, at most 100 characters; rename the trial",
    ),
]
SensorName = Annotated[
    str,
    required(
        re.compile(r"(?!(?:start|clock|wave)\Z)[a-z][a-z0-9_]*").fullmatch,
        "a sensor's name is a part of the names of parameters: lower-case letters, digits and _ only, beginning "
        "with a letter, not start, clock or wave; rename the sensor",
    ),
]
Sigma = Annotated[
    Number,
    required(
        lambda value: value > 0.0,
        "must be above 0; leave out [noise], or sigma of a sensor, to have it estimated from the data",
    ),
]
Positive = Annotated[Number, Field(gt=0.0)]
NotNegative = Annotated[Number, Field(ge=0.0)]


class Noise(Table):
    """Standard deviation of the measured velocities: surge, sway [m/s], yaw rate [rad/s]."""

    surge: Sigma | None = None
    sway: Sigma | None = None
    yaw_rate: Sigma | None = None


#: Numbers of a coefficient, as those of a fish.
Value = Annotated[Number, Field(ge=0.0, le=1e9)]
High = Annotated[Number, Field(gt=0.0, le=1e9)]


class Bounds(Table):
    """Start value and bounds of one coefficient; what is left out stays as the fish declares it."""

    start: Value | None = None
    low: Value | None = None
    high: High | None = None


class Drive(Table):
    """A CPG segment: from `start` [s] on, frequency `omega` [rad/s] and one bias a joint [-]."""

    start: NotNegative
    omega: Positive
    bias: tuple[Number, ...]


class Law(Table):
    """A joint law, see `mjfish.drive.wave`: frequency [Hz]; amplitude, phase and bias [rad], one a joint.

    `free`: drive and record have no common clock, so that frequency and phase are fitted with every trial.
    """

    frequency: Annotated[Positive, Field(le=1e6)]
    amplitude: tuple[Annotated[Number, Field(ge=-1e6, le=1e6)], ...]
    phase: tuple[Number, ...]
    bias: tuple[Number, ...] = ()
    ramp: Annotated[NotNegative, Field(le=1e6)] = 0.0
    free: bool = False


class WaveDrive(Law):
    """A wave as the drive."""

    kind: Literal["wave"]


class PlaceTable(Table):
    """Where a sensor sits: on a `link`, by name, a `station` [m] behind its front; `known`: measured, not guessed."""

    link: str
    station: NotNegative
    known: bool = True


class SensorTable(Table):
    """One entry of ``[[trials.sensors]]``, see `mjfish.data.sensor.Sensor`; `name` is the kind where it is not given.

    `columns`: headers of the file by channel (``time``, ``x``, ..), where they are not those of this package.
    `sigma`: one for each channel, in its unit.
    """

    kind: Kind
    name: SensorName = ""
    file: FileName
    columns: Annotated[dict[str, str], Field(default_factory=dict)]
    place: PlaceTable | None = None
    sigma: tuple[Sigma, ...] = ()
    clock: Clock = "synchronised"

    @property
    def label(self) -> str:
        """Name of the sensor."""
        return self.name or self.kind


class TrialTable(Table):
    """One entry of ``[[trials]]``; `file` is in the folder of dataset.toml, or below it.

    `file` may be left out where there are `sensors` and a drive: the times of the longest sensor are then the run's.

    `gaps`: samples are missing, rows or velocities in rows; only where a CPG drives the fish, whose motion is known.
    `joints`: whether the columns of joint angles are what the joints did, or what the servos were told.
    `hold`: what a commanded angle does until the next one (`mjfish.data.Trial.hold`).
    `from_rest`: whether the fish is known to be at rest in the water at the first sample.
    `errors`: file of the modes of the errors of velocities and joint angles, see `mjfish.data.trial`.
    """

    name: TrialName
    file: FileName | None = None
    role: Role | None = None
    gaps: bool = False
    joints: Literal["measured", "commanded"] = "measured"
    hold: Hold = "linear"
    from_rest: bool = False
    errors: FileName | None = None
    drive: tuple[Drive, ...] = ()
    wave: WaveDrive | None = None
    sensors: tuple[SensorTable, ...] = ()

    @model_validator(mode="before")
    @classmethod
    def _one_table_is_a_wave(cls, raw: object) -> object:
        """``[[trials.drive]]`` is a list of CPG segments, ``[trials.drive]`` one table with a kind."""
        if not isinstance(raw, Mapping):
            return raw
        if "wave" in raw:
            raise ValueError('[trials.wave] is no table, expected [trials.drive] with kind = "wave"; rename it')
        drive = raw.get("drive")
        if isinstance(drive, tuple) and any(isinstance(part, Mapping) and _is_wave(part) for part in drive):
            raise ValueError(
                "a wave in [[trials.drive]], expected one table of it; write [trials.drive] in place of "
                "[[trials.drive]]"
            )
        if not isinstance(drive, Mapping):
            return raw
        if "kind" not in drive:
            raise ValueError(
                '[trials.drive] has no kind, expected kind = "wave"; add it'
                if _is_wave(drive)
                else "a segment of the CPG in [trials.drive], expected a list of them; write [[trials.drive]] in place "
                "of [trials.drive]"
            )
        return {**{key: value for key, value in raw.items() if key != "drive"}, "wave": drive}


def _is_wave(table: Mapping[str, object]) -> bool:
    return not {"kind", "frequency", "amplitude", "phase", "ramp", "free"}.isdisjoint(table)


Walls = Annotated[
    tuple[Number, Number],
    required(
        lambda walls: walls[0] < walls[1],
        "the walls are at {0[0]:g} and {0[1]:g} m, expected the lower one first; correct them",
    ),
]


class TankTable(Table):
    """Walls of the tank: lowest and highest x and y [m], in the world of the poses."""

    x: Walls
    y: Walls


def _flat(raw: object) -> object:
    """Let ``c_f.tail = ..`` mean ``"c_f.tail" = ..``, and a bare number a start value."""
    if not isinstance(raw, Mapping):
        return raw
    groups = {key: key in KINDS and isinstance(value, Mapping) for key, value in raw.items()}
    flat = {key: value for key, value in raw.items() if not groups[key]}
    flat |= {f"{key}.{group}": entry for key, own in raw.items() if groups[key] for group, entry in own.items()}
    return {key: value if isinstance(value, Mapping) else {"start": value} for key, value in flat.items()}


class GaussianTable(Table):
    """Recorded velocities were smoothed by a Gaussian of this `sd` [s]."""

    kind: Literal["gaussian"]
    sd: Positive


class DifferentiatedTable(Table):
    """Recorded velocities are the Savitzky-Golay derivative of positions; window 3, degree 2: central differences.

    `turned`: positions were differentiated along the axes of the tank, and turned by the recorded heading.
    """

    kind: Literal["differentiated"]
    window: Annotated[int, Field(ge=3, le=101)]
    degree: Annotated[int, Field(ge=1, le=6)] = 2
    turned: bool = False

    _fits = consistent(
        lambda own: own.window % 2 == 1 and own.window > own.degree,
        "window = {0.window}: expected an odd number above degree = {0.degree}; correct it",
    )


def filter_of(table: GaussianTable | DifferentiatedTable | None) -> Filter | None:
    """Return the filter that recorded velocities went through."""
    return None if table is None else restored_filter(table.model_dump(exclude={"kind"}))


def filter_table(used: Filter | None) -> dict[str, Any]:
    """Return the table of a filter, empty where none was used."""
    kind = "gaussian" if isinstance(used, GaussianFilter) else "differentiated"
    return {} if used is None else {"kind": kind, **fields_of(used)}


class DatasetTable(Table):
    """The file: a fish, how it was measured, and its trials."""

    schema_: Literal[1] = Field(alias="schema")
    name: Annotated[str, Field(min_length=1)]
    fish: Annotated[str, Field(min_length=1), _NAMED, _INSIDE]
    clock: Clock = "synchronised"
    noise: Noise | None = None
    tank: TankTable | None = None
    start: Annotated[dict[str, Bounds], BeforeValidator(_flat), Field(default_factory=dict)]
    known: Annotated[dict[str, ParameterPrior], Field(default_factory=dict)]
    filter: GaussianTable | DifferentiatedTable | None = Field(default=None, discriminator="kind")
    trials: Annotated[tuple[TrialTable, ...], Field(min_length=1)]

    @model_validator(mode="before")
    @classmethod
    def _trials_are_a_list(cls, raw: object) -> object:
        """Say the one slip behind many complaints: a table of a trial that stands where it does not belong."""
        if not isinstance(raw, Mapping):
            return raw
        if "trial" in raw and "trials" not in raw:
            raise ValueError("[[trial]] is no table of a dataset, expected [[trials]], one a run; rename it")
        for name in ("drive", "sensors"):
            if name in raw:
                raise ValueError(
                    f"'{name}' belongs to a trial, expected [[trials.{name}]] below its [[trials]]; rename it"
                )
        trials = raw.get("trials")
        if isinstance(trials, Mapping) and trials and all(isinstance(entry, Mapping) for entry in trials.values()):
            name = next(iter(trials))
            raise ValueError(f'[trials.{name}], expected [[trials]] with name = "{name}" below it; correct it')
        return raw


def check(table: DatasetTable, file: Path) -> None:
    """Refuse trials that share a name or a file, and a dataset with nothing to fit.

    Raises:
        InputError: naming the key in `file`.
    """
    names: dict[str, int] = {}
    files: dict[Path, int] = {}
    for number, trial in enumerate(table.trials, start=1):
        # Some file systems do not tell upper from lower case.
        first = names.setdefault(trial.name.casefold(), number)
        if first != number:
            raise InputError(
                f"{file}: trials.{number}.name: '{trial.name}' is also the name of trial {first}; give each its own"
            )
        names_of_sensors = [sensor.label for sensor in trial.sensors]
        for place, sensor in enumerate(trial.sensors, start=1):
            if sensor.label in names_of_sensors[: place - 1]:
                raise InputError(
                    f"{file}: trials.{number}.sensors.{place}.name: '{sensor.label}' is also the name of another "
                    "sensor of this trial; give each its own"
                )
        if trial.file is None and not trial.sensors:
            raise InputError(
                f"{file}: trials.{number}: no file and no [[trials.sensors]], expected a recording; add one of them"
            )
        for recording in filter(None, (trial.file, *(sensor.file for sensor in trial.sensors))):
            first = files.setdefault((file.parent / recording).resolve(), number)
            if first != number:
                raise InputError(
                    f"{file}: trials.{number}.file: '{recording}' is also the file of trial {first}; "
                    "a recording must not be counted twice, or be both fitted and held out; remove one"
                )
    if all(trial.role == "held_out" for trial in table.trials):
        raise InputError(f"{file}: trials: every role is 'held_out', expected one or more of role 'fit'; change one")


def with_start(fish: Fish, start: Mapping[str, Bounds], file: Path) -> Fish:
    """Return the fish with the start values and bounds of the ``[start]`` table.

    Raises:
        UnknownNameError: no such coefficient.
        ParameterError: empty bounds, or a start outside of them.
    """
    declared = {parameter.name: parameter for parameter in fish.parameters}
    changed = {}
    for name, bounds in start.items():
        with located(f"{file}: start"):
            if name not in declared:
                raise UnknownNameError("coefficient", name, fish.coefficient_names)
            changed[name] = declared[name].rebound(low=bounds.low, high=bounds.high, start=bounds.start)
    return fish.with_coefficients(changed) if changed else fish
