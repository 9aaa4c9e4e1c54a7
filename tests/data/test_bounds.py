"""What is no input is refused before it fills the memory: files of zeros, lines without end, more than is read."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from recordings import TOML, cpg_csv, write_folder

from mjfish.data import columns, load_dataset, read_table, write_table
from mjfish.data.importers.mapping import VelocitiesMap
from mjfish.errors import InputError
from mjfish.files import size_limited, tomlfile

ROOT = Path(__file__).parents[2]
#: Files of zeros, none of whose 5 GB is on the disk.
HUGE = 5 * 10**9
#: Most that reading one may take: 500 MB with what the package takes itself, and 5 s of a processor.
MEMORY, SECONDS = 500 * 10**6, 5.0
READ = """
import json, time
from pathlib import Path
import mjfish
from mjfish import data
from mjfish.data.importers import import_files
from importers.tail_fish import import_files as tail_fish

readers = {
    "run.csv": data.read_table,
    "run.parquet": data.read_table,
    "dataset.toml": mjfish.load_dataset,
    "fish.toml": mjfish.load_fish,
    "diagnosis.json": lambda path: mjfish.sample(path, 1),
    "bag.mcap": lambda path: import_files("mcap", [path], mapping="map.toml"),
    "velocities.csv": lambda path: import_files("velocities", [path], mapping="map.toml"),
    "track.csv": lambda path: import_files("deeplabcut", [path], mapping="markers.toml"),
    "Amp20Bias-30.txt": lambda path: tail_fish([path]),
}
for folder in ("zeros", "rows"):
    for name, read in readers.items():
        path, begun = Path(folder, name), time.process_time()
        try:
            message = f"was read: {read(path)}"
        except mjfish.MjfishError as error:
            message = str(error)
        memory = 1024 * int(Path("/proc/self/status").read_text().partition("VmHWM:")[2].split()[0])
        print(json.dumps([str(path), message, time.process_time() - begun, memory]))
