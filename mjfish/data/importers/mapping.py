"""The mapping file: how a laboratory's columns, units and axes become those of mjfish.

One TOML for all files of an import. Common keys are in `MappingTable`; each importer has a table of its own.
"""

from __future__ import annotations

from collections.abc import Mapping
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Annotated, Literal, TypeVar

import numpy as np
from pydantic import Field, model_validator

from mjfish.data.dataset_toml import Law, NotNegative, Number, Positive
from mjfish.data.read import wave_of
from mjfish.data.tables import Dialect
from mjfish.data.trial import Hold, Trial
from mjfish.drive.wave import Wave
from mjfish.errors import InputError, located
from mjfish.files import tomlfile
from mjfish.files.tomlfile import Table, consistent
from mjfish.fish import Fish, load_fish
from mjfish.numerics.arrays import FloatArray, readonly

#: What one unit is in SI.
LENGTHS = {"m": 1.0, "cm": 0.01, "mm": 0.001}
ANGLES = {"rad": 1.0, "deg": 0.017453292519943295}
TIMES = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}

Length = Literal["m", "cm", "mm"]
Angle = Literal["rad", "deg"]
Time = Literal["s", "ms", "us", "ns"]


class WaveTable(Law):
    """The joint law sent to the joints; `unit` of its angles."""

    unit: Angle = "rad"


class JointColumns(Table):
    """Columns of joint angles, head first; `sign` -1 where they turn the other way.

    `are`: what the joints did, or what the servos were told; `hold` of the latter: see `mjfish.data.Trial.hold`.
    """

    columns: tuple[str, ...]
    unit: Angle = "rad"
    sign: Literal[1, -1] = 1
    are: Literal["measured", "commanded"] = "measured"
    hold: Hold = "linear"

    _held = consistent(
        lambda own: own.hold != "zero" or own.are == "commanded",
        'hold = "zero" of measured angles, expected it of commanded ones; add are = "commanded"',
    )


class MappingTable(Dialect):
    """What every kind of import needs: how its text files are written, and the fish."""

    schema_: Literal[1] = Field(alias="schema")
    fish: Annotated[str, Field(min_length=1)]
    #: Taken away from the front of a file's name to make that of its trial.
    prefix: str = ""


M = TypeVar("M", bound=MappingTable)


class Driven(MappingTable):
    """A record whose joint angles are columns of the file, or given by a law: one of all files, or one a file.

    `waves`: laws by patterns of file names, such as ``fast_*.csv``; the first that fits counts.
    `from_rest`: the fish is known to be at rest in the water at the first row of every file.
    """

    joints: JointColumns | None = None
    wave: WaveTable | None = None
    waves: Annotated[dict[str, WaveTable], Field(default_factory=dict)]
    from_rest: bool = False

    _one_drive = consistent(
        lambda own: [own.joints is not None, own.wave is not None, bool(own.waves)].count(True) == 1,
        "expected one of [joints] (columns of measured angles), [wave] (a joint law) and [waves] (one a file); give "
        "one",
    )


class MarkerEntry(Table):
    """A marker: `link` by name, `station` behind the nose of the straight fish [m], doubts `along`, `across` [m]."""

    name: Annotated[str, Field(min_length=1)]
    link: Annotated[str, Field(min_length=1)]
    station: NotNegative
    along: NotNegative = 0.0
    across: NotNegative = 0.0
    columns: tuple[str, str] | None = None


class PlaneEntry(Table):
    """Markers at another height than the first two: how far they may appear shifted and wobble sideways [m].

    `below`: how far they lie below the first two [m]; their wobble is then a measured roll. For one plane of all.
    """

    markers: tuple[str, ...]
    shift: Positive
    slip: NotNegative = 0.0
    below: Positive | None = None

    _wobbles = consistent(
        lambda own: own.below is None or own.slip > 0.0, "below, but no slip to read a roll from; give slip"
    )


class MarkersMap(MappingTable):
    """``kind = "markers"``: pixels or coordinates of markers, one row a frame."""

    kind: Literal["markers"]
    rate: Positive
    header: bool = False
    missing: bool = True
    y: Literal["up", "down"] = "down"
    #: Of a point, below which it counts as lost; where the tracker gives one.
    likelihood: Annotated[float, Field(ge=0.0, le=1.0)] = 0.6
    markers: Annotated[tuple[MarkerEntry, ...], Field(min_length=3)]
    planes: tuple[PlaneEntry, ...] = ()

    @model_validator(mode="after")
    def _one_roll(self) -> MarkersMap:
        rolling = [", ".join(plane.markers) for plane in self.planes if plane.below is not None]
        if len(rolling) > 1:
            raise ValueError(
                f"below in {len(rolling)} planes (markers {'; '.join(rolling)}), expected one to read the roll from; "
                "keep it in the one that wobbles most"
            )
        return self


