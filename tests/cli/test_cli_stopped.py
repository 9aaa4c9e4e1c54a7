"""Ctrl-C, quiet commands, JSON on standard output, colours, and the stage that compiles."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from command_line import Run
from diagnosed import diagnosis
from numba import njit
from schema_check import complaints

import mjfish
from mjfish.cli import console
from mjfish.cli.diagnose import DEMO
from mjfish.diagnosis import Diagnosis


def _stop(*_: Any, **__: Any) -> Any:
    raise KeyboardInterrupt


@pytest.fixture
def diagnosed(monkeypatch: pytest.MonkeyPatch) -> None:
    """The diagnosis is made by hand."""
    monkeypatch.setattr(mjfish, "diagnose", lambda *_, **__: diagnosis())


def test_ctrl_c_in_the_computation_says_that_nothing_was_written(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mjfish, "diagnose", _stop)
    stopped = run(f"diagnose {DEMO} --out found", exit_code=130)
    assert stopped.stdout == ""
    assert stopped.stderr.splitlines()[-1] == "stopped: nothing was written"
    assert not list(tmp_path.iterdir())


@pytest.mark.usefixtures("diagnosed")
def test_ctrl_c_between_two_files_names_the_first(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Diagnosis, "report", _stop)
    stopped = run(f"diagnose {DEMO} --out found", exit_code=130)
    assert stopped.stderr.splitlines()[-1] == "stopped: kept: found/diagnosis.json"
    assert [path.name for path in (tmp_path / "found").iterdir()] == ["diagnosis.json"]


def test_ctrl_c_in_another_command_is_one_line(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mjfish, "load_dataset", _stop)
    assert run(f"inspect {DEMO}", exit_code=130).stderr.splitlines()[-1].startswith("stopped: ")


@pytest.mark.usefixtures("diagnosed")
def test_quiet_is_silent_and_json_has_standard_output_alone(run: Run) -> None:
    quiet = run(f"diagnose {DEMO} --quiet")
    assert (quiet.stdout, quiet.stderr) == ("", "")
    told = json.loads(run(f"diagnose {DEMO} --json -").stdout)
    assert told["verdict"] == "named"
    assert not complaints("diagnosis-5", told)


@pytest.mark.usefixtures("diagnosed")
def test_no_colour_where_standard_output_is_no_terminal(run: Run) -> None:
    assert "\x1b" not in run(f"diagnose {DEMO}").output


def test_progress_names_the_stage_and_says_when_it_compiles(capsys: pytest.CaptureFixture[str]) -> None:
    with console.progress_bar("reading the data") as tell:
        tell("fitting", 0.1)
        assert njit(lambda x: x + 1)(1) == 2
    assert capsys.readouterr().err.splitlines() == ["reading the data (0%)", "fitting: compiling, once (10%)"]


def test_the_shell_can_complete(run: Run) -> None:
    assert "--install-completion" in run("--help").output


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no pseudo-terminals")
@pytest.mark.parametrize(("variables", "coloured"), [({}, True), ({"NO_COLOR": "1"}, False)])
def test_no_color_takes_the_colours_off_a_terminal(variables: dict[str, str], coloured: bool) -> None:
    """https://no-color.org. Catches a style that is written past the console."""
    command = [sys.executable, "-c", "from mjfish.cli import main; main()", "fish", "show", "absent"]
    said = _on_a_terminal(command, variables)
    assert "absent" in said
    assert bool(re.search(r"\x1b\[[0-9;]*\b(3[0-8]|9[0-7])[0-9;]*m", said)) == coloured


def _on_a_terminal(command: list[str], variables: dict[str, str]) -> str:
    """Return what a command writes to a pseudo-terminal."""
    ours, theirs = os.openpty()
    inherited = {name: value for name, value in os.environ.items() if name not in {"NO_COLOR", "FORCE_COLOR"}}
    environment = {**inherited, "TERM": "xterm-256color", **variables}
    with subprocess.Popen(command, stdin=theirs, stdout=theirs, stderr=theirs, env=environment) as process:
        os.close(theirs)
        said = b""
        while chunk := _chunk(ours):
            said += chunk
        process.wait()
    os.close(ours)
    return said.decode()


def _chunk(terminal: int) -> bytes:
    """Return what there is to read; nothing where the other side has closed, which Linux says by an error."""
    try:
        return os.read(terminal, 4096)
    except OSError:
        return b""
