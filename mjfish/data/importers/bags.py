"""Importer of bags in the MCAP format, which ROS 2 records by default: messages of topics, fields of them by name.

A mapping file of kind ``poses`` or ``velocities`` names columns by topic and field:
``/fish/odom.pose.pose.position.x``. Two fields are not in a message as they stand: ``yaw`` of a quaternion
(``/fish/odom.pose.pose.orientation.yaw``), and one entry of a list, by the name beside it as in
``sensor_msgs/JointState`` (``/joint_states.position.tail``) or by its number (``/commands.data.0``).

Every topic has a clock of its own. The rows are the messages of the first topic that is named; the others are
interpolated to their times between neighbours, where these are near.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import reduce
from pathlib import Path
from typing import Any

import lz4.frame
import numpy as np
import zstandard
from mcap.exceptions import DecoderNotFoundError
from mcap.reader import make_reader
from mcap.records import Chunk
from mcap.stream_reader import StreamReader
from mcap_ros2.decoder import DecoderFactory
from scipy.interpolate import Akima1DInterpolator

from mjfish.data import Dataset
from mjfish.data.columns import LARGEST
from mjfish.data.importers.mapping import MAPS, PosesMap, VelocitiesMap
from mjfish.data.importers.recognition import bag_example, describe, is_bag
from mjfish.data.importers.tables import Columns, import_tables
from mjfish.data.importers.trials import ImportReport
from mjfish.data.validation import GAP
from mjfish.errors import InputError, UnknownNameError
from mjfish.files import tomlfile
from mjfish.numerics.arrays import FloatArray, readonly

_YAW = "yaw"
#: Messages that are read of a bag, and rows that they may stand for.
MOST = 2_000_000
#: Largest part of a bag once it is unpacked [bytes]; recorders write some MiB.
LARGEST_CHUNK = 128 * 2**20
#: Latest time of a message [ns]: in the year 2116; differences of such times are whole numbers of 64 bits.
_LATEST = 2**62


@dataclass(frozen=True, eq=False)
class Messages:
    """Messages of one topic, as recorded.

    Attributes:
        stamps: (n,) times of their headers [ns], whole numbers; 0 where there is none.
        logged: (n,) times at which they were recorded [ns].
        fields: (n,) by name; NaN where a message has no number there, an infinite one, or one beyond all measurement.
    """

    stamps: np.ndarray[Any, np.dtype[np.int64]]
    logged: np.ndarray[Any, np.dtype[np.int64]]
    fields: dict[str, FloatArray]


def topics(path: Path) -> dict[str, str]:
    """Return the types of a bag's topics by name.

    Raises:
        InputError: no such bag, or it is damaged.
    """
    if not is_bag(path):
        raise InputError(f"{path}: {describe(path)}")
    with _readable(path):
        with path.open("rb") as stream:
            for record in StreamReader(stream, emit_chunks=True).records:
                # A bag may be small on disk and too large in memory, whatever it says of its size.
                if isinstance(record, Chunk) and unpacks_beyond(record, LARGEST_CHUNK):
                    raise InputError(
                        f"{path}: a chunk unpacks to more than {LARGEST_CHUNK} bytes; record it with smaller chunks, "
                        "or 'mcap filter' it"
                    )
        with path.open("rb") as stream:
            reader = make_reader(stream, validate_crcs=True)
            summary = reader.get_summary()
            if summary is None:
                return {channel.topic: schema.name if schema else "" for schema, channel, _ in reader.iter_messages()}
            names = {number: schema.name for number, schema in summary.schemas.items()}
            return {channel.topic: names.get(channel.schema_id, "") for channel in summary.channels.values()}


@contextmanager
def _readable(path: Path) -> Iterator[None]:
    """Say that a bag is damaged where the libraries below, which raise whatever they stumble on, find it so."""
    try:
        yield
    except InputError:
        raise
    except DecoderNotFoundError as error:
        raise InputError(
            f"{path}: a message is not as ROS 2 writes them, CDR with a ros2msg definition ({error}); record it so"
        ) from None
    except Exception as error:
        why = str(error) or type(error).__name__
        raise InputError(
            f"{path}: cannot be read as MCAP, it breaks off or is damaged ({why}); mend it by 'mcap recover'"
        ) from None


def read_messages(path: Path, wanted: Mapping[str, Sequence[str]]) -> dict[str, Messages]:
    """Return the messages of topics, with the fields that are wanted of each.

    Raises:
        InputError: no such bag, it is damaged, or a topic has no message; a field is no number.
        UnknownNameError: no such topic or field.
    """
    known = topics(path)
    for topic in wanted:
        if topic not in known:
            raise UnknownNameError(f"topic in {path}", topic, [f"{name} ({kind})" for name, kind in known.items()])
    rows: dict[str, list[tuple[int, int, list[float]]]] = {topic: [] for topic in wanted}
    entries: dict[str, set[str]] = {topic: set() for topic in wanted}
    for count, (topic, logged, message) in enumerate(_decoded(path, list(wanted))):
        if count == MOST:
            raise InputError(f"{path}: has more than {MOST} messages of these topics; cut it by 'mcap filter'")
        place = f"{path}: topic {topic} ({known[topic]})"
        entries[topic].update(getattr(message, "name", ()))
        values = [_value(message, field, place) for field in wanted[topic]]
        rows[topic].append((_stamp(message, place), _nanoseconds(logged, place), values))
    for topic, found in rows.items():
        if not found:
            raise InputError(f"{path}: topic {topic} has no message, expected one a frame; record it, or name another")
    return {
        topic: _messages(found, wanted[topic], entries[topic], f"{path}: topic {topic} ({known[topic]})")
        for topic, found in rows.items()
    }


def _messages(
    rows: list[tuple[int, int, list[float]]], fields: Sequence[str], entries: set[str], place: str
) -> Messages:
    stamps, logged, values = zip(*rows, strict=True)
    table = np.array(values)
    table[np.abs(table) > LARGEST] = np.nan
    columns = dict(zip(fields, table.T, strict=True))
    for field in (field for field, column in columns.items() if np.isnan(column).all()):
        if entries:
            raise UnknownNameError(f"field in {place}:", field.rpartition(".")[2], entries)
        raise InputError(f"{place}: '{field}' is never a number; name another field in the mapping file")
    return Messages(np.array(stamps, dtype=np.int64), np.array(logged, dtype=np.int64), columns)


def _decoded(path: Path, wanted: list[str]) -> Iterator[tuple[str, int, Any]]:
    """Yield topic, time of the recorder [ns] and message."""
    with _readable(path), path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
        for _, channel, message, decoded in reader.iter_decoded_messages(topics=wanted):
            yield channel.topic, message.log_time, decoded


def unpacks_beyond(chunk: Chunk, most: int) -> bool:
    """Return whether a chunk has more than so many bytes once it is unpacked; no more are unpacked to find out."""
    if chunk.compression == "lz4":
        return len(lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, max_length=most + 1)) > most
    if chunk.compression == "zstd":
        return len(zstandard.ZstdDecompressor().stream_reader(chunk.data).read(most + 1)) > most
    return len(chunk.data) > most


def _stamp(message: Any, place: str) -> int:
    """Return the time of a message's header [ns]; 0 where it has none."""
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    sec, nanosec = getattr(stamp, "sec", 0), getattr(stamp, "nanosec", 0)
    if not (isinstance(sec, int) and isinstance(nanosec, int)):
        raise InputError(f"{place}: header.stamp is no time of ROS 2, expected whole numbers sec and nanosec; mend it")
    return _nanoseconds(sec * 10**9 + nanosec, place)


