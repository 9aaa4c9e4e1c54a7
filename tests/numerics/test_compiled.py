"""Compilation and its cache on disk."""

from __future__ import annotations

import shutil
import subprocess
import sys
import textwrap
from pathlib import Path

import numba
import numpy as np
import pytest

from mjfish.numerics import compiled as compiling
from mjfish.numerics.compiled import c_callback, compiled, part


def _folder_in_fresh_process(package: Path, home: Path) -> str:
    code = "from mjfish.numerics.compiled import cache_folder; print(cache_folder())"
    environment = {"XDG_CACHE_HOME": str(home), "PYTHONPATH": str(package), "PATH": ""}
    done = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True, cwd=package
    )
    return done.stdout.strip()


def test_the_cache_folder_changes_with_any_compiled_source_and_with_nothing_else(tmp_path: Path) -> None:
    """An edit in a file that a compiled function calls must not find yesterday's machine code."""
    source = Path(compiling.__file__).parents[1]
    package = tmp_path / "mjfish"
    package.mkdir()
    for name in ("__init__.py", "numerics/compiled.py", "hydro/force.py", "effects/mine.py", "report/page.py"):
        (package / name).parent.mkdir(exist_ok=True)
        (package / name).write_text(
            (source / name).read_text() if name in ("__init__.py", "numerics/compiled.py") else ""
        )
    folders = [_folder_in_fresh_process(tmp_path, tmp_path)]
    assert folders[0].startswith(str(tmp_path / "mjfish"))
    (package / "report" / "page.py").write_text("x = 1")
    force = (package / "hydro/force.py").read_text()
    (package / "hydro/force.py").write_text("# A comment alone changes no machine code.\n" + force)
    assert _folder_in_fresh_process(tmp_path, tmp_path) == folders[0]
    for name, code in {"hydro/force.py": force + "x = 1", "effects/mine.py": "x = 2"}.items():
        (package / name).write_text(code)
        folders.append(_folder_in_fresh_process(tmp_path, tmp_path))
    assert len(set(folders)) == 3


@pytest.mark.slow
def test_every_file_with_compiled_functions_is_a_source_of_the_cache() -> None:
    package = Path(compiling.__file__).parents[1]
    sources = {file for pattern in compiling._COMPILED for file in package.glob(pattern)}
    using = {file for file in package.rglob("*.py") if "from mjfish.numerics.compiled import" in file.read_text()}
    assert using <= sources
    assert len(using) > 20


def test_a_copy_of_the_package_elsewhere_finds_the_machine_code(tmp_path: Path) -> None:
    """A fresh clone has new dates and a new place; the code is the same."""
    source = Path(compiling.__file__).parents[1]
    counts = []
    for place in ("one", "two"):
        shutil.copytree(source, tmp_path / place / "mjfish")
        environment = {"XDG_CACHE_HOME": str(tmp_path), "PYTHONPATH": str(tmp_path / place), "PATH": ""}
        code = "from mjfish.effects.linear_drag import LinearDrag; LinearDrag.load.address"
        subprocess.run([sys.executable, "-P", "-c", code], env=environment, check=True, cwd=tmp_path)
        counts.append(len(list((tmp_path / "mjfish").rglob("*.nbc"))))
    assert counts[0] > 0
    assert counts == [counts[0]] * 2


def test_numbas_own_setting_is_left_as_it_was() -> None:
    before = numba.config.CACHE_DIR

    @compiled
    def twice(x: float) -> float:
        return 2.0 * x

    assert twice(3.0) == 6.0
    assert before == numba.config.CACHE_DIR


def test_division_by_zero_is_that_of_ieee_not_an_exception() -> None:
    """A rollout that diverges ends in a status; an exception from deep within would not."""

    @compiled
    def divide(a: float, b: float) -> float:
        return a / b

    assert divide(1.0, 0.0) == np.inf
    assert np.isnan(divide(0.0, 0.0))


