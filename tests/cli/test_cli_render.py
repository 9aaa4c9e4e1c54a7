"""``mjfish render``."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Callable
from pathlib import Path

import imageio.v3 as imageio
import pytest
from command_line import Run
from diagnosed import diagnosis
from gl import skip_without_gl

from mjfish.reporting import film


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    """Draw few and small pictures."""
    skip_without_gl()
    for suffix in film.SUFFIXES:
        monkeypatch.setitem(film._SIZES, suffix, (320, 180))
    monkeypatch.setitem(film._RATES, ".gif", 2.0)


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The log of a diagnosis, written once."""
    path = tmp_path_factory.mktemp("log") / "fish.rrd"
    diagnosis().log(path)
    return path


@pytest.fixture
def found(tmp_path: Path, log: Path) -> Path:
    """A folder such as `mjfish diagnose --out` writes."""
    folder = tmp_path / "found"
    folder.mkdir()
    shutil.copy(log, folder)
    return folder


@pytest.mark.usefixtures("small")
@pytest.mark.parametrize("fish", ["pike", "eth_tendon"])
def test_a_fish_swims_by_its_cpg_or_by_a_wave(run: Run, tmp_path: Path, fish: str) -> None:
    shown = run(f"render {fish} --out swim.png").stdout
    assert f"wrote swim.png: {'v1' if fish == 'pike' else 'wave'}, " in shown
    assert imageio.imread(tmp_path / "swim.png").shape == (180, 320, 3)


@pytest.mark.usefixtures("small")
def test_a_rollout_is_shown_whole(run: Run, tmp_path: Path) -> None:
    run("simulate --mode v3 --duration 2 --out a")
    assert "wrote a.gif: v3, 0.00 to 2.00 s" in run("render a --out a.gif").stdout
    assert len(imageio.imread(tmp_path / "a.gif")) == 4
    assert "wrote b.png: v3, 0.00 to 2.00 s" in run("render a/rollout.rrd --out b.png").stdout


@pytest.mark.usefixtures("small", "found")
def test_of_a_diagnosis_the_held_out_run_is_shown_or_the_named_one(run: Run) -> None:
    assert "wrote a.png: fast, " in run("render found --out a.png").stdout
    assert "wrote b.png: slow, " in run("render found --trial slow --out b.png").stdout


@pytest.mark.usefixtures("found")
def test_a_machine_that_cannot_draw_says_so_and_writes_nothing(
    refuse: Callable[[str], str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MUJOCO_GL", "osmesa")
    monkeypatch.setitem(sys.modules, "mujoco.osmesa", None)
    assert "OpenGL does not start by mujoco.osmesa" in _last(refuse, "render found --out a.png")


def _last(refuse: Callable[[str], str], line: str) -> str:
    """Return the complaint: progress is told before it."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("mjfish.cli.console._Stage._shown", lambda _stage: None)
        return refuse(line)


@pytest.mark.usefixtures("found")
@pytest.mark.parametrize(
    ("line", "complaint"),
    [
        ("render pikee --out a.png", "pikee"),
        ("render pike --out a.avi", "a.avi: the name ends in '.avi', expected .mp4 or .gif or .png; rename it"),
        ("render pike --out absent/a.png", "there is no folder absent"),
        ("render pike --trial v1 --out a.png", "--trial: pike is a fish and has no trials"),
        ("render found --trial v1 --out a.png", "trial 'v1'"),
        ("render absent.rrd --out a.png", "absent.rrd: no such file"),
        ("render found/diagnosis.json --out a.png", "name its folder"),
        ("render . --out a.png", "has neither fish.rrd nor rollout.rrd"),
    ],
)
def test_bad_input_is_refused(refuse: Callable[[str], str], line: str, complaint: str) -> None:
    assert complaint in _last(refuse, line)