def _nanoseconds(time: int, place: str) -> int:
    if abs(time) > _LATEST:
        raise InputError(
            f"{place}: a message at {1e-9 * time:.3g} s, expected a time since 1970; leave that message out"
        )
    return time


def _value(message: Any, field: str, place: str) -> float:
    """Return a number of a message by its path of fields; NaN where a list has no such entry."""
    value = reduce(lambda owner, key: _part(owner, key, message, place), field.split("."), message)
    if not isinstance(value, int | float):
        raise InputError(f"{place}: '{field}' is no number; name a field below it in the mapping file")
    return float(value)


def _part(owner: Any, key: str, message: Any, place: str) -> Any:
    """Return a field of a message, the yaw of a quaternion, or the entry of a list by its name or number."""
    if key == _YAW and all(hasattr(owner, axis) for axis in "xyzw"):
        return yaw(owner.x, owner.y, owner.z, owner.w)
    if isinstance(owner, float) and np.isnan(owner):
        return owner
    if hasattr(owner, "__getitem__") and not isinstance(owner, str):
        names = list(getattr(message, "name", ()))
        index = names.index(key) if key in names else int(key) if key.isdecimal() else len(owner)
        return owner[index] if index < len(owner) else np.nan
    if hasattr(owner, "__slots__") and hasattr(owner, key):
        return getattr(owner, key)
    raise UnknownNameError(f"field in {place}:", key, getattr(owner, "__slots__", ()))


