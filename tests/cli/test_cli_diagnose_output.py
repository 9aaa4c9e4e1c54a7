"""A diagnosis told in the terminal."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import get_args

import pytest
from diagnosed import CAUSE, diagnosis
from rich.console import ColorSystem

from mjfish.cli import console
from mjfish.cli.diagnosis_text import show
from mjfish.diagnosis import Diagnosis
from mjfish.diagnosis.result import Verdict
from mjfish.diagnosis.setup import CauseText
from mjfish.effects import catalogue
from mjfish.inspection import Finding, Inspection

OWN = Path(__file__).parents[1] / "effects" / "own_effects.py"


@pytest.fixture(autouse=True)
def wide(monkeypatch: pytest.MonkeyPatch) -> None:
    """Tables are not folded."""
    monkeypatch.setattr(console.out, "_width", 200)


def _printed(capsys: pytest.CaptureFixture[str], result: Diagnosis) -> str:
    show(result, "pool", verbose=True)
    return capsys.readouterr().out.replace("\N{NO-BREAK SPACE}", " ")


@pytest.mark.parametrize("verdict", get_args(Verdict))
def test_every_verdict_is_told_with_its_message(capsys: pytest.CaptureFixture[str], verdict: Verdict) -> None:
    shown = _printed(capsys, diagnosis(verdict))
    assert shown.startswith(f"{verdict}  Something to say about {verdict}.")
    assert "c_f.head of the nominal model is at its bound" in shown


def test_a_named_cause_comes_with_estimate_interval_gain_and_confirming_experiment(
    capsys: pytest.CaptureFixture[str],
) -> None:
    shown = _printed(capsys, diagnosis("named"))
    for text in (f"{CAUSE}.time_constant", "0.02010", "0.01950 to 0.02070", "57.0 % to 66.0 %", "3.14 %", "1.20 %"):
        assert text in shown
    assert "mean speed" in shown
    assert f"confirm {CAUSE}: {catalogue()[CAUSE].confirm}" in shown


def test_without_held_out_trials_there_is_no_gain_to_tell(capsys: pytest.CaptureFixture[str]) -> None:
    assert "before and after" not in _printed(capsys, diagnosis("named", held_out=False))


def test_a_rival_from_a_users_file_is_told_apart_too(capsys: pytest.CaptureFixture[str]) -> None:
    """It is in no shipped catalogue. Its text may hold brackets."""
    found = diagnosis("cannot_tell")
    causes = {name: CauseText.of(effect) for name, effect in catalogue([OWN]).items()}
    result = replace(found, rivals=((CAUSE, "camera_scale"),), setup=replace(found.setup, causes=causes))
    shown = _printed(capsys, result)
    assert "test camera_scale: film a ruler" in shown
    assert "mean speed" in shown
    assert f"test {CAUSE}: " in shown


def test_a_fit_that_has_not_converged_is_said_so_in_red_with_what_to_do(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(console.err, "_force_terminal", True)
    monkeypatch.setattr(console.err, "_color_system", ColorSystem.STANDARD)
    show(replace(diagnosis("named"), status="fit_not_converged"), "pool")
    shown = capsys.readouterr().err
    assert "\x1b[1;31mfit_not_converged:" in shown
    assert "mjfish identify pool --starts 16" in shown


def test_what_is_unexplained_sends_first_to_suspect_data_and_to_the_closest_cause(
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Catches an advice to write a cause of one's own before the causes at hand were tried."""
    found = Finding("joints-unresolved", "suspect", "trial 'slow'", "a jump", "none", "cut it")
    shown = _printed(capsys, replace(diagnosis("unexplained"), checks=Inspection((found,))))
    steps = [
        "mend joints-unresolved, it may be the cause",
        f"test what comes closest, {CAUSE}: {catalogue()[CAUSE].confirm}",
        "--effects my_effects.py",
    ]
    places = [shown.index(step) for step in steps]
    assert places == sorted(places)
