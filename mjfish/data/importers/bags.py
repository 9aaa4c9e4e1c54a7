"""Importer of bags in the MCAP format, which ROS 2 records by default.

A mapping file of kind ``poses`` or ``velocities`` names columns by topic and field:
``/fish/odom.pose.pose.position.x``. Two fields are not in a message as they stand: ``yaw`` of a quaternion
(``/fish/odom.pose.pose.orientation.yaw``), and one entry of a list, by the name beside it as in
``sensor_msgs/JointState`` (``/joint_states.position.tail``) or by its number (``/commands.data.0``).

Every topic has a clock of its own. The rows are the messages of the first topic that is named; the others are
interpolated to their times between neighbours, where these are near.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.interpolate import Akima1DInterpolator

from mjfish.data import Dataset
from mjfish.data.importers.bag_messages import MOST, Messages, read_messages, topics
from mjfish.data.importers.mapping import MAPS, PosesMap, VelocitiesMap
from mjfish.data.importers.report import ImportReport
from mjfish.data.importers.tables import Columns, import_tables
from mjfish.data.importers.unknown import bag_example
from mjfish.data.validation import GAP
from mjfish.errors import InputError
from mjfish.files import tomlfile
from mjfish.numerics.arrays import FloatArray, readonly

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
        notes = []
        timed = messages.stamps > 0 if headers else np.ones(len(messages.logged), dtype=np.bool_)
        if bare := int((~timed).sum()):
            notes.append(f"{name}: {bare} messages without a time left out")
        time = (messages.stamps if headers else messages.logged)[timed]
        if np.any(np.diff(time) < 0):
            notes.append(f"{name}: messages out of order, sorted")
        unique, first = np.unique(time, return_index=True)
        if repeated := len(time) - len(unique):
            notes.append(f"{name}: {repeated} repeated messages left out")
        fields = {field: _unwrapped(values[timed][first], field) for field, values in messages.fields.items()}
        return cls(name, unique, fields, tuple(notes))

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
    time, notes = rows.time[inside], []
    if cut := len(rows.time) - len(inside):
        notes.append(f"{rows.name}: {cut} messages at the ends left out, where another topic has none")
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
    if field.rpartition(".")[2] != "yaw":
        return values
    turned, known = values.copy(), np.isfinite(values)
    turned[known] = np.unwrap(values[known])
    return turned
