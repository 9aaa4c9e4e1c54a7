"""The wheel as a user has it: in an environment of its own, not writable, without a home, far from the sources."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import venv
from pathlib import Path

import pytest
from schema_check import complaints

_ROOT = Path(__file__).parents[1]
_PIP = ("-m", "pip", "--quiet", "--disable-pip-version-check")


def _run(*command: str | Path, **options: object) -> subprocess.CompletedProcess[str]:
    done = subprocess.run(command, capture_output=True, text=True, check=False, **options)  # type: ignore[call-overload]
    assert done.returncode == 0, done.stdout + done.stderr
    return done


@pytest.mark.slow
def test_the_demo_runs_from_a_wheel_that_is_read_only_and_without_a_home(tmp_path: Path) -> None:
    """Who is root may write anywhere: so what is there is compared before and after, too."""
    _run(sys.executable, *_PIP, "wheel", "--no-deps", "--wheel-dir", tmp_path, _ROOT)
    (wheel,) = tmp_path.glob("mjfish-*.whl")
    venv.create(tmp_path / "venv", with_pip=True)
    python = tmp_path / "venv" / "bin" / "python"
    _run(python, *_PIP, "install", "-c", _ROOT / "requirements.lock", wheel)

    cwd, temporary = tmp_path / "work", tmp_path / "tmp"
    cwd.mkdir()
    temporary.mkdir()
    environment = {"HOME": "/dev/null", "TMPDIR": str(temporary), "PATH": os.defpath, "COLUMNS": "200"}
    where = "import mjfish; from importlib.resources import files; print(files(mjfish))"
    package = Path(_run(python, "-c", where, cwd=cwd, env=environment).stdout.strip())
    assert package.is_relative_to(tmp_path / "venv")
    before = _files(package)
    for path in (package, *package.rglob("*")):
        path.chmod(path.stat().st_mode & ~0o222)
    told = _run(python.with_name("mjfish"), "demo", cwd=cwd, env=environment)
    assert _files(package) == before
    assert told.stdout.startswith("named")
    assert told.stderr.count("compiled code cannot be kept") == 1
    assert {path.name for path in cwd.iterdir()} == {"out"}
    assert not complaints("diagnosis-5", json.loads((cwd / "out" / "demo" / "diagnosis.json").read_text()))
    assert {path.name for path in (package / "schemas").iterdir()} == {
        path.name for path in (_ROOT / "mjfish" / "schemas").iterdir()
    }


def _files(folder: Path) -> dict[Path, int]:
    """Return every file with the time of its last change; machine code of Python, which is made anywhere, aside."""
    return {path: path.stat().st_mtime_ns for path in folder.rglob("*") if path.suffix != ".pyc" and path.is_file()}