def yaw(x: float, y: float, z: float, w: float) -> float:
    """Return the yaw of a quaternion of any length [rad]; NaN of a zero one, which trackers send for a lost body."""
    if x == y == z == w == 0.0:
        return np.nan
    return float(np.arctan2(2.0 * (w * z + x * y), w * w + x * x - y * y - z * z))


#: Neighbours farther apart than so many median steps of their topic have nothing in between.
_NEAR = 5.0
#: Headers of two topics that lag the recorder by amounts that differ by more than this have different clocks [s].
_ONE_CLOCK = 1.0


def import_mcap(
    files: Sequence[Path], held_out: Sequence[str] = (), mapping: Path | None = None
) -> tuple[Dataset, ImportReport]:
    """Turn bags into a dataset, by a mapping file of kind ``poses`` or ``velocities``.

    Args:
        files: one a run.
        held_out: names of trials not to be fitted.
        mapping: its columns are ``TOPIC.FIELD``; the key ``time`` is not used.

    Raises:
        MjfishError: as of `import_tables`; a bag cannot be read, has no such topic or field, or
            no message of it.
    """
    if mapping is None:
        raise InputError(
            "importer 'mcap' needs a mapping file that names topics, give --map FILE; "
            f"{files[0]} {bag_example(topics(files[0]))}"
        )
    table = tomlfile.table(mapping)
    kind = table.get("kind")
    if kind not in MAPS:
        raise InputError(f"{mapping}: kind is {kind!r}, expected 'poses' or 'velocities'; correct it")
    if table.get("time_unit", "s") != "s":
        raise InputError(f"{mapping}: time_unit: the times of a bag are in seconds; remove it")
    return import_tables(files, held_out, mapping, model=MAPS[kind], importer="mcap", read=read_bag)


def read_bag(path: Path, table: PosesMap | VelocitiesMap, names: Sequence[str]) -> Columns:
    """Return columns of a bag by name, with that of the time [s] from the first row on.

    Args:
        path: of the bag.
        table: what they are; of poses, what rows lack of their own topic is left out, not interpolated.
        names: of the columns but that of the time, ``TOPIC.FIELD``.

    Raises:
        MjfishError: as of `import_mcap`.
    """
    fields: dict[str, list[str]] = {}
    for name in names:
        topic, dot, field = name.partition(".")
        if not (topic.startswith("/") and dot and field):
            raise InputError(
                f"{path}: column '{name}' names no field of a topic, expected e.g. /fish/odom.pose.pose.position.x; "
                "correct the mapping file"
            )
        fields.setdefault(topic, []).append(field)
    read = read_messages(path, fields)
    headers, notes = _clock(read)
    clocked = {topic: _Topic.of(topic, messages, headers) for topic, messages in read.items()}
    notes += [note for topic in clocked.values() for note in topic.notes]
    rows = next(iter(clocked.values()))
    grid, own, lost = _rows(rows, clocked, path)
    columns, filled = {table.time: readonly(1e-9 * (grid - grid[0]))}, np.zeros(len(grid), dtype=np.bool_)
    for name in names:
        topic, _, field = name.partition(".")
        values = clocked[topic].at(grid, field)
        if clocked[topic] is rows:
            told = np.where(own >= 0, rows.fields[field][own], np.nan)
            values = told if isinstance(table, PosesMap) else np.where(np.isfinite(told), told, values)
            filled |= np.isnan(told) & np.isfinite(values)
        columns[name] = readonly(values)
    if filled.any():
        lost.append(f"{rows.name}: {int(filled.sum())} rows interpolated")
    return Columns(columns, (f"rows are the messages of {rows.name}", *notes, *lost))


def _clock(read: Mapping[str, Messages]) -> tuple[bool, list[str]]:
    """Return whether the headers' times count, and why not: all topics need times of one clock."""
    bare = [topic for topic, messages in read.items() if np.count_nonzero(messages.stamps) < 0.5 * len(messages.stamps)]
    if bare:
        return False, [f"times of the recorder: {', '.join(bare)} without times in the headers"]
    late = {topic: 1e-9 * float(np.median((m.logged - m.stamps)[m.stamps > 0])) for topic, m in read.items()}
    apart = max(late.values()) - min(late.values())
    if apart > _ONE_CLOCK:
        first, last = min(late, key=lambda topic: late[topic]), max(late, key=lambda topic: late[topic])
        return False, [f"times of the recorder: the headers of {first} and {last} are {apart:.3g} s apart"]
    return True, ["times of the headers"]


