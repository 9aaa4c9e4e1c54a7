"""Inputs that ended in an exception of some library, in a warning, or never, before they were refused."""

from __future__ import annotations

import json
import pickle
from collections.abc import Callable
from io import BytesIO
from pathlib import Path
from types import SimpleNamespace as Message
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest
import readers
from mcap_ros2.writer import Writer
from readers import Reader

from mjfish.errors import MjfishError

Edit = Callable[[bytes], bytes]


def _column(number: int, text: str) -> Edit:
    """Put a text into every row of a column."""

    def edit(raw: bytes) -> bytes:
        head, *rows = (line.split(",") for line in raw.decode().rstrip().split("\n"))
        for row in rows:
            row[number] = text
        return "\n".join(",".join(row) for row in [head, *rows]).encode()

    return edit


def _cell(row: int, column: int, text: str) -> Edit:
    def edit(raw: bytes) -> bytes:
        lines = [line.split(",") for line in raw.decode().rstrip().split("\n")]
        lines[row][column] = text
        return "\n".join(",".join(line) for line in lines).encode()

    return edit


def _spaced(edit: Edit) -> Edit:
    return lambda raw: edit(raw.replace(b" ", b",")).replace(b",", b" ")


def _times(scale: float) -> Edit:
    """Stretch the times of a run."""

    def edit(raw: bytes) -> bytes:
        head, *rows = (line.split(",") for line in raw.decode().rstrip().split("\n"))
        return "\n".join(",".join(row) for row in [head, *([str(scale * float(t)), *r] for t, *r in rows)]).encode()

    return edit


def _saved(change: Callable[[Any], None]) -> Edit:
    def edit(raw: bytes) -> bytes:
        tree = json.loads(raw)
        change(tree)
        return json.dumps(tree).encode()

    return edit


def _posterior(**numbers: Any) -> Edit:
    return _saved(lambda tree: tree["posterior"].update(numbers))


def _correlated(tree: Any) -> None:
    covariance = tree["posterior"]["covariance"]
    covariance[0][1] = covariance[1][0] = 1e308


def _ragged(tree: Any) -> None:
    tree["problem"]["noise"]["sigma"] = [1.0, [2.0]]


def _no_utf8(raw: bytes) -> bytes:
    return raw.replace(b"surge [m/s]", b"\xc2urge [m/s]")


def _date(raw: bytes) -> bytes:
    table = pa.parquet.read_table(BytesIO(raw))
    sink = BytesIO()
    days = pa.array(range(table.num_rows), pa.int32()).cast(pa.date32())
    pa.parquet.write_table(table.set_column(1, "surge [m/s]", days), sink)
    return sink.getvalue()


def _bag(logged: int = 10**9, stamp: Any = (100, 0), definition: str = readers.STAMPED, value: float = 0.1) -> Edit:
    """Return a bag in which one message of fifty is another one."""

    def edit(_: bytes) -> bytes:
        sink = BytesIO()
        writer = Writer(sink)
        header = readers.OF_HEADER.replace(readers.STAMPED, definition)
        twist = writer.register_msgdef("pool/msg/Twist", readers.TWIST + header)
        joints = writer.register_msgdef("pool/msg/Joints", readers.JOINTS + header)
        kind = type(stamp[0])
        for row in range(51):
            own = stamp if row == 50 else (kind(100), kind(20_000_000 * row))
            told = Message(stamp=Message(sec=own[0], nanosec=own[1]), frame_id="")
            time = logged if row == 50 else 10**9 + 20_000_000 * row
            speed = value if row == 20 else 0.1
            messages = (
                ("/fish", twist, Message(header=told, twist=Message(x=speed, y=0.0, z=0.0))),
                ("/joints", joints, Message(header=told, name=["a", "b"], position=[0.1 * np.sin(0.3 * row)] * 4)),
            )
            for topic, known, message in messages:
                writer.write_message(topic, known, message, log_time=time, publish_time=time)
        writer.finish()
        return sink.getvalue()

    return edit


