"""What a file looks like that no importer knows, and how to map it."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path

#: First bytes of formats: what they are, and what to do.
_FORMATS: tuple[tuple[bytes, str, str], ...] = (
    (b"\x89MCAP0\r\n", "a bag in the MCAP format", "import it as 'mcap' with a mapping file that names its topics"),
    (b"SQLite format 3", "a rosbag2 database", "convert it by 'ros2 bag convert' to MCAP and import it as 'mcap'"),
    (b"#ROSBAG", "a bag of ROS 1", "convert it by 'mcap convert' to MCAP and import it as 'mcap'"),
    (b"MATLAB 5.0", "a MATLAB file", "write its arrays by writetable to CSV and import that"),
    (b"\x89HDF", "an HDF5 file, or a MATLAB file of version 7.3", "write its arrays to CSV and import that"),
    (b"PAR1", "a Parquet file", "write it to CSV and import that"),
    (b"\x93NUMPY", "a NumPy array", "write it by numpy.savetxt with a header line and import that"),
    (b"PK\x03\x04", "a zip archive, such as .npz or .xlsx", "write what is in it to CSV and import that"),
    (b"\x1f\x8b", "a gzip archive", "unpack it"),
)
_BEGINNING = 512
#: Words that columns go by, in the order in which a mapping file has them.
_WORDS = {
    "time": ("time", "t", "timestamp", "time_s", "sec", "seconds"),
    "surge": ("surge", "u", "vx", "v_x", "forward"),
    "sway": ("sway", "v", "vy", "v_y", "lateral"),
    "yaw_rate": ("yaw_rate", "yawrate", "r", "omega", "wz", "psi_dot", "gyro_z"),
    "x": ("x", "px", "pos_x", "x_m"),
    "y": ("y", "py", "pos_y", "y_m"),
    "yaw": ("yaw", "psi", "heading", "theta", "angle"),
}


def describe(path: Path) -> str:
    """Return what a file looks like and how to import it, in one sentence; or that it does not exist."""
    if not path.is_file():
        return "no such file; correct its name"
    with path.open("rb") as stream:
        beginning = stream.read(_BEGINNING)
    for magic, what, remedy in _FORMATS:
        if beginning.startswith(magic):
            return f"looks like {what}; {remedy}"
    header = columns(beginning)
    if header is None:
        return "looks like no table of numbers; write the recording to a CSV file with a header line and import that"
    return f"looks like a CSV file with the columns {', '.join(header)}; {_how(header)}"


def columns(beginning: bytes) -> list[str] | None:
    """Return the columns of a CSV file by its first bytes; None where they are no text with commas."""
    try:
        line = beginning.decode("utf-8", errors="strict" if len(beginning) < _BEGINNING else "ignore").splitlines()[0]
    except (UnicodeDecodeError, IndexError):
        return None
    row = [cell.strip() for cell in next(csv.reader([line]), [])]
    return row if len(row) > 1 and line.isprintable() else None


def example(header: Sequence[str], kind: str) -> str:
    """Return a mapping file for columns of these names, to be completed."""
    keys = ("time", "surge", "sway", "yaw_rate") if kind == "velocities" else ("time", "x", "y", "yaw")
    found = {key: next((name for name in header if _plain(name) in _WORDS[key]), "?") for key in keys}
    lines = ["schema = 1", f'kind = "{kind}"', 'fish = "my_fish.toml"', *(f'{k} = "{v}"' for k, v in found.items())]
    joints = [
        name for name in header if name not in found.values() and _plain(name).startswith(("j", "servo", "angle"))
    ]
    if joints:
        lines += ["[joints]", "columns = [" + ", ".join(f'"{name}"' for name in joints) + "]"]
    else:
        lines += ["[wave]", "frequency = 1.0", "amplitude = [0.3]", "phase = [0.0]", "free = true"]
    return "\n".join(lines)


def _how(header: Sequence[str]) -> str:
    known = {key for name in header for key, words in _WORDS.items() if _plain(name) in words}
    kind = "poses" if {"x", "y"} <= known and not {"surge", "sway"} <= known else "velocities"
    text = "\n".join(f"    {line}" for line in example(header, kind).splitlines())
    return f"import it as '{kind}' with --map FILE, a mapping file such as\n{text}\n(units, axes and signs: docs)"


def _plain(name: str) -> str:
    """Return the name of a column without its unit."""
    return name.split("[")[0].split("(")[0].strip().lower().replace(" ", "_")
