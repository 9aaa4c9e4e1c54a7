"""Whatever happens to a file, reading it ends in a dataset or in a message."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from recordings import TOML, cpg_csv, measured_csv, write_folder

from mjfish import data as trial
from mjfish.data import columns
from mjfish.errors import MjfishError

ROUNDS = 150
#: Pieces that parsers stumble over.
PIECES = [
    *[
        b"\x00",
        b"\xff",
        b"\xef\xbb\xbf",
        b"\r",
        b"\n",
        b"\r\n",
        b"\n\n",
        b",",
        b",,",
        b'"',
        b"'",
        b";",
        b"\t",
        b" ",
        b"#",
    ],
    *[b"nan", b"inf", b"-", b"--", b"e", b"1e308", b"-1e308", b"1e-320", b"1e999", b"0x1", b"1_0", b"[", b"]", b"[s]"],
    *["ü".encode(), "\u2028".encode(), "٣".encode(), b"\x0b", b"\x1c", b"\x85"],
]


def corrupted(valid: bytes, generator: np.random.Generator) -> bytes:
    """Return the text after one to three random deletions, insertions, changed bytes, or moved lines."""
    data = bytearray(valid)
    for _ in range(generator.integers(1, 4)):
        at = int(generator.integers(len(data) + 1))
        to = min(at + int(generator.integers(1, 40)), len(data))
        match generator.integers(6):
            case 0:
                del data[at:to]
            case 1:
                data[at:at] = PIECES[generator.integers(len(PIECES))]
            case 2:
                data[at : at + 1] = bytes([generator.integers(256)])
            case 3:
                data[at:to] = PIECES[generator.integers(len(PIECES))]
            case 4:
                data = data[:at]
            case _:
                lines = data.split(b"\n")
                first, second = generator.integers(len(lines), size=2)
                lines[first], lines[second] = lines[second], lines[first]
                data = bytearray(b"\n".join(lines))
    return bytes(data)


def outcome(folder: Path) -> str:
    """Load the dataset; anything but a dataset and an error of mjfish that names the folder fails the test."""
    message = ""
    try:
        for read in trial.load_dataset(folder).trials:
            assert np.isfinite(read.velocity).all()
            assert (np.diff(read.time) > 0.0).all()
    except MjfishError as error:
        message = str(error)
    assert not message or str(folder) in message
    return "refused" if message else "read"


@pytest.mark.parametrize("file", ["cpg.csv", "measured.csv", "dataset.toml"])
@pytest.mark.parametrize("seed", range(2))
def test_a_corrupted_text_file_is_read_or_refused(file: str, seed: int, tmp_path: Path) -> None:
    generator = np.random.default_rng([seed, len(file)])
    folder = write_folder(tmp_path)
    valid = {"cpg.csv": cpg_csv(), "measured.csv": measured_csv(), "dataset.toml": TOML}[file].encode()
    counts: Counter[str] = Counter()
    for _ in range(ROUNDS):
        (folder / file).write_bytes(corrupted(valid, generator))
        counts[outcome(folder)] += 1
    assert counts["refused"] > ROUNDS // 2
    assert counts["read"] > 0


def test_a_corrupted_parquet_file_is_read_or_refused(tmp_path: Path) -> None:
    folder = write_folder(tmp_path)
    table = trial.read_table(folder / "cpg.csv")
    trial.write_table(folder / "cpg.parquet", {columns.header(name): values for name, values in table.items()})
    (folder / "dataset.toml").write_text(TOML.replace("cpg.csv", "cpg.parquet"))
    assert outcome(folder) == "read"
    valid = (folder / "cpg.parquet").read_bytes()
    generator = np.random.default_rng(5)
    for _ in range(ROUNDS):
        (folder / "cpg.parquet").write_bytes(corrupted(valid, generator))
        outcome(folder)
