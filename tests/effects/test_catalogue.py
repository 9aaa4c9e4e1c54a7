"""Finding causes: the folder, a user's file, and every way in which such a file can be wrong."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from mjfish.effects import Effect, catalogue, find, of_fish
from mjfish.errors import InputError, MjfishError, ParameterError, UnknownNameError
from mjfish.fish.from_measurements import new_fish
from mjfish.hydro.load import PARAMETERS

VALID = (Path(__file__).parent / "own_effects.py").read_text(encoding="utf-8").partition("\n@load")[0]


def _file(folder: Path, text: str, name: str = "mine.py") -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def test_a_users_file_joins_the_shipped_causes(tmp_path: Path) -> None:
    known = catalogue([_file(tmp_path, VALID)])
    assert set(known) == {*catalogue(), "camera_scale"}
    assert isinstance(find("camera_scale", known), Effect)
    assert "camera_scale" not in catalogue()


def test_a_file_is_read_again_after_an_edit(tmp_path: Path) -> None:
    """A session that goes on for hours must not show yesterday's file."""
    path = _file(tmp_path, VALID)
    catalogue([path])
    path.write_text(VALID.replace("camera_scale", "lens_scale"), encoding="utf-8")
    os.utime(path, ns=(1, 1))
    assert "lens_scale" in catalogue([path])


def test_files_of_one_name_in_two_folders_do_not_shadow_each_other(tmp_path: Path) -> None:
    (tmp_path / "b").mkdir()
    first, second = _file(tmp_path, VALID), _file(tmp_path / "b", VALID.replace("camera_scale", "lens_scale"))
    assert {"camera_scale", "lens_scale"} <= set(catalogue([first, second]))


def test_an_unknown_cause_is_refused_with_the_known_ones() -> None:
    with pytest.raises(UnknownNameError, match=r"unknown effect 'drag'; known: .*ambient_current, .*munk_moment, "):
        find("drag")


def test_a_missing_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"absent.py: no such file of effects; correct the path"):
        catalogue([tmp_path / "absent.py"])
    with pytest.raises(InputError, match="no such file"):
        catalogue([tmp_path])


def test_a_file_that_is_no_python_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"mine.txt: not a Python file, expected a name that ends in .py"):
        catalogue([_file(tmp_path, VALID, "mine.txt")])


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("def (\n", "running the file failed: SyntaxError: .*line 1"),
        ("x = 1\n\nx = nonsense\n", "line 3: running the file failed: NameError: name 'nonsense'"),
        ("import absent_library\n", "line 1: running the file failed: ModuleNotFoundError"),
        ("raise SystemExit(0)\n", "line 1: running the file failed: SystemExit"),
        ("", "no subclass of mjfish.effects.Effect found; define one"),
        ("from mjfish.effects.munk_moment import MunkMoment\n", "no subclass of mjfish.effects.Effect found"),
    ],
)
def test_a_file_that_cannot_be_run_or_holds_no_cause_is_refused(tmp_path: Path, text: str, complaint: str) -> None:
    """An imported cause is not the file's own, or every file that builds on another would define it twice."""
    path = _file(tmp_path, text)
    with pytest.raises(InputError, match=complaint) as caught:
        catalogue([path])
    assert str(caught.value).startswith(f"{path}: ")


@pytest.mark.parametrize("taken", ["time_offset", "camera_scale"])
def test_a_taken_name_is_refused(tmp_path: Path, taken: str) -> None:
    (tmp_path / "b").mkdir()
    first, second = _file(tmp_path, VALID), _file(tmp_path / "b", VALID.replace("camera_scale", taken), "other.py")
    with pytest.raises(InputError, match=rf"other.py: an effect named '{taken}' is there already; give yours another"):
        catalogue([first, second])


BROKEN = {
    "no summary": ('summary: ClassVar[str] = "the scale of the camera is off"', "", "'summary' is missing or empty"),
    "empty source": ('"a calibration against a ruler"', '""', "'source' is missing or empty; declare it"),
    "no parameters": ("(\n        Parameter(", "()\n    other = (\n        Parameter(", "'parameters' is missing"),
    "one alone": ('"),\n    )', '")\n    )', "must be a tuple of Parameter; with one, write"),
    "domain": ('"data"', '"camera"', "domain 'camera', expected one of data, drive, body, water"),
    "name with a dot": ('= "camera_scale"', '= "camera.scale"', "name 'camera.scale', expected letters, digits and _"),
    "name of a coefficient": ("camera_scale", "c_d", "name 'c_d', expected letters, digits and _, and no kind of"),
    "parameter of another": ("camera_scale.error", "other.error", r"'other.error' must be named 'camera_scale.NAME'"),
    "parameter without name": ("camera_scale.error", "camera_scale", "must be named 'camera_scale.NAME'"),
    "only a shape": ('about="relative', 'shape=True, about="relative', "every parameter is a shape"),
    "empty bounds": ("-0.3, 0.3", "0.3, -0.3", r"camera_scale.error: bounds \[0.3, -0.3\] are empty"),
    "null outside": ("0.0, -0.3, 0.3", "0.5, -0.3, 0.3", "camera_scale.error: default 0.5 - is outside its bounds"),
    "no hook": ("def reading", "def reeding", "it does nothing; declare a load, or override one of drive, body"),
    "load not compiled": ("    def reading", "    load = len\n\n    def reading", "load must be compiled"),
    "two of a name": (
        "        Parameter(",
        '        Parameter("camera_scale.error", "-", 0.0, -0.3, 0.3, 0.0, 0.01),\n        Parameter(',
        "two parameters share a name; give each its own",
    ),
    "needs arguments": (
        "    def reading",
        "    def __init__(self, ruler):\n        pass\n\n    def reading",
        "TypeError: .*missing 1 required positional argument: 'ruler'",
    ),
}


@pytest.mark.parametrize(("old", "new", "complaint"), BROKEN.values(), ids=BROKEN)
def test_a_bad_declaration_is_refused_naming_file_class_and_remedy(
    tmp_path: Path, old: str, new: str, complaint: str
) -> None:
    assert old in VALID
    text = VALID.replace(old, new)
    path = _file(tmp_path, text)
    with pytest.raises(MjfishError, match=complaint) as caught:
        catalogue([path])
    assert isinstance(caught.value, (InputError, ParameterError))
    assert str(caught.value).startswith(f"{path}: ")


def test_a_load_with_too_many_parameters_is_refused(tmp_path: Path) -> None:
    """There is room for so many in compiled code; another one would be read from the next effect's."""
    one = '        Parameter("camera_scale.p{}", "-", 0.0, -0.3, 0.3, 0.0, 0.01),\n'
    many = "".join(map(one.format, range(PARAMETERS)))
    text = VALID.replace("        Parameter(", many + "        Parameter(")
    text = text.replace("    def reading", "    load = Load(lambda link, p: (0.0, 0.0, 0.0))\n\n    def reading")
    with pytest.raises(ParameterError, match=f"effect CameraScale: a load may have {PARAMETERS} parameters at most"):
        catalogue([_file(tmp_path, text)])


def test_a_cause_of_a_fish_is_of_the_module_of_its_class() -> None:
    """By its module a diagnosis finds the files that it depends on."""
    fish = new_fish("trout", length=0.4, mass=0.6, joints=3, height=0.07)
    for effect in of_fish(catalogue(), fish).values():
        assert type(effect).__module__.startswith("mjfish.effects.")
