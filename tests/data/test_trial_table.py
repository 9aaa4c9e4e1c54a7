"""Tables of numbers: what is written is read back to the last bit, what is no table is refused."""

from __future__ import annotations

from pathlib import Path

import hypothesis.extra.numpy as arrays
import numpy as np
import pyarrow as pa
import pyarrow.parquet as parquet
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mjfish import data as trial
from mjfish.data import columns
from mjfish.errors import InputError

HEADERS = ["time [s]", "surge [m/s]", "sway [m/s]", "yaw_rate [rad/s]", "x [m]", "joint_1 [rad]", "joint_12 [rad]"]

tables = st.integers(1, 9).flatmap(
    lambda rows: st.dictionaries(
        st.sampled_from(HEADERS),
        arrays.arrays(np.float64, rows, elements=st.floats(-1e15, 1e15)),
        min_size=1,
    )
)


@pytest.mark.parametrize("suffix", [".csv", ".parquet", ".CSV"])
@given(table=tables)
@settings(max_examples=50, deadline=None, suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large])
def test_reading_gives_back_every_bit(
    suffix: str, table: dict[str, np.ndarray], tmp_path_factory: pytest.TempPathFactory
) -> None:
    path = tmp_path_factory.mktemp("table") / f"rollout{suffix}"
    trial.write_table(path, table)
    read = trial.read_table(path)
    assert [columns.header(name) for name in read] == list(table)
    for values, written in zip(read.values(), table.values(), strict=True):
        assert values.tobytes() == written.tobytes()
        assert not values.flags.writeable


def test_integers_and_single_precision_of_parquet_become_doubles(tmp_path: Path) -> None:
    path = tmp_path / "a.parquet"
    parquet.write_table(pa.table({"time [s]": pa.array([0, 1, 2]), "x [m]": pa.array([0.5, 1, 2], pa.float32())}), path)
    read = trial.read_table(path)
    assert read["time"].tolist() == [0.0, 1.0, 2.0]
    assert read["x"].tolist() == [0.5, 1.0, 2.0]


@pytest.mark.parametrize(
    ("cells", "expected"),
    [
        (pa.array(["0", "a"]), "column 'surge [m/s]' has type string, expected float64; convert it"),
        (pa.array([True, False]), "has type bool, expected float64"),
        (pa.array([[1.0], [2.0]]), "has type list<element: double>, expected float64"),
        (pa.array([1.0, None]), "row 2, column 'surge [m/s]': the cell is empty, expected a number; fill it in"),
        (pa.array([1.0, np.nan]), "row 2, column 'surge [m/s]': nan, expected a finite number"),
        (pa.array([0, 2**62 + 1]), "cannot be read: "),
    ],
)
def test_refuses_parquet_columns_that_are_no_numbers(cells: pa.Array, expected: str, tmp_path: Path) -> None:
    path = tmp_path / "a.parquet"
    parquet.write_table(pa.table({"time [s]": pa.array([0.0, 1.0]), "surge [m/s]": cells}), path)
    with pytest.raises(InputError) as caught:
        trial.read_table(path)
    assert f"{path}: " in str(caught.value)
    assert expected in str(caught.value)


def test_refuses_parquet_headers_as_those_of_csv(tmp_path: Path) -> None:
    path = tmp_path / "a.parquet"
    parquet.write_table(pa.table({"time [ms]": pa.array([0.0])}), path)
    with pytest.raises(InputError, match=r"column 1 'time \[ms\]': unit \[ms\], expected \[s\]; .*multiply by 0\.001"):
        trial.read_table(path)
    parquet.write_table(pa.table({"time [s]": pa.array([], pa.float64())}), path)
    with pytest.raises(InputError, match="has a header and no rows"):
        trial.read_table(path)
    parquet.write_table(pa.table({}), path)
    with pytest.raises(InputError, match="has no columns"):
        trial.read_table(path)


def test_a_folder_called_like_a_partition_adds_no_column(tmp_path: Path) -> None:
    folder = tmp_path / "run=3"
    folder.mkdir()
    trial.write_table(folder / "a.parquet", {"time [s]": np.array([0.0, 1.0])})
    assert list(trial.read_table(folder / "a.parquet")) == ["time"]


@pytest.mark.parametrize("content", [b"", b"PAR1", b"time [s]\n1\n", b"\x00" * 64])
def test_refuses_a_parquet_file_that_is_none(content: bytes, tmp_path: Path) -> None:
    path = tmp_path / "a.parquet"
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"a\.parquet: cannot be read: .*; save it again"):
        trial.read_table(path)


def test_refuses_a_parquet_header_that_is_no_text(tmp_path: Path) -> None:
    path = tmp_path / "a.parquet"
    trial.write_table(path, {"surge [m/s]": np.zeros(2)})
    path.write_bytes(path.read_bytes().replace(b"surge", b"sur\xffe"))
    with pytest.raises(InputError, match=r"a\.parquet: cannot be read"):
        trial.read_table(path)


def test_refuses_a_number_with_a_byte_that_is_no_text_naming_the_cell(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_bytes(b"time [s],surge [m/s]\n0,1\n1,\xff2\n")
    with pytest.raises(InputError, match=r"a\.csv: row 2 \(line 3\), column 'surge \[m/s\]': 'ÿ2' is not a number"):
        trial.read_table(path)


def test_refuses_a_row_that_a_stray_quote_swallows(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text('time [s],surge [m/s]\n0,1\n1,"2\n2,3\n')
    with pytest.raises(InputError, match=r"row 2 \(line 3\)"):
        trial.read_table(path)


def test_refuses_a_file_that_is_absent_a_folder_or_of_another_kind(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"a\.csv: no such file; correct its name"):
        trial.read_table(tmp_path / "a.csv")
    (tmp_path / "b.csv").mkdir()
    with pytest.raises(InputError, match=r"b\.csv: cannot be read"):
        trial.read_table(tmp_path / "b.csv")
    with pytest.raises(
        InputError, match=r"the name ends in '\.xlsx', expected \.csv or \.parquet; rename it, or convert"
    ):
        trial.read_table(tmp_path / "c.xlsx")


def test_refuses_to_write_columns_of_unequal_length(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"expected one-dimensional columns of one length"):
        trial.write_table(tmp_path / "a.csv", {"time [s]": np.zeros(3), "x [m]": np.zeros(2)})
    with pytest.raises(InputError, match=r"expected one-dimensional columns of one length"):
        trial.write_table(tmp_path / "a.csv", {"time [s]": np.zeros((3, 1))})
    assert list(tmp_path.iterdir()) == []


def test_a_table_that_cannot_be_written_leaves_the_old_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.csv"
    trial.write_table(path, {"time [s]": np.array([1.0])})

    def full(*_: object) -> None:
        raise OSError("no space left")

    monkeypatch.setattr("pathlib.Path.write_bytes", full)
    with pytest.raises(InputError, match=r"a\.csv: cannot be written: no space left"):
        trial.write_table(path, {"time [s]": np.array([2.0])})
    assert [file.name for file in tmp_path.iterdir()] == ["a.csv"]
    assert trial.read_table(path)["time"].tolist() == [1.0]


def test_refuses_to_write_where_no_folder_is(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"cannot be written: .*; choose a folder"):
        trial.write_table(tmp_path / "absent" / "a.csv", {"time [s]": np.zeros(1)})
