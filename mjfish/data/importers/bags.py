"""Importer of bags in the MCAP format, which ROS 2 records by default.

A mapping file of kind ``poses`` or ``velocities`` names columns by topic and field:
``/fish/odom.pose.pose.position.x``. Two fields are not in a message as they stand: ``yaw`` of a quaternion
(``/fish/odom.pose.pose.orientation.yaw``), and one entry of a list that has names beside it, as those of
``sensor_msgs/JointState`` (``/joint_states.position.tail``).

Every topic has a clock of its own. The rows are the messages of the first topic that is named; the others are
interpolated to their times between neighbours, where these are near.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce
from pathlib import Path
from typing import Any

import numpy as np
from mcap.exceptions import McapError
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from mjfish import tomlfile
from mjfish.arrays import FloatArray, readonly
from mjfish.data import Dataset
from mjfish.data.importers.report import ImportReport
from mjfish.data.importers.tables import Columns, import_poses, import_velocities
from mjfish.errors import InputError, UnknownNameError

_KINDS = {"poses": import_poses, "velocities": import_velocities}
#: Neighbours farther apart than so many median steps of their topic have nothing in between.
_GAP = 5.0
_YAW = "yaw"


def import_mcap(
    files: Sequence[Path], held_out: Sequence[str] = (), mapping: Path | None = None
) -> tuple[Dataset, ImportReport]:
    """Turn bags into a dataset, by a mapping file of kind ``poses`` or ``velocities``.

    Args:
        files: one a run.
        held_out: names of trials not to be fitted.
        mapping: its columns are ``TOPIC.FIELD``; the key ``time`` is not used.

    Raises:
        MjfishError: as of `import_poses` and `import_velocities`; a bag cannot be read, has no such topic or field, or
            no message of it.
    """
    if mapping is None:
        raise InputError("importer 'mcap' needs a mapping file that names topics; give --map FILE")
    kind = tomlfile.table(mapping).get("kind")
    if kind not in _KINDS:
        raise InputError(f"{mapping}: kind is {kind!r}, expected 'poses' or 'velocities'; correct it")
    return _KINDS[kind](files, held_out, mapping, importer="mcap", read=read_bag)


@dataclass(frozen=True, eq=False)
class _Topic:
    """The messages of one topic: times (n,) [s], their fields (n, k) by name, and what was found odd."""

    name: str
    time: FloatArray
    fields: dict[str, FloatArray]
    notes: tuple[str, ...]

    def at(self, time: FloatArray, field: str) -> FloatArray:
        """Return a field at other times [s]; NaN where no message is near."""
        values = self.fields[field]
        if len(self.time) < 2:
            return np.full_like(time, np.nan)
        right = np.clip(np.searchsorted(self.time, time), 1, len(self.time) - 1)
        apart = self.time[right] - self.time[right - 1]
        near = (time >= self.time[0]) & (time <= self.time[-1]) & (apart <= _GAP * np.median(np.diff(self.time)))
        return np.asarray(np.where(near, np.interp(time, self.time, values), np.nan))


def read_bag(path: Path, time: str, names: Sequence[str]) -> Columns:
    """Return columns of a bag by name, with that of the time [s] from the first message on.

    Args:
        path: of the bag.
        time: name of the column of the time.
        names: of the others, ``TOPIC.FIELD``.
    """
    wanted: dict[str, list[str]] = {}
    for name in names:
        topic, dot, field = name.partition(".")
        if not (topic.startswith("/") and dot and field):
            raise InputError(
                f"{path}: column '{name}' names no field of a topic, expected e.g. /fish/odom.pose.pose.position.x; "
                "correct the mapping file"
            )
        wanted.setdefault(topic, []).append(field)
    topics = _topics(path, wanted)
    rows = topics[next(iter(wanted))]
    columns = {time: readonly(rows.time - rows.time[0])}
    for name in names:
        topic, _, field = name.partition(".")
        own = topics[topic]
        columns[name] = readonly(own.fields[field] if own is rows else own.at(rows.time, field))
    notes = [f"rows are the messages of {rows.name}", *(note for topic in topics.values() for note in topic.notes)]
    notes += [f"{topic.name} interpolated to them" for topic in topics.values() if topic is not rows]
    return Columns(columns, tuple(notes))


def _topics(path: Path, wanted: dict[str, list[str]]) -> dict[str, _Topic]:
    """Read the wanted fields of every topic."""
    found: dict[str, list[tuple[float, float, list[float]]]] = {topic: [] for topic in wanted}
    known: dict[str, str] = {}
    try:
        with path.open("rb") as stream:
            reader = make_reader(stream, decoder_factories=[DecoderFactory()])
            summary = reader.get_summary()
            if summary is not None:
                known = {c.topic: summary.schemas[c.schema_id].name for c in summary.channels.values() if c.schema_id}
            for schema, channel, message, decoded in reader.iter_decoded_messages(topics=list(wanted)):
                known[channel.topic] = schema.name if schema else ""
                place = f"{path}: topic {channel.topic} ({known[channel.topic]})"
                values = [_value(decoded, field, place) for field in wanted[channel.topic]]
                found[channel.topic].append((_stamp(decoded), 1e-9 * message.log_time, values))
    except FileNotFoundError:
        raise InputError(f"{path}: no such file; correct its name") from None
    except (McapError, OSError) as error:
        raise InputError(
            f"{path}: cannot be read as MCAP: {error or type(error).__name__}; where the recording broke off, mend it "
            "by 'mcap recover'"
        ) from None
    for topic, messages in found.items():
        if topic not in known:
            raise UnknownNameError(f"topic in {path}", topic, [f"{name} ({kind})" for name, kind in known.items()])
        if not messages:
            raise InputError(f"{path}: topic {topic} has no message, expected one a frame; record it, or name another")
    return {topic: _in_order(topic, wanted[topic], messages) for topic, messages in found.items()}


def _in_order(topic: str, fields: list[str], messages: list[tuple[float, float, list[float]]]) -> _Topic:
    """Return the messages of a topic by time, each time once."""
    stamped = all(stamp > 0.0 for stamp, _, _ in messages)
    time = np.array([stamp if stamped else logged for stamp, logged, _ in messages])
    values = np.array([row for _, _, row in messages])
    notes = [f"{topic}: times of {'its headers' if stamped else 'the recorder'}"]
    if np.any(np.diff(time) < 0.0):
        notes.append(f"{topic}: messages out of order, sorted")
    time, first = np.unique(time, return_index=True)
    if lost := len(messages) - len(time):
        notes.append(f"{topic}: {lost} repeated messages left out")
    values = values[first]
    columns = {field: _unwrapped(values[:, k], field) for k, field in enumerate(fields)}
    return _Topic(topic, time, columns, tuple(notes))


def _unwrapped(values: FloatArray, field: str) -> FloatArray:
    return np.unwrap(values) if field.endswith(f".{_YAW}") else values


def _stamp(message: Any) -> float:
    """Return the time of a message's header [s]; 0 where it has none."""
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    return 0.0 if stamp is None else stamp.sec + 1e-9 * stamp.nanosec


def _value(message: Any, field: str, place: str) -> float:
    """Return a number of a message by its path of fields."""
    path = field.split(".")
    value = reduce(lambda owner, key: _part(owner, key, message, place), path, message)
    if not isinstance(value, int | float):
        raise InputError(f"{place}: '{field}' is no number; name a field below it in the mapping file")
    return float(value)


def _part(owner: Any, key: str, message: Any, place: str) -> Any:
    """Return a field of a message, the yaw of a quaternion, or the entry of a list by its name."""
    if key == _YAW and all(hasattr(owner, axis) for axis in "xyzw"):
        return float(np.arctan2(2.0 * (owner.w * owner.z + owner.x * owner.y), 1.0 - 2.0 * (owner.y**2 + owner.z**2)))
    if hasattr(owner, key):
        return getattr(owner, key)
    names = list(getattr(message, "name", []))
    listed = hasattr(owner, "__getitem__") and not isinstance(owner, str)
    if listed and key in names and names.index(key) < len(owner):
        return owner[names.index(key)]
    fields = names if listed else [name for name in dir(owner) if not name.startswith("_")]
    raise UnknownNameError(f"field in {place}:", key, [str(name) for name in fields])