@dataclass(frozen=True, eq=False)
class _Topic:
    """The messages of one topic by time: times (n,) [ns], their fields (n,) by name, and what was found odd."""

    name: str
    time: np.ndarray[tuple[int], np.dtype[np.int64]]
    fields: dict[str, FloatArray]
    notes: tuple[str, ...]

    @classmethod
    def of(cls, name: str, messages: Messages, headers: bool) -> _Topic:
        """Return the messages in order, each time once."""
        timed = messages.stamps > 0 if headers else np.ones(len(messages.logged), dtype=np.bool_)
        time = (messages.stamps if headers else messages.logged)[timed]
        unique, first = np.unique(time, return_index=True)
        bare, repeated = int((~timed).sum()), len(time) - len(unique)
        notes = {
            f"{name}: {bare} messages without a time left out": bare > 0,
            f"{name}: messages out of order, sorted": bool(np.any(np.diff(time) < 0)),
            f"{name}: {repeated} repeated messages left out": repeated > 0,
        }
        fields = {field: _unwrapped(values[timed][first], field) for field, values in messages.fields.items()}
        return cls(name, unique, fields, tuple(note for note, applies in notes.items() if applies))

    @property
    def step(self) -> float:
        """Median step [ns]; 0 with one message."""
        return float(np.median(np.diff(self.time))) if len(self.time) > 1 else 0.0

    def at(self, time: np.ndarray[tuple[int], np.dtype[np.int64]], field: str) -> FloatArray:
        """Return a field at other times [ns]; NaN where no message is near."""
        known = np.isfinite(self.fields[field])
        own, values = self.time[known], self.fields[field][known]
        if len(own) < 2:
            return np.full(len(time), np.nan)
        right = np.clip(np.searchsorted(own, time), 1, len(own) - 1)
        near = (time >= own[0]) & (time <= own[-1]) & (own[right] - own[right - 1] <= _NEAR * self.step)
        # Akima's curve is local: what lies beyond a gap, or a jump of a command, does not bend it elsewhere.
        curve = Akima1DInterpolator(1e-9 * (own - own[0]), values, method="makima")
        return np.asarray(np.where(near, curve(1e-9 * (time - own[0])), np.nan))


def _rows(
    rows: _Topic, all_: Mapping[str, _Topic], path: Path
) -> tuple[np.ndarray[tuple[int], np.dtype[np.int64]], np.ndarray[tuple[int], np.dtype[np.intp]], list[str]]:
    """Return the times of the rows [ns], lost ones too, the message of each (-1: lost), and what was done."""
    start, end = max(topic.time[0] for topic in all_.values()), min(topic.time[-1] for topic in all_.values())
    inside = np.flatnonzero((rows.time >= start) & (rows.time <= end))
    if len(inside) < 2:
        spans = ", ".join(
            f"{t.name} {1e-9 * (t.time[0] - rows.time[0]):.3f} to {1e-9 * (t.time[-1] - rows.time[0]):.3f} s"
            for t in all_.values()
        )
        raise InputError(f"{path}: no messages of all topics at one time ({spans}); record them together")
    time, cut = rows.time[inside], len(rows.time) - len(inside)
    notes = [f"{rows.name}: {cut} messages at the ends left out, where another topic has none"] if cut else []
    missed = np.where(np.diff(time) > GAP * rows.step, np.rint(np.diff(time) / rows.step).astype(np.int64) - 1, 0)
    missed = np.maximum(missed, np.diff(time) > GAP * rows.step)
    if missed.any():
        longest = 1e-9 * float(np.diff(time).max())
        notes.append(f"{rows.name}: {int(missed.sum())} messages lost, longest gap {longest:.3f} s")
    if missed.sum(dtype=np.float64) > MOST:
        raise InputError(
            f"{path}: {rows.name} has {len(time)} messages, one every {1e-9 * rows.step:.3g} s, over "
            f"{1e-9 * float(time[-1] - time[0]):.3g} s; cut the bag to the run"
        )
    number = np.concatenate([[0], np.cumsum(missed + 1)])
    own = np.full(int(number[-1]) + 1, -1)
    own[number] = inside
    grid = np.rint(np.interp(np.arange(len(own)), number, time - time[0])).astype(np.int64) + time[0]
    return grid, own, [*notes, *(f"{t.name} interpolated to the rows" for t in all_.values() if t is not rows)]


def _unwrapped(values: FloatArray, field: str) -> FloatArray:
    """Return angles without jumps where the field is one; missing ones stay so."""
    if field.rpartition(".")[2] != _YAW:
        return values
    turned, known = values.copy(), np.isfinite(values)
    turned[known] = np.unwrap(values[known])
    return turned
