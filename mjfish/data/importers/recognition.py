"""What a file is, by its first bytes, and what its columns are, by their headers and the units that these name.

So a message can say how a file is imported that no importer knows, and how it is mapped.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from mjfish.data.tables import Dialect, recognise
from mjfish.errors import InputError

Kind = Literal["velocities", "poses"]
#: Columns of the importers of tables, in the order in which a mapping file has them.
KEYS: Mapping[Kind, tuple[str, ...]] = {
    "velocities": ("time", "surge", "sway", "yaw_rate"),
    "poses": ("time", "x", "y", "yaw"),
}
#: Which unit of a mapping file the column of a key is in.
UNIT_OF = {
    "time": "time", "surge": "length", "sway": "length", "x": "length", "y": "length", "yaw_rate": "angle",
    "yaw": "angle", "joints": "joint",
}  # fmt: skip
_WORDS = {
    "time": ("time", "t", "timestamp", "sec", "seconds"),
    "surge": (
        "surge", "u", "vx", "v_x", "forward", "surge_velocity", "forward_velocity", "forward_speed",
        "vx_fwd", "v_fwd",
    ),
    "sway": ("sway", "v", "vy", "v_y", "lateral", "sway_velocity", "lateral_velocity", "lateral_speed"),
    "yaw_rate": (
        "yaw_rate", "yawrate", "r", "omega", "omega_z", "wz", "w_z", "psi_dot", "psidot", "gyro_z",
        "heading_rate", "turn_rate", "yaw_velocity",
    ),
    "x": ("x", "px", "pos_x", "x_pos"),
    "y": ("y", "py", "pos_y", "y_pos"),
    "yaw": ("yaw", "psi", "heading", "theta", "angle"),
}  # fmt: skip
#: How headers spell units, by the unit of a mapping file: of columns by kind of unit, and of rates.
_SPELLINGS: dict[str, dict[str, tuple[str, ...]]] = {
    "time": {
        "s": ("s", "sec", "seconds"), "ms": ("ms", "msec", "milliseconds"),
        "us": ("us", "usec", "microseconds"), "ns": ("ns", "nsec", "nanoseconds"),
    },
    "length": {
        "m": ("m", "m_s", "mps"), "cm": ("cm", "cm_s", "cmps"), "mm": ("mm", "mm_s", "mmps"),
    },
    "angle": {"rad": ("rad", "rad_s", "rads"), "deg": ("deg", "deg_s", "dps", "degrees")},
}  # fmt: skip
_SPELLINGS["joint"] = _SPELLINGS["angle"]
#: Two letters that look alike, and stand for a millionth.
_MICRO = str.maketrans("µμ", "uu")
#: A joint of a chain has a number, the one of a fish with one joint may have none.
_JOINT = re.compile(
    r"(?:angle_)?(?:joint|j|servo|motor|angle|theta|q|phi)_?(?P<number>\d+)(?:_(?:angle|position|pos))?"
    r"|(?:angle_)?(?:joint|servo|motor)(?:_(?:angle|position|pos))?"
)


@dataclass(frozen=True)
class Guess:
    """What headers say of their columns.

    Attributes:
        columns: headers by key of a mapping file, where one header alone fits.
        joints: headers of joint angles, by their numbers.
    """

    columns: Mapping[str, str]
    joints: tuple[str, ...]

    @property
    def kind(self) -> Kind | None:
        """Which importer they are for: all of its columns are there; None: neither's."""
        return next((kind for kind, keys in KEYS.items() if self.columns.keys() >= set(keys)), None)


def guess(headers: Sequence[str]) -> Guess:
    """Guess what columns are: a header is a known word, alone or with a unit behind it.

    Example:
        >>> from mjfish.data.importers.recognition import guess
        >>> found = guess(["t", "u [mm/s]", "v [mm/s]", "yaw_rate_deg_s", "joint_1"])
        >>> found.kind, found.columns["yaw_rate"], found.joints
        ('velocities', 'yaw_rate_deg_s', ('joint_1',))
    """
    candidates: dict[str, list[str]] = {}
    joints: dict[int, str] = {}
    for header in headers:
        if match := _JOINT.fullmatch(_parts(header, "joint")[0]):
            joints.setdefault(int(match["number"] or 0), header)
            continue
        for key, words in _WORDS.items():
            if _parts(header, UNIT_OF[key])[0] in words:
                candidates.setdefault(key, []).append(header)
    columns = {key: found[0] for key, found in candidates.items() if len(found) == 1}
    return Guess(columns, tuple(joints[number] for number in sorted(joints)))


