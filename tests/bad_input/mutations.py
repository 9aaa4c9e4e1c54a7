"""What goes wrong with a file: by bytes, by cells and lines of a table, by keys and values of a tree."""

from __future__ import annotations

import copy
import json
import math
import tomllib
from io import BytesIO
from random import Random
from typing import Any

import pyarrow as pa
import pyarrow.parquet
import tomlkit

#: Pieces that parsers stumble over.
PIECES = [
    *[b"\0", b"\xff", b"\xef\xbb\xbf", b"\r", b"\n", b"\r\n", b"\n\n", b",", b",,", b'"', b"'", b";", b"\t", b" "],
    *[b"nan", b"inf", b"-", b"--", b"e", b"1e308", b"-1e308", b"1e-320", b"1e999", b"0x1", b"1_0", b"[", b"]", b"[s]"],
    *["ü".encode(), "\u2028".encode(), "٣".encode(), b"\x0b", b"\x1c", b"\x85", b"{", b"}", b"=", b"#", b"../", b"\\"],
]
#: Cells that are no measured numbers, or hardly.
CELLS = [
    *["", " ", "nan", "inf", "-inf", "-", "1e308", "-1e308", "1e300", "1e-320", "1e20", "-1e20", "1e999", "0", "-0.0"],
    *["1_0", "0x1", "1,5", "٣", "true", "x" * 200, '"', '"1"', "1e9", "1e-9", "9007199254740993", "\u2028", "1\0"],
]
#: Values where a key expects another.
VALUES: list[Any] = [
    *[0, -1, 1, 2**63, -(2**63), 10**400, 0.0, -0.0, 1e-320, 1e-9, 1e9, 1e20, -1e20, 1e308, -1e308, math.nan, math.inf],
    *[True, False, "", "x", "1.5", "../x", "/dev/zero", "pike", "a\0b", "ü" * 100, [], {}, [[]], [{}], {"x": {}}],
    *[[1, "x"], [None], "head", "*", "cpg.csv"],
    *[None, [0.0], [1e308] * 3, ["x"] * 3, {"value": 1.0, "sd": 1.0}, {"value": 1e308, "low": 0}, {"start": 0.5}],
]


def corrupted(raw: bytes, random: Random) -> bytes:
    """Return the bytes after one to three deletions, insertions, changed bytes, moved or cut ends and lines."""
    data = bytearray(raw)
    for _ in range(random.choice((1, 1, 1, 2, 3))):
        at = random.randint(0, len(data))
        to = min(at + random.randint(1, 40), len(data))
        match random.randrange(7):
            case 0:
                del data[at:to]
            case 1:
                data[at:at] = random.choice(PIECES)
            case 2:
                data[at : at + 1] = bytes([random.randrange(256)])
            case 3:
                data[at:to] = random.choice(PIECES)
            case 4:
                data = data[:at]
            case 5:
                data[at:at] = data[at:to] * random.choice((1, 1, 2, 50))
            case _:
                lines = data.split(b"\n")
                first, second = random.randrange(len(lines)), random.randrange(len(lines))
                lines[first], lines[second] = lines[second], lines[first]
                data = bytearray(b"\n".join(lines))
    return bytes(data)


def rearranged_table(raw: bytes, random: Random) -> bytes:
    """Return a CSV file after one to three cells, rows or columns were replaced, moved, doubled or left out."""
    try:
        rows = [line.split(",") for line in raw.decode().split("\n")]
    except UnicodeDecodeError:
        return raw
    for _ in range(random.choice((1, 1, 1, 2, 3))):
        row = random.choice((0, 1, len(rows) - 2, random.randrange(len(rows)))) % len(rows)
        column = random.randrange(max(len(rows[row]), 1))
        match random.randrange(6):
            case 0:
                rows[row][column : column + 1] = [random.choice(CELLS)]
            case 1:
                rows[row : row + 1] = [rows[row]] * random.choice((0, 2, 3))
            case 2:
                other = random.randrange(len(rows))
                rows[row], rows[other] = rows[other], rows[row]
            case 3:
                text = random.choice(CELLS)
                for cells in rows[1:]:
                    cells[column : column + 1] = [text]
            case 4:
                rows = [cells[:column] + cells[column + 1 :] for cells in rows]
            case _:
                rows = [[*cells, *cells[column : column + 1]] for cells in rows]
        rows = rows or [[""]]
    return "\n".join(",".join(cells) for cells in rows).encode()


