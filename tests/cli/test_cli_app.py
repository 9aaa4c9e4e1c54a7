"""The command line as a whole: commands, help, version, exit codes, the catalogue, the viewer."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import get_args

import pytest
from command_line import Run

from mjfish.cli import application, console
from mjfish.data.importers import IMPORTERS
from mjfish.effects import catalogue
from mjfish.estimation.settings import Loss

COMMANDS = (
    "simulate",
    "export",
    "check",
    "generate",
    "import",
    "compare",
    "inspect",
    "render",
    "identify",
    "diagnose",
    "sample",
    "plan",
    "study",
    "effects",
    "demo",
    "view",
)
OWN = Path(__file__).parents[1] / "effects" / "own_effects.py"
MAIN = "from mjfish.cli import main; main()"


def test_help_names_every_command(run: Run) -> None:
    shown = run("--help").stdout
    for command in COMMANDS:
        assert f" {command} " in shown


UNITS = {
    "simulate": ("Length of the run [s]",),
    "generate": ("sway [m/s]", "yaw rate [rad/s]", "Length of each trial [s]", "NAME:PARAM=VALUE[,PARAM=VALUE]"),
    "compare": ("time [s], surge [m/s], sway [m/s]",),
    "plan": ("Duration of a run [s]", "come to rest [s]", "9,30 [rad/s]"),
}


@pytest.mark.parametrize("command", UNITS)
def test_units_are_not_lost_in_the_help(run: Run, command: str) -> None:
    shown = " ".join(run(f"{command} --help").stdout.replace("│", " ").split())
    for text in UNITS[command]:
        assert text in shown
    assert "time [s], surge [m/s]" in " ".join(run("--help").stdout.replace("│", " ").split())


def test_the_help_lists_what_can_be_chosen(run: Run) -> None:
    """These choices are written down there: the packages that know them are slow to import."""
    for command, choices in (("identify", get_args(Loss)), ("import", IMPORTERS)):
        shown = run(f"{command} --help").stdout
        assert all(choice in shown for choice in choices)


def test_a_command_line_is_read_without_what_is_slow_to_import() -> None:
    """One process reads one line after the other, and says what it has imported after each."""
    lines = {"--version": 0, "--help": 0, "simulate --help": 0, "swim": 2, "simulate": 2, "plan a --colour red": 2}
    script = """
import sys
from mjfish.cli import main
for line in sys.argv[1:]:
    sys.argv = ["mjfish", *line.split()]
    try:
        main()
    except SystemExit as left:
        slow = {"numba", "mujoco", "scipy", "rerun", "plotly", "jinja2", "pyarrow", "numpy"} & set(sys.modules)
        print("ended:", line, left.code or 0, slow or "")
"""
    done = subprocess.run([sys.executable, "-c", script, *lines], capture_output=True, text=True, check=True)
    ended = [line.strip() for line in done.stdout.splitlines() if line.startswith("ended:")]
    assert ended == [f"ended: {line} {code}" for line, code in lines.items()]


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_has_help_that_begins_with_a_sentence(run: Run, command: str) -> None:
    shown = run(f"{command} --help").stdout
    assert f"Usage: mjfish {command}" in shown or f" {command} " in shown.splitlines()[1]
    assert any(line.strip().endswith(".") for line in shown.splitlines())


def test_commands_are_registered_once() -> None:
    assert application() is application()
    assert len(application().registered_commands) == len(COMMANDS)


def test_the_version_is_that_of_the_package(run: Run) -> None:
    assert run("--version").stdout.strip() == f"mjfish {version('mjfish')}"


def test_no_command_shows_the_help(run: Run) -> None:
    assert "simulate" in run("", exit_code=2).output


def test_an_unknown_command_and_an_unknown_option_are_misuse(refuse: Callable[[str], str]) -> None:
    assert "No such command 'swim'" in refuse("swim")
    assert "No such option: --colour" in refuse("effects --colour red")


def test_the_installed_command_exits_with_2_and_no_traceback_on_bad_input(tmp_path: Path) -> None:
    """One line for the error, and one for the warning of a home that nobody can write to."""
    environment = {"HOME": "/dev/null", "TMPDIR": str(tmp_path), "PYTHONPATH": os.pathsep.join(sys.path)}
    done = subprocess.run(
        [sys.executable, "-c", MAIN, "identify", "absent"], env=environment, capture_output=True, text=True,
        cwd=tmp_path, check=False,
    )  # fmt: skip
    assert done.returncode == 2
    assert done.stdout == ""
    warned, refused = done.stderr.splitlines()
    assert warned.startswith("warning: compiled code cannot be kept (")
    assert warned.endswith("set XDG_CACHE_HOME to a folder that you can write to")
    assert refused.startswith("error: absent: no such file")


def test_the_catalogue_is_listed_with_every_parameter_unit_and_bound(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whole names, in a terminal of 80 columns too: they are what a user has to type."""
    monkeypatch.setattr(console.out, "_width", 80)
    shown = run("effects").stdout
    for effect in catalogue().values():
        assert f"{effect.name}: {effect.summary}" in shown
        for p in effect.parameters:
            assert f"{p.name} [{p.unit}]" in shown
            assert f"{p.low:g} to {p.high:g}" in shown
    assert max(map(len, shown.splitlines())) <= 80


def test_a_users_causes_are_listed_with_the_shipped_ones(run: Run) -> None:
    """Their text may hold brackets, which are no markup."""
    shown = run(f"effects --effects {OWN}").stdout
    assert "camera_scale.error [-]" in shown
    assert "linear_damping.coefficient [N s/m]" in shown
    assert "right [all else equal]" in shown
    assert "time_offset.offset [s]" in shown


def test_a_file_of_effects_that_cannot_be_used_is_refused(refuse: Callable[[str], str], tmp_path: Path) -> None:
    assert refuse("effects --effects absent.py") == "error: absent.py: no such file of effects; correct the path"
    (tmp_path / "mine.py").write_text("x = [\n", encoding="utf-8")
    assert "mine.py: running the file failed: SyntaxError" in refuse("effects --effects mine.py")


@pytest.mark.parametrize("content", [None, "no log"])
def test_view_refuses_what_is_no_log(refuse: Callable[[str], str], tmp_path: Path, content: str | None) -> None:
    if content is not None:
        (tmp_path / "fish.rrd").write_text(content, encoding="utf-8")
    assert "error: fish.rrd: n" in refuse("view fish.rrd")