def units(columns: Mapping[str, str], joints: Sequence[str] = ()) -> dict[str, set[str]]:
    """Return the units that headers name, by kind of unit: ``time``, ``length``, ``angle``, ``joint``.

    Args:
        columns: headers by key of a mapping file.
        joints: headers of joint angles.

    Example:
        >>> from mjfish.data.importers.recognition import units
        >>> units({"time": "t", "surge": "u [mm/s]", "yaw_rate": "yaw_rate_deg_s"})
        {'length': {'mm'}, 'angle': {'deg'}}
    """
    kinds = [(UNIT_OF[key], header) for key, header in [*columns.items(), *(("joints", header) for header in joints)]]
    found = [(kind, unit) for kind, header in kinds if (unit := _parts(header, kind)[1])]
    return {kind: {unit for own, unit in found if own == kind} for kind, _ in found}


def named(word: str, headers: Sequence[str]) -> str:
    """Return the header of that name, or the only one that is the name with a unit behind it; else the name.

    Example:
        >>> from mjfish.data.importers.recognition import named
        >>> named("forward", ["t", "forward (mm/s)"])
        'forward (mm/s)'
    """
    if word in headers:
        return word
    alike = {header for header in headers for kind in _SPELLINGS if _plain(word) == _parts(header, kind)[0]}
    return alike.pop() if len(alike) == 1 else word


def _plain(header: str) -> str:
    return re.sub(r"[^a-z0-9]+", "_", header.lower().replace("°", "deg").translate(_MICRO)).strip("_")


def _parts(header: str, kind: str) -> tuple[str, str | None]:
    """Return the name in a header, in lower case with underscores, and the unit of a kind behind it."""
    plain = _plain(header)
    for unit, spellings in _SPELLINGS[kind].items():
        for spelling in spellings:
            if plain.endswith(f"_{spelling}"):
                return plain.removesuffix(f"_{spelling}"), unit
    return plain, None


_BAG = b"\x89MCAP0\r\n"
#: First bytes of formats: what they are, and what to do.
_FORMATS: tuple[tuple[bytes, str, str], ...] = (
    (_BAG, "a bag in the MCAP format", "import it as 'mcap' with a mapping file that names its topics"),
    (b"SQLite format 3", "a rosbag2 database", "convert it by 'ros2 bag convert' to MCAP and import it as 'mcap'"),
    (b"#ROSBAG", "a bag of ROS 1", "convert it by 'mcap convert' to MCAP and import it as 'mcap'"),
    (b"MATLAB 5.0", "a MATLAB file", "write its arrays by writetable to CSV and import that"),
    (b"\x89HDF", "an HDF5 file, or a MATLAB file of version 7.3", "write its arrays to CSV and import that"),
    (b"PAR1", "a Parquet file", "write it to CSV and import that"),
    (b"\x93NUMPY", "a NumPy array", "write it by numpy.savetxt with a header line and import that"),
    (b"PK\x03\x04", "a zip archive, such as .npz or .xlsx", "write what is in it to CSV and import that"),
    (b"\x1f\x8b", "a gzip archive", "unpack it"),
    (b"\x28\xb5\x2f\xfd", "a Zstandard archive, such as .mcap.zstd", "unpack it by 'zstd -d'"),
)
#: Types of messages that have a pose, and the field that it is in.
_POSES = {
    "geometry_msgs/msg/PoseStamped": "pose",
    "geometry_msgs/msg/PoseWithCovarianceStamped": "pose.pose",
    "nav_msgs/msg/Odometry": "pose.pose",
}
_HEAD = ("schema = 1", 'fish = "my_fish.toml"')
_WAVE = ("[wave]", "frequency = 1.0", "amplitude = [0.3]", "phase = [0.0]", "free = true")


