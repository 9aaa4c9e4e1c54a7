"""The numbers in a bag of the MCAP format: messages of topics, and fields of messages by name."""

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

from mjfish.data.cells import LARGEST
from mjfish.data.importers.unknown import describe, is_bag
from mjfish.errors import InputError, UnknownNameError
from mjfish.numerics.arrays import FloatArray

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
        _check_chunks(path)
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
    for field, column in zip(fields, table.T, strict=True):
        if np.isnan(column).all() and entries:
            raise UnknownNameError(f"field in {place}:", field.rpartition(".")[2], entries)
        if np.isnan(column).all():
            raise InputError(f"{place}: '{field}' is never a number; name another field in the mapping file")
    columns = {field: table[:, k] for k, field in enumerate(fields)}
    return Messages(np.array(stamps, dtype=np.int64), np.array(logged, dtype=np.int64), columns)


def _decoded(path: Path, wanted: list[str]) -> Iterator[tuple[str, int, Any]]:
    """Yield topic, time of the recorder [ns] and message."""
    with _readable(path), path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
        for _, channel, message, decoded in reader.iter_decoded_messages(topics=wanted):
            yield channel.topic, message.log_time, decoded


def _check_chunks(path: Path) -> None:
    """Refuse a bag that is small on disk and too large in memory, whatever it says of its size."""
    with path.open("rb") as stream:
        for record in StreamReader(stream, emit_chunks=True).records:
            if isinstance(record, Chunk) and unpacks_beyond(record, LARGEST_CHUNK):
                raise InputError(
                    f"{path}: a chunk unpacks to more than {LARGEST_CHUNK} bytes; record it with smaller chunks, or "
                    "'mcap filter' it"
                )


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