"""
NAMES = re.findall(r'^    "(.*?)": ', READ, flags=re.MULTILINE)
MAP = (
    'schema = 1\nkind = "velocities"\nfish = "pike"\ntime = "t"\nsurge = "u"\nsway = "v"\nyaw_rate = "r"\n'
    "[wave]\nfrequency = 1.0\namplitude = [0.1, 0.1, 0.1, 0.1]\nphase = [0, 0, 0, 0]\n"
)
MARKERS = 'schema = 1\nkind = "markers"\nfish = "one_joint"\nrate = 50.0\n' + "".join(
    f'[[markers]]\nname = "m{k}"\nlink = "{link}"\nstation = {station}\n'
    for k, (link, station) in enumerate((("head", 0.01), ("head", 0.02), ("fin", 0.2)))
)


def test_huge_files_of_zeros_are_refused_at_once(tmp_path: Path) -> None:
    for folder, begun in (("zeros", b""), ("rows", b"t,u,v,r\n0,0,0,0\n")):
        (tmp_path / folder).mkdir()
        for name in NAMES:
            path = tmp_path / folder / name
            path.write_bytes(begun)
            os.truncate(path, HUGE)
    (tmp_path / "map.toml").write_text(MAP)
    (tmp_path / "markers.toml").write_text(MARKERS)
    command, env = (
        [sys.executable, "-c", READ],
        {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), str(ROOT / "tools")])},
    )
    done = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, env=env)
    assert done.returncode == 0, done.stderr[-2000:]
    read = [json.loads(line) for line in done.stdout.splitlines()]
    assert [path for path, *_ in read] == [f"{folder}/{name}" for folder in ("zeros", "rows") for name in NAMES]
    for path, message, seconds, memory in read:
        assert f"{path}: " in message.partition("expected")[0], message
        assert seconds < SECONDS, path
        assert memory < MEMORY, path


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        (
            (",".join(f"joint_{k} [rad]" for k in range(1, 9999)) + ",joint_7 [rad]\n" + "1," * 9998 + "1\n").encode(),
            "columns 7 and 9999 are",
        ),
        (b"speed" * 20000 + b",surge [m/s]\n1,2\n", "column 1 'speedspeedspeedspeedspeedspeedspeedspeed...': unknown"),
        (
            b"time [s],surge [m/s]\n0,\0",
            r"byte 24 is zero, as in a damaged or binary file, or in UTF-16 .* expected text; save",
        ),
        (
            "time [s],surge [m/s]\n0,1\n".encode("utf-16-le"),
            "byte 2 is zero, .*; save it as UTF-8 CSV, or give --encoding",
        ),
        (b"1," * 2**19, "line 1 has more than 1 MiB, expected the first row; save"),
        (b"time [s],surge [m/s]\n" + b"1,1\n" * 2**18 + b"1,\0", "byte 1048600 is zero"),
    ],
    ids=["many columns", "long header", "zero", "UTF-16", "endless line", "zero in the end"],
)
def test_a_file_that_is_no_table_is_refused(content: bytes, complaint: str, tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    path.write_bytes(content)
    with pytest.raises(InputError, match=complaint):
        read_table(path)


def test_what_is_more_than_is_read_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = write_folder(tmp_path)
    load_dataset(folder)
    monkeypatch.setattr(size_limited, "SETTINGS", len(TOML) - 1)
    monkeypatch.setattr(size_limited, "_size", lambda count: f"{count} bytes")
    with pytest.raises(InputError, match=rf"dataset\.toml: has more than {len(TOML) - 1} bytes, the most that is read"):
        load_dataset(folder)
    monkeypatch.setattr(size_limited, "TABLE", len(cpg_csv()) - 1)
    with pytest.raises(InputError, match=r"cpg\.csv: has more than .* bytes, the most that is read; save what is"):
        read_table(folder / "cpg.csv")


def test_a_pipe_is_read_up_to_the_same_size(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A pipe has no size beforehand."""
    monkeypatch.setattr(size_limited, "_BEGINNING", 16)
    read, write = os.pipe()
    os.write(write, b"0123456789" * 5)
    os.close(write)
    with pytest.raises(InputError, match="has more than 0 MiB, the most that is read; cut it"):
        size_limited.read_text(Path(f"/dev/fd/{read}"), 40, "cut it")
    os.close(read)


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_a_table_of_more_numbers_than_are_read_is_refused(
    suffix: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / f"run{suffix}"
    write_table(path, {"time [s]": np.arange(10.0), "surge [m/s]": np.zeros(10)})
    monkeypatch.setattr(columns, "MOST_NUMBERS", 22)
    assert len(read_table(path)["time"]) == 10
    monkeypatch.setattr(columns, "MOST_NUMBERS", 19)
    with pytest.raises(InputError, match=rf"run{suffix}: has 2[02] numbers, expected 19 at most; cut it"):
        read_table(path)


def test_no_table_is_written_that_would_not_be_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    table = {"time [s]": np.arange(10.0)}
    monkeypatch.setattr(columns, "MOST_NUMBERS", 9)
    with pytest.raises(InputError, match=r"run\.parquet: has 10 numbers, expected 9 at most; cut it"):
        write_table(tmp_path / "run.parquet", table)
    monkeypatch.setattr(columns, "MOST_NUMBERS", 10)
    monkeypatch.setattr(size_limited, "TABLE", 48)
    with pytest.raises(InputError, match=r"run\.csv: 49 bytes of CSV, expected 48 at most; write Parquet"):
        write_table(tmp_path / "run.csv", table)
    assert not list(tmp_path.iterdir())


def test_json_that_is_no_result_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "diagnosis.json"
    for content, complaint in (
        ("[" * 10**5, "recursion"),
        ('{"posterior": NaN}', "NaN is no finite number"),
        ('{"a": 1e999}', "1e999 is"),
        ("{", "line 1"),
    ):
        path.write_text(content)
        with pytest.raises(InputError, match=rf"diagnosis\.json: cannot be read as JSON: .*{complaint}.*; write it by"):
            size_limited.read_json(path, "write it by hand")


def test_toml_that_is_nested_without_end_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "map.toml"
    path.write_text(f"{'a.' * 5000}a = 1")
    with pytest.raises(InputError, match=r"map\.toml: .*nested"):
        tomlfile.read(path, VelocitiesMap)