def is_bag(path: Path) -> bool:
    """Return whether a file begins as a bag in the MCAP format does."""
    return _beginning(path).startswith(_BAG)


def _beginning(path: Path) -> bytes:
    """Return the first bytes of a file, none of what is no file."""
    if not path.is_file():
        return b""
    with path.open("rb") as stream:
        return stream.read(16)


def describe(path: Path) -> str:
    """Return what a file or folder looks like and how to import it, in one sentence; or that it does not exist."""
    try:
        check_text(path)
        header = recognise(path, Dialect()).headers
    except InputError as error:
        return str(error).removeprefix(f"{path}: ")
    known = guess(header).columns.keys()
    kind: Kind = "poses" if {"x", "y"} <= known and not {"surge", "sway"} <= known else "velocities"
    return (
        f"looks like a CSV file with the columns {', '.join(header)}; import it as '{kind}' with --map FILE, a mapping "
        f"file such as\n{_indented(example(header, kind).splitlines())}\n(units, axes and signs: docs)"
    )


def check_text(path: Path) -> None:
    """Refuse a folder, and a file that is no text.

    Raises:
        InputError: the message says what it looks like and how to import it.
    """
    beginning = _beginning(path)
    found = [f"looks like {what}; {remedy}" for magic, what, remedy in _FORMATS if beginning.startswith(magic)]
    if path.is_dir() or found:
        raise InputError(f"{path}: {_folder(path) if path.is_dir() else found[0]}")


def check_once(paths: Sequence[Path]) -> None:
    """Refuse a file that is given twice."""
    resolved = [path.resolve() for path in paths]
    for number, path in enumerate(paths):
        if resolved[number] in resolved[:number]:
            raise InputError(f"{path}: given twice, expected every file once; remove one")


def _folder(path: Path) -> str:
    bags = sorted(file.name for file in path.glob("*.mcap"))
    if bags:
        return f"is a folder with a bag; import what is in it: {', '.join(bags)}"
    if any(path.glob("*.db3")):
        return "looks like a rosbag2 folder of SQLite; convert it by 'ros2 bag convert' to MCAP and import it as 'mcap'"
    return "is a folder, expected a file; name the files in it"


def bag_example(kinds: Mapping[str, str]) -> str:
    """Return what topics of these types, by name, a bag has, and a mapping file for one with a pose."""
    listed = ", ".join(f"{topic} ({kind})" for topic, kind in sorted(kinds.items())) or "none"
    found = next((f"{topic}.{_POSES[kind]}" for topic, kind in sorted(kinds.items()) if kind in _POSES), None)
    if found is None:
        return f"has the topics {listed}"
    places = {"x": "position.x", "y": "position.y", "yaw": "orientation.yaw"}
    lines = [*_HEAD, 'kind = "poses"', *(f"{key} = {json.dumps(f'{found}.{field}')}" for key, field in places.items())]
    joints = next((topic for topic, kind in sorted(kinds.items()) if kind == "sensor_msgs/msg/JointState"), None)
    lines += ["[joints]", f'columns = ["{joints}.position.NAME"]'] if joints else _WAVE
    return f"has the topics {listed}; a mapping file such as\n{_indented(lines)}\n(units, axes and signs: docs)"


def example(header: Sequence[str], kind: Kind) -> str:
    """Return a mapping file for columns of these names, to be completed."""
    found = guess(header)
    lines = [*_HEAD, f'kind = "{kind}"', *(f"{k} = {json.dumps(found.columns.get(k, '?'))}" for k in KEYS[kind])]
    named = units({key: name for key, name in found.columns.items() if key in KEYS[kind]}, found.joints)
    alone = {of: next(iter(own)) for of, own in named.items() if len(own) == 1}
    lines += [f'{of}_unit = "{alone[of]}"' for of in ("time", "length", "angle") if of in alone]
    if found.joints:
        lines += ["[joints]", "columns = [" + ", ".join(map(json.dumps, found.joints)) + "]"]
        lines += [f'unit = "{alone["joint"]}"'] if "joint" in alone else []
    else:
        lines += _WAVE
    return "\n".join(lines)


def _indented(lines: Sequence[str]) -> str:
    return "\n".join(f"    {line}" for line in lines)
