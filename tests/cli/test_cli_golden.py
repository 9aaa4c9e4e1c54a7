"""What the terminal shows, letter by letter, at 80 and at 120 columns: files in ``golden``.

``MJFISH_WRITE_GOLDEN=1`` writes them anew; read the difference before it is committed.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
from diagnosed import diagnosis, learned_diagnosis

from mjfish.cli import console
from mjfish.cli.data import show as show_data
from mjfish.cli.data import show_report
from mjfish.cli.diagnosis_text import LINES, show
from mjfish.data import Dataset, Trial
from mjfish.data.importers import Cut, FileReport, ImportReport
from mjfish.diagnosis import Diagnosis
from mjfish.diagnosis.result import Verdict
from mjfish.effects import catalogue
from mjfish.fish import load_fish
from mjfish.inspection import DataReport, Finding, Inspection
from mjfish.numerics.arrays import readonly

GOLDEN = Path(__file__).with_name("golden")
WRITTEN = [Path("found") / name for name in ("diagnosis.json", "report.html", "fish.rrd", "extended.toml")]


@pytest.fixture(autouse=True)
def called(monkeypatch: pytest.MonkeyPatch) -> None:
    """The program is on the path."""
    monkeypatch.setattr(console, "program", lambda: "mjfish")


def _long(verdict: Verdict) -> Diagnosis:
    """Return a diagnosis with more to say than there is room for."""
    stuck = Finding(
        "stuck", "suspect", "slow, surge, 1.2 s", "12 samples are equal", "noise in every sample", "record it again"
    )
    remarks = tuple(f"remark {number}: " + 12 * "a word and another, " for number in range(9))
    message = "The cause is none of those that are known, " + 4 * "and what explains most is not enough, " + "so far."
    found = diagnosis(verdict)
    return replace(found, message=message, remarks=remarks, checks=Inspection((stuck,)))


def _data_report() -> DataReport:
    """Return two runs of a fish, one with a fault."""
    fish = load_fish("pike")
    time = readonly(np.arange(0.0, 4.0, 0.02))
    velocity = readonly(np.column_stack([0.2 + 0.0 * time, 0.05 * np.sin(time), np.cos(time)]))
    angle = readonly(np.zeros((len(time), 4)))
    trials = (
        Trial("slow", "fit", time, velocity, joint_angle=angle),
        Trial("a_name_that_is_long_2026-01-31", "held_out", time, velocity, joint_angle=angle, commanded=True),
    )
    finding = Finding(
        "clock-jump", "blocks", "slow, 2.1 s", "the time jumps by 0.8 s", "equal steps", "cut the run there"
    )
    hidden = {
        "wall_effect": "the walls are not known",
        "servo_lag": "the joint angles were measured, so no servo stands between them and the model",
        "servo_delay": "the joint angles were measured, so no servo stands between them and the model",
    }
    checks = Inspection((replace(finding, cannot_tell=("*",)),))
    return DataReport(Dataset("tank", fish, trials), checks, hidden, (*hidden, "fin_lift", "munk_moment"))


def _imported() -> ImportReport:
    cuts = (Cut(0.0, 0.12, "end of the record, motion half as well known"), Cut(3.1, 3.6, "head_front, head_back lost"))
    file = FileReport(
        Path("markers_f1_00.csv"), ("f1_00-a", "f1_00-b"), 1502, 1490, 741, 1.003, 0.104, (2.1e-3, 3.4e-3, 0.021),
        0.05, 0.011, cuts, ("12 frames without a pose bridged",),
    )  # fmt: skip
    return ImportReport("fishsim", (file, replace(file, path=Path("markers_f1_25.csv"), cuts=(), noise=None)))


SHOWN: dict[str, Callable[[], None]] = {
    **{verdict: (lambda verdict=verdict: show(diagnosis(verdict), "pool", WRITTEN)) for verdict in get_args(Verdict)},
    "named_nothing_written": lambda: show(diagnosis("named"), "pool"),
    "named_verbose": lambda: show(diagnosis("named"), "pool", WRITTEN, verbose=True),
    "learned": lambda: show(learned_diagnosis(), "pool", WRITTEN),
    "unexplained_with_much_to_say": lambda: show(_long("unexplained"), "pool", WRITTEN),
    "inspect": lambda: show_data(_data_report()),
    "import": lambda: show_report(_imported()),
}


@pytest.fixture(params=[80, 120])
def width(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> int:
    """Columns of the terminal."""
    monkeypatch.setattr(console.out, "_width", request.param)
    return request.param


@pytest.mark.parametrize("name", SHOWN)
def test_the_terminal_shows_what_it_did(name: str, width: int, capsys: pytest.CaptureFixture[str]) -> None:
    SHOWN[name]()
    printed = capsys.readouterr().out
    golden = GOLDEN / f"{name}_{width}.txt"
    if os.environ.get("MJFISH_WRITE_GOLDEN"):
        golden.write_text(printed, encoding="utf-8")
    assert printed == golden.read_text(encoding="utf-8")
    verbose = name == "named_verbose"
    lines = printed.splitlines()
    assert verbose or all(len(line) <= width for line in lines)
    assert "…" not in printed
    if name not in ("inspect", "import") and not verbose:
        assert len(lines) <= LINES


def test_names_of_causes_are_whole_in_the_table_of_evidence(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """At 80 columns, beside numbers as long as they come; of a set they stand below one another."""
    monkeypatch.setattr(console.out, "_width", 80)
    found = diagnosis("named")
    wide = replace(found.table.rows[0], gain=12345.6, behind=1234.5, rival_p=1e-9, chosen=0.123)
    names = (*((name,) for name in catalogue()), *(("wake_kernel", name) for name in catalogue()))
    rows = tuple(replace(wide, names=own) for own in names)
    show(replace(found, table=replace(found.table, corrections=rows)), "pool", verbose=True)
    words = capsys.readouterr().out.split()
    for name in catalogue():
        assert words.count(name) >= 2, name


@pytest.mark.parametrize("name", ["named_verbose", "inspect"])
def test_no_letter_of_a_table_is_lost_however_narrow(
    name: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Numbers and names are broken over lines then: the letters in order are those at full width."""

    def letters(columns: int) -> list[str]:
        monkeypatch.setattr(console.out, "_width", columns)
        SHOWN[name]()
        return sorted(letter for letter in capsys.readouterr().out if letter.isalnum())

    assert letters(44) == letters(300)