#: The reader's file, what was wrong with it, and what the message must say.
FOUND: dict[str, tuple[str, Edit, str]] = {
    "a column of the mapping is there twice": (
        "run_1.csv",
        lambda raw: raw.replace(b"t,u,v", b"t,u,u", 1).replace(b",r,", b",v,", 1),
        "2 columns 'u', expected one",
    ),
    "a first line that csv cannot read": (
        "run_1.csv",
        lambda raw: b"x" * 200_000,
        "has a cell of more than 131072 characters",
    ),
    "a body part is there twice": ("track.csv", lambda raw: raw.replace(b"part1", b"part0"), "2 columns 'part0 x'"),
    "markers that were never seen at once": (
        "film.csv",
        lambda raw: b"\n".join(b",," + line.split(b",", 2)[2] for line in raw.split(b"\n")),
        "markers 0 and 1 are never seen at once",
    ),
    "a pose that was never tracked": ("pose.csv", _column(2, ""), r"column 'y \[m\]' has no number"),
    "a number beyond all measurement": ("pose.csv", _cell(9, 2, "1e308"), "expected a finite number up to 1e"),
    "the same of a trial": ("cpg.csv", _cell(9, 1, "1e300"), "expected a finite number up to 1e"),
    "the same of a sensor": ("tag.csv", _cell(9, 1, "-1e300"), "expected a finite number up to 1e"),
    "the same without a header": ("Amp20Bias-30.txt", _spaced(_cell(9, 3, "1e300")), "no finite number up to 1e"),
    "a record of an age": ("Amp20Bias-30.txt", _spaced(_cell(59, 0, "1e9")), "60 rows over 1e.09 s"),
    "a pose of an age": ("pose.csv", _cell(51, 0, "1e12"), "51 rows over 1e.12 s"),
    "a record of a moment": ("pose.csv", _times(1e-6), "51 rows over 1e-06 s, expected those of a fish that beats"),
    "a log with a time after all times": ("bag.mcap", _bag(logged=2**63, stamp=(0, 0)), "a message at 9.22e.09 s"),
    "a pause of an age": ("bag.mcap", _bag(stamp=(2**31 - 1, 0)), "51 messages, one every 0.02 s, over 2.15e.09 s"),
    "a stamp that is text": (
        "bag.mcap",
        _bag(stamp=("x", "y"), definition="string sec\nstring nanosec"),
        "no time of ROS 2",
    ),
    "a bound beyond all coefficients": (
        "dataset.toml",
        lambda raw: raw.replace(b"high = 3.0", b"high = 1e308", 1),
        "start.c_d.tail.high: must be at most 1e.09",
    ),
    "headers of a table that are no text": ("wave.parquet", _no_utf8, "cannot be read|unknown column"),
    "a column of dates": ("wave.parquet", _date, "has type date32"),
    "a covariance of no errors": (
        "diagnosis.json",
        _saved(_correlated),
        "a negative variance, a correlation above 1, or a number above",
    ),
    "a scatter beyond all numbers": (
        "diagnosis.json",
        _posterior(scatter=[1e300] * 10),
        "a number above 1e.15 in covariance or",
    ),
    "infinity by its digits": (
        "diagnosis.json",
        lambda raw: raw.replace(b"0.0", b"1e999", 1),
        "1e999201 is no finite number",
    ),
    "JSON without end": ("diagnosis.json", lambda raw: b"[" * 100_000, "cannot be read as JSON"),
    "noise of no shape": ("planned.json", _saved(_ragged), "its content does not fit its hash"),
    "no model": ("planned.json", _saved(lambda tree: tree.update(fits=[])), "its content does not fit its hash"),
    "no alternatives": (
        "planned.json",
        _saved(lambda tree: tree.update(alternatives=[])),
        "its content does not fit its hash",
    ),
}


@pytest.mark.parametrize("case", FOUND)
def test_what_was_found_is_refused(case: str, known: dict[str, Reader], tmp_path: Path) -> None:
    name, edit, message = FOUND[case]
    reader = known[name]
    reader.prepare(tmp_path)
    raw = edit(reader.valid)
    assert raw != reader.valid
    assert reader.outcome(raw, tmp_path) == "refused"
    with pytest.raises(MjfishError, match=message):
        reader.read(tmp_path)


def test_a_number_beyond_all_measurement_in_a_message_is_none(known: dict[str, Reader], tmp_path: Path) -> None:
    """As an infinite one, by which robots say that there is nothing."""
    reader = known["bag.mcap"]
    reader.prepare(tmp_path)
    for value in (np.inf, 1e300):
        assert reader.outcome(_bag(stamp=(101, 0), value=value)(b""), tmp_path) == "read"


class _Executed:
    """A pickle that makes a file where it is loaded."""

    def __init__(self, trace: Path) -> None:
        self.trace = trace

    def __reduce__(self) -> tuple[Any, ...]:
        return Path.touch, (self.trace,)


@pytest.mark.parametrize("name", readers.NAMES)
def test_nothing_in_a_file_is_executed(name: str, known: dict[str, Reader], tmp_path: Path) -> None:
    reader, trace = known[name], tmp_path / "trace"
    reader.prepare(tmp_path)
    array = BytesIO()
    np.save(array, np.array([_Executed(trace)], dtype=object), allow_pickle=True)
    for raw in (pickle.dumps(_Executed(trace)), pickle.dumps(_Executed(trace), protocol=0), array.getvalue()):
        assert reader.outcome(raw, tmp_path) == "refused"
        assert not trace.exists()
    pickle.loads(pickle.dumps(_Executed(trace)))  # noqa: S301
    assert trace.exists()