def rearranged_tree(tree: Any, random: Random) -> Any:
    """Return nested tables and lists after one to three values were replaced, left out, doubled or exchanged."""
    tree = copy.deepcopy(tree)
    for _ in range(random.choice((1, 1, 1, 2, 3))):
        places = list(_places(tree))
        if not places:
            break
        owner, key = random.choice(places)
        match random.randrange(6):
            case 0:
                del owner[key]
            case 1:
                other, there = random.choice(places)
                owner[key] = copy.deepcopy(other[there])
            case 2 if isinstance(owner, list):
                owner.extend([copy.deepcopy(owner[key])] * random.choice((1, 1, 50)))
            case 2:
                owner[random.choice(("x", "effects", "wave", "known", f"{key}s"))] = copy.deepcopy(owner[key])
            case _:
                owner[key] = copy.deepcopy(random.choice(VALUES))
    return tree


def _places(tree: Any) -> Any:
    """Yield every list or table with every key in it."""
    keys = range(len(tree)) if isinstance(tree, list) else list(tree) if isinstance(tree, dict) else ()
    for key in keys:
        yield tree, key
        yield from _places(tree[key])


def rearranged_toml(raw: bytes, random: Random) -> bytes:
    """Return a TOML file after values in it were changed."""
    try:
        return tomlkit.dumps(_toml(rearranged_tree(tomllib.loads(raw.decode()), random))).encode()
    except (ValueError, RecursionError):
        return raw


def _toml(tree: Any) -> Any:
    if isinstance(tree, dict):
        return {key: _toml(value) for key, value in tree.items() if value is not None}
    return [_toml(value) for value in tree if value is not None] if isinstance(tree, list) else tree


def rearranged_json(raw: bytes, random: Random) -> bytes:
    """Return a JSON file after values in it were changed."""
    try:
        return json.dumps(rearranged_tree(json.loads(raw), random)).encode()
    except (ValueError, RecursionError):
        return raw


def rearranged_parquet(raw: bytes, random: Random) -> bytes:
    """Return a Parquet file after a column got another type, name, or cells, or was left out or doubled."""
    try:
        table = pa.parquet.read_table(BytesIO(raw))
    except (pa.ArrowException, OSError):
        return raw
    columns, names = [list(column.to_pylist()) for column in table.columns], list(table.column_names)
    at = random.randrange(len(names))
    row = random.choice((0, len(columns[at]) - 1, random.randrange(len(columns[at]))))
    match random.randrange(8):
        case 0:
            kinds = (pa.int64(), pa.float32(), pa.float16(), pa.uint8(), pa.decimal128(20, 3), pa.date32())
            columns[at] = pa.array(range(len(columns[at])), pa.int32()).cast(random.choice(kinds))
        case 7:
            columns[at] = [random.choice(("x", True, b"1"))] * len(columns[at])
        case 1:
            columns[at] = [[value] for value in columns[at]]
        case 2:
            names[at] = random.choice(("x", names[0], "", "yaw [rad]", "joint_1 [rad]", "joint_99 [rad]"))
        case 3:
            del columns[at], names[at]
        case 4:
            columns[at] = [None] * len(columns[at])
        case 5:
            columns = [column[:row] for column in columns]
        case _:
            columns[at][row] = random.choice((None, math.nan, math.inf, 1e308, -1e308, 1e20, 1e-320, -1.0))
    sink = BytesIO()
    compression = random.choice(("snappy", "zstd", "none"))
    arrays = [column if isinstance(column, pa.Array) else pa.array(column) for column in columns]
    pa.parquet.write_table(pa.Table.from_arrays(arrays, names), sink, compression=compression)
    return sink.getvalue()
