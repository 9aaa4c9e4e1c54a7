"""Files that are written whole or not at all, and refused before the work is done."""

from __future__ import annotations

import json
import math
import os
from pathlib import Path

import pytest

from mjfish.errors import InputError
from mjfish.files import writing


def _names(folder: Path) -> list[str]:
    return sorted(file.name for file in folder.iterdir())


def test_text_replaces_a_file_and_leaves_nothing_beside_it(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    writing.write_text(path, "old")
    writing.write_text(path, "nëw")
    assert path.read_text(encoding="utf-8") == "nëw"
    assert _names(tmp_path) == ["a.txt"]
    assert path.stat().st_mode & 0o777 == 0o644


def test_a_write_that_fails_leaves_the_old_file_and_nothing_beside_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.txt"
    writing.write_text(path, "old")

    def full(_self: Path, _target: Path) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "replace", full)
    with pytest.raises(InputError, match=r"a.txt: cannot be written: No space left on device; choose a folder"):
        writing.write_text(path, "new")
    assert path.read_text(encoding="utf-8") == "old"
    assert _names(tmp_path) == ["a.txt"]


def test_json_has_null_where_a_number_is_not_finite(tmp_path: Path) -> None:
    writing.write_json(tmp_path / "a.json", {"a": [math.nan, 1.5, (math.inf,)], "b": {"c": -math.inf, "d": "nan"}})
    text = (tmp_path / "a.json").read_text(encoding="utf-8")
    assert json.loads(text) == {"a": [None, 1.5, [None]], "b": {"c": None, "d": "nan"}}
    assert text.endswith("}\n")


@pytest.mark.parametrize("write", [writing.check_file, lambda path: writing.write_text(path, "x")])
def test_a_file_in_no_folder_or_on_a_folder_is_refused(tmp_path: Path, write: object) -> None:
    (tmp_path / "folder").mkdir()
    (tmp_path / "file").write_text("x", encoding="utf-8")
    assert callable(write)
    for bad in ("absent/a.json", "folder", "file/a.json"):
        with pytest.raises(InputError, match=bad.partition("/")[0]):
            write(tmp_path / bad)
    assert _names(tmp_path) == ["file", "folder"]


def test_a_name_of_another_kind_is_refused_in_upper_and_lower_case() -> None:
    for name in ("a.csv", "a.CSV", "a.parquet"):
        writing.check_suffix(Path(name), ".csv", ".parquet")
    with pytest.raises(InputError, match=r"a\.TXT: the name ends in '\.TXT', expected \.csv or \.parquet; rename it"):
        writing.check_suffix(Path("a.TXT"), ".csv", ".parquet")


def test_a_file_that_can_be_written_passes_and_is_not_made(tmp_path: Path) -> None:
    writing.check_file(tmp_path / "a.json")
    writing.check_folder(tmp_path / "a" / "b")
    writing.check_folder(tmp_path)
    assert _names(tmp_path) == []


@pytest.mark.parametrize("check", [writing.check_folder, writing.make_folder])
def test_a_folder_below_or_in_place_of_a_file_is_refused(tmp_path: Path, check: object) -> None:
    (tmp_path / "file").write_text("x", encoding="utf-8")
    assert callable(check)
    for bad in ("file", "file/a", "file/a/b"):
        with pytest.raises(InputError, match=r"file.*; choose another"):
            check(tmp_path / bad)


@pytest.mark.parametrize("check", [writing.check_folder, lambda path: writing.check_file(path / "a.json")])
def test_a_folder_without_permission_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, check: object) -> None:
    """By asking the system, for tests may run as a user who may write anywhere."""
    monkeypatch.setattr(os, "access", lambda *_: False)
    assert callable(check)
    with pytest.raises(InputError, match="cannot be written to; choose a folder that you can write to"):
        check(tmp_path)


def test_a_folder_is_made_with_those_above_it_and_may_be_there(tmp_path: Path) -> None:
    for _ in range(2):
        writing.make_folder(tmp_path / "a" / "b")
    assert (tmp_path / "a" / "b").is_dir()
