"""What a file looks like that no importer knows, and how to map it."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

from mjfish.data.dialect import Dialect, recognise
from mjfish.data.importers.headers import KEYS, Kind, guess, units
from mjfish.errors import InputError

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
    return f"looks like a CSV file with the columns {', '.join(header)}; {_how(header)}"


def check_text(path: Path) -> None:
    """Refuse a folder, and a file that is no text.

    Raises:
        InputError: the message says what it looks like and how to import it.
    """
    beginning = _beginning(path)
    found = [f"looks like {what}; {remedy}" for magic, what, remedy in _FORMATS if beginning.startswith(magic)]
    if path.is_dir():
        found = [_folder(path)]
    if found:
        raise InputError(f"{path}: {found[0]}")


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
    lines = [*_HEAD, f'kind = "{kind}"']
    lines += [f"{key} = {json.dumps(found.columns.get(key, '?'))}" for key in KEYS[kind]]
    named = units({key: name for key, name in found.columns.items() if key in KEYS[kind]}, found.joints)
    alone = {of: next(iter(own)) for of, own in named.items() if len(own) == 1}
    lines += [f'{of}_unit = "{alone[of]}"' for of in ("time", "length", "angle") if of in alone]
    if found.joints:
        lines += ["[joints]", "columns = [" + ", ".join(map(json.dumps, found.joints)) + "]"]
        lines += [f'unit = "{alone["joint"]}"'] if "joint" in alone else []
    else:
        lines += _WAVE
    return "\n".join(lines)


def _how(header: Sequence[str]) -> str:
    known = guess(header).columns.keys()
    kind: Kind = "poses" if {"x", "y"} <= known and not {"surge", "sway"} <= known else "velocities"
    text = _indented(example(header, kind).splitlines())
    return f"import it as '{kind}' with --map FILE, a mapping file such as\n{text}\n(units, axes and signs: docs)"


def _indented(lines: Sequence[str]) -> str:
    return "\n".join(f"    {line}" for line in lines)