class Tabled(Driven):
    """Columns of time and of a point of the head."""

    time: str = "time"
    time_unit: Time = "s"
    length_unit: Length = "m"
    angle_unit: Angle = "rad"


class PosesMap(Tabled):
    """``kind = "poses"``: columns of time, x, y, yaw of a point of the head."""

    kind: Literal["poses"]
    x: str = "x"
    y: str = "y"
    yaw: str = "yaw"
    #: Where y points, seen from above with x to the right.
    axes: Literal["y_up", "y_down"] = "y_up"
    #: Where yaw is positive; by default to port with y up, as in an image to starboard with y down.
    turn_to: Literal["port", "starboard"] | None = None
    #: The measured yaw when the fish points along x [of angle_unit], and the tracked point behind the nose [m]; where
    #: that is not given, it is free in a fit.
    yaw_zero: Number = 0.0
    behind_nose: Number | None = None

    @property
    def port_positive(self) -> bool:
        """Whether yaw grows in a turn to port, anticlockwise seen from above."""
        return self.axes == "y_up" if self.turn_to is None else self.turn_to == "port"


class VelocitiesMap(Tabled):
    """``kind = "velocities"``: columns of time, surge, sway, yaw rate of a point of the head."""

    kind: Literal["velocities"]
    surge: str = "surge"
    sway: str = "sway"
    yaw_rate: str = "yaw_rate"
    #: Where surge, sway and yaw rate are positive.
    surge_to: Literal["front", "tail"] = "front"
    sway_to: Literal["port", "starboard"] = "port"
    turn_to: Literal["port", "starboard"] = "port"
    behind_nose: Number = 0.0
    noise: tuple[Positive, Positive, Positive] | None = None


#: Mappings of tables by kind.
MAPS: dict[object, type[PosesMap] | type[VelocitiesMap]] = {"poses": PosesMap, "velocities": VelocitiesMap}


def read_mapping(path: Path | None, model: type[M], importer: str) -> tuple[M, Fish, Path]:
    """Read the mapping file of an importer that cannot do without one; return it, its fish, and its path.

    Raises:
        InputError: none was given, or it breaks the schema.
    """
    if path is None:
        raise InputError(
            f"importer '{importer}' needs a mapping file that names its columns and units; give --map FILE"
        )
    table = tomlfile.read(path, model)
    with located(f"{path}: fish"):
        return table, load_fish(table.fish, relative_to=path.parent), path


def joint_angle_remarks(table: Driven, trial: Trial) -> tuple[str, ...]:
    """Return what recorded joint angles are taken for, in words; nothing where a law gives them."""
    late = f"half a sample, {500.0 / trial.rate:.3g} ms, later"
    held = {
        "zero": f"held until the next (hold zero), {late} than in a smooth motion (linear)",
        "linear": f"moving smoothly in between (hold linear); --set hold=zero holds each until the next, {late}",
    }
    words = f"joint angles as commanded, {held[trial.hold]}" if trial.commanded else "joint angles as measured"
    return () if table.joints is None else (words,)


def measured_angles(table: Driven, numbers: Mapping[str, FloatArray], fish: Fish, mapping: Path) -> FloatArray | None:
    """Return the measured joint angles (n, joints) [rad], None where a law gives them."""
    if table.joints is None:
        return None
    names = table.joints.columns
    if len(names) != fish.joints:
        raise InputError(
            f"{mapping}: joints.columns: {len(names)} columns, expected {fish.joints}, one for each joint of fish "
            f"'{fish.name}'; correct it"
        )
    return readonly(ANGLES[table.joints.unit] * table.joints.sign * np.column_stack([numbers[name] for name in names]))


def wave_drive(table: Driven, fish: Fish, mapping: Path, recorded: Path) -> Wave | None:
    """Return the law of the joints in a recorded file, None where their angles were measured.

    Raises:
        InputError: no pattern of ``waves`` fits the file, or a law has not one number of everything a joint.
    """
    key, law = "wave", table.wave
    if table.waves:
        found = next((name for name in table.waves if fnmatchcase(recorded.name, name)), None)
        if found is None:
            raise InputError(
                f"{mapping}: waves: no pattern fits {recorded.name}, found {', '.join(table.waves)}; add "
                f'[waves."{recorded.name}"]'
            )
        key, law = f"waves.{found}", table.waves[found]
    return None if law is None else wave_of(law, fish, f"{mapping}: {key}", ANGLES[law.unit])


#: Mapping files of shipped layouts.
LAYOUTS = Path(__file__).parent / "layouts"
