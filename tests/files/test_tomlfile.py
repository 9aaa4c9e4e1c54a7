"""Reading TOML: what is refused, and that the complaint names file, key and remedy."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import pytest
from pydantic import Field, ValidationError

from mjfish.errors import InputError, MjfishError
from mjfish.files import tomlfile
from mjfish.files.tomlfile import Table


class Fin(Table):
    """A table within the table."""

    area: Annotated[float, Field(gt=0.0, le=2.0)]
    rays: tuple[float, ...] = Field(default=(), max_length=3)


class Boat(Table):
    """What the tests read."""

    name: str = Field(min_length=1)
    kind: Literal["sail", "row"] = "sail"
    speed: float = Field(default=0.0, ge=0.0)
    fins: tuple[Fin, ...] = Field(min_length=1)


GOOD = 'name = "Argo"\nspeed = 3\n[[fins]]\narea = 0.5\nrays = [1, 2.5]\n'


def _read(folder: Path, text: str) -> Boat:
    path = folder / "boat.toml"
    path.write_text(text, encoding="utf-8")
    return tomlfile.read(path, Boat)


def test_reads_a_good_file_whole_numbers_included(tmp_path: Path) -> None:
    boat = _read(tmp_path, GOOD)
    assert (boat.name, boat.kind, boat.speed) == ("Argo", "sail", 3.0)
    assert boat.fins == (Fin(area=0.5, rays=(1.0, 2.5)),)


def test_what_was_read_cannot_be_changed(tmp_path: Path) -> None:
    with pytest.raises(ValidationError, match="frozen"):
        _read(tmp_path, GOOD).speed = 4.0


#: What is written in place of what, and the complaint: key, remedy and what was found.
BROKEN = {
    "unknown key": ("speed = 3", "sped = 3", "sped: unknown key; remove it or correct its spelling (found 3)"),
    "missing key": ('name = "Argo"\n', "", "name: this key is missing; add it"),
    "missing in a list": ("area = 0.5\n", "", "fins.1.area: this key is missing; add it"),
    "NaN": ("speed = 3", "speed = nan", "speed: expected a finite number; correct it (found nan)"),
    "infinite": ("area = 0.5", "area = inf", "fins.1.area: expected a finite number; correct it (found inf)"),
    "quoted number": ("speed = 3", 'speed = "3"', "speed: expected a number; write it without quotes (found '3')"),
    "truth value": ("speed = 3", "speed = true", "speed: expected a number; write it without quotes (found True)"),
    "date": ("speed = 3", "speed = 2026-01-01", "speed: expected a number"),
    "negative": ("speed = 3", "speed = -3", "speed: must be at least 0; correct it (found -3"),
    "zero": ("area = 0.5", "area = 0", "fins.1.area: must be above 0; correct it (found 0"),
    "too large": ("area = 0.5", "area = 2.5", "fins.1.area: must be at most 2; correct it (found 2.5)"),
    "number for text": ('"Argo"', "7", "name: expected text; write it in quotes (found 7)"),
    "empty text": ('"Argo"', '""', "name: must not be empty; give it a text"),
    "unknown choice": ("speed = 3", 'kind = "steam"', "kind: expected 'sail' or 'row' (found 'steam')"),
    "number for a list": ("rays = [1, 2.5]", "rays = 1", "fins.1.rays: expected a list in brackets (found 1)"),
    "text in a list": ("[1, 2.5]", '[1, "a"]', "fins.1.rays.2: expected a number; write it without quotes (found 'a')"),
    "long list": ("[1, 2.5]", "[1, 2, 3, 4]", "fins.1.rays: expected at most 3 entries, found 4"),
    "table for a list": (
        "[[fins]]",
        "[fins]",
        "fins: one table, expected a list of them; write [[fins]] in place of [fins]",
    ),
    "number for a table": (GOOD[GOOD.index("[[") :], "fins = [3]", "fins.1: expected a table (found 3)"),
}


@pytest.mark.parametrize("case", BROKEN)
def test_refuses_and_names_file_key_and_remedy(case: str, tmp_path: Path) -> None:
    old, new, complaint = BROKEN[case]
    assert old in GOOD
    with pytest.raises(InputError) as caught:
        _read(tmp_path, GOOD.replace(old, new))
    assert str(caught.value).startswith(f"{tmp_path / 'boat.toml'}: {complaint}")


def test_every_broken_key_is_listed_at_once(tmp_path: Path) -> None:
    with pytest.raises(InputError) as caught:
        _read(tmp_path, 'speed = -1\ncolour = "red"\n[[fins]]\narea = 9\n')
    lines = str(caught.value).splitlines()
    assert len(lines) == 4
    for line, key in zip(sorted(lines), ("colour", "fins.1.area", "name", "speed"), strict=True):
        assert line.startswith(f"{tmp_path / 'boat.toml'}: {key}: ")


@pytest.mark.parametrize("text", ["name = Argo", "speed = 3\nspeed = 4", "[fins", "x = " + "[" * 5000, "\x01"])
def test_what_is_no_toml_is_refused(text: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"boat\.toml: not valid TOML: "):
        _read(tmp_path, text)


def test_the_line_of_a_syntax_error_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"at line 2, column"):
        _read(tmp_path, 'name = "Argo"\nspeed = = 3\n')


def test_a_missing_file_a_folder_and_a_binary_file_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"none\.toml: no such file"):
        tomlfile.read(tmp_path / "none.toml", Boat)
    with pytest.raises(InputError, match="cannot be read as text"):
        tomlfile.read(tmp_path, Boat)
    (tmp_path / "boat.toml").write_bytes(b"\xff\xfe\x80")
    with pytest.raises(InputError, match=r"boat\.toml: cannot be read as text"):
        tomlfile.read(tmp_path / "boat.toml", Boat)


def test_a_refusal_is_an_mjfish_error_and_a_value_error(tmp_path: Path) -> None:
    """A caller catches either; the chain of pydantic is not shown to anyone."""
    with pytest.raises(MjfishError) as caught:
        _read(tmp_path, "speed = 3")
    assert isinstance(caught.value, ValueError)
    assert caught.value.__cause__ is None
    assert caught.value.__suppress_context__
    assert "pydantic" not in str(caught.value)
