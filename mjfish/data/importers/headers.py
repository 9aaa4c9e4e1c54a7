"""What the columns of a laboratory's table are, guessed from their headers, with the units that these name."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

#: Columns of the importers of tables, in the order in which a mapping file has them.
KEYS: Mapping[str, tuple[str, ...]] = {
    "velocities": ("time", "surge", "sway", "yaw_rate"),
    "poses": ("time", "x", "y", "yaw"),
}
Kind = Literal["velocities", "poses"]
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
        if set(KEYS["velocities"]) <= set(self.columns):
            return "velocities"
        return "poses" if set(KEYS["poses"]) <= set(self.columns) else None


def guess(headers: Sequence[str]) -> Guess:
    """Guess what columns are: a header is a known word, alone or with a unit behind it.

    Example:
        >>> from mjfish.data.importers.headers import guess
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
        >>> from mjfish.data.importers.headers import units
        >>> units({"time": "t", "surge": "u [mm/s]", "yaw_rate": "yaw_rate_deg_s"})
        {'length': {'mm'}, 'angle': {'deg'}}
    """
    kinds = [(UNIT_OF[key], header) for key, header in [*columns.items(), *(("joints", header) for header in joints)]]
    found = [(kind, unit) for kind, header in kinds if (unit := _parts(header, kind)[1])]
    return {kind: {unit for own, unit in found if own == kind} for kind, _ in found}


def named(word: str, headers: Sequence[str]) -> str:
    """Return the header of that name, or the only one that is the name with a unit behind it; else the name.

    Example:
        >>> from mjfish.data.importers.headers import named
        >>> named("forward", ["t", "forward (mm/s)"])
        'forward (mm/s)'
    """
    if word in headers:
        return word
    alike = [header for header in headers for kind in _SPELLINGS if _plain(word) == _parts(header, kind)[0]]
    return alike[0] if len(set(alike)) == 1 else word


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