def test_a_c_callback_has_an_address_that_c_can_call() -> None:
    @c_callback(numba.types.float64(numba.types.float64))
    def half(x: float) -> float:
        return 0.5 * x

    assert half.address > 0
    assert half.ctypes(3.0) == pytest.approx(1.5)


def test_a_part_is_typed_once_whatever_constants_it_is_called_with_and_callable_from_python() -> None:
    """Numba would type, and compile, a function anew for every constant that it is called with."""

    @part
    def plus(a: float, b: int) -> float:
        return a + b

    @compiled
    def both(a: float) -> float:
        return plus(a, 1) + plus(a, 2)

    assert both(1.0) == 5.0
    assert len(plus.overloads) == 1
    assert plus(1.0, 4) == 5.0


def _run(script: Path, code: str) -> str:
    """Run `code` as a user's own file, with a cache of its own beside it."""
    script.write_text(textwrap.dedent(code))
    environment = {
        "XDG_CACHE_HOME": str(script.parent),
        "PYTHONPATH": str(Path(compiling.__file__).parents[2]),
        "PYTHONDONTWRITEBYTECODE": "1",  # two edits within a second look the same to Python's own cache
        "PATH": "",
    }
    done = subprocess.run(
        [sys.executable, script.name], env=environment, capture_output=True, text=True, cwd=script.parent
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


@pytest.mark.slow
def test_a_second_process_loads_machine_code_and_adds_none(tmp_path: Path) -> None:
    """Loads are closures over what they call: their key must be the same in every process; a user's are not kept."""
    code = """
        from mjfish.effects.linear_drag import LinearDrag
        from mjfish.hydro.load import load

        @load
        def push(link, parameters):
            return parameters[0], 0.0, 0.0

        LinearDrag.load.address, push.address
        """
    counts = []
    for _ in range(3):
        _run(tmp_path / "loads.py", code)
        counts.append(len(list((tmp_path / "mjfish").rglob("*.nbc"))))
    assert counts[0] > 0
    assert counts == [counts[0]] * 3


def test_a_users_file_sees_the_edit_of_another_file_that_it_reads(tmp_path: Path) -> None:
    """Constants are frozen into machine code: taken from the cache, yesterday's would be used without a word."""
    code = """
        from constants import SLOPE
        from mjfish.numerics.compiled import compiled

        @compiled
        def line(x):
            return SLOPE * x

        print(line(1.0))
        """
    for slope in ("2.0", "3.0"):
        (tmp_path / "constants.py").write_text(f"SLOPE = {slope}")
        assert _run(tmp_path / "mine.py", code) == slope


@pytest.mark.parametrize("home", [pytest.param("/dev/null", marks=pytest.mark.slow), ""])
def test_where_nothing_can_be_kept_it_runs_and_says_so_once(tmp_path: Path, home: str) -> None:
    """A home that is no folder, or none at all; numba alone refuses to compile there."""
    script = (
        "import pwd\n"
        "pwd.getpwuid = lambda _: (_ for _ in ()).throw(KeyError())\n"  # a container's user has no entry
        "from mjfish.effects.linear_drag import LinearDrag\n"
        "LinearDrag.load.address\n"
        "from mjfish.numerics.compiled import c_callback, compiled, keeps_code\n"
        "assert not keeps_code()\n"
        "print(compiled(lambda x: 2.0 * x)(3.0))\n"
    )
    environment = {"PYTHONPATH": str(Path(compiling.__file__).parents[2]), "PATH": "", "TMPDIR": str(tmp_path)}
    environment |= {"HOME": home} if home else {}
    ran = subprocess.run([sys.executable, "-c", script], env=environment, capture_output=True, text=True, check=False)
    assert ran.stdout == "6.0\n", ran.stderr
    assert ran.stderr.count("compiled code cannot be kept") == 1
    assert "set XDG_CACHE_HOME" in ran.stderr
    assert not list(tmp_path.iterdir())
