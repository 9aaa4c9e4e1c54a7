"""A diagnosis told in the terminal."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import get_args

import pytest
from diagnosed import CAUSE, diagnosis

from mjfish.cli import console, narrate
from mjfish.diagnosis.result import Verdict
from mjfish.effects import catalogue

OWN = Path(__file__).parents[1] / "effects" / "own_effects.py"


@pytest.fixture(autouse=True)
def wide(monkeypatch: pytest.MonkeyPatch) -> None:
    """Tables are not folded."""
    monkeypatch.setattr(console.out, "_width", 200)


def _told(capsys: pytest.CaptureFixture[str], result: object, known: object = None) -> str:
    narrate.diagnosis(result, known or catalogue())  # type: ignore[arg-type]
    return capsys.readouterr().out


@pytest.mark.parametrize("verdict", get_args(Verdict))
def test_every_verdict_is_told_with_its_message(capsys: pytest.CaptureFixture[str], verdict: Verdict) -> None:
    shown = _told(capsys, diagnosis(verdict))
    assert shown.startswith(f"{verdict}  Something to say about {verdict}.")
    assert "c_f.head of the nominal model rests on its bound" in shown


def test_a_named_cause_comes_with_estimate_interval_gain_and_confirming_experiment(
    capsys: pytest.CaptureFixture[str],
) -> None:
    shown = _told(capsys, diagnosis("named"))
    for text in (f"{CAUSE}.time_constant", "0.0201", "0.0195 to 0.0207", "57.0% to 66.0%", "0.0314", "0.0120"):
        assert text in shown
    assert f"To confirm {CAUSE}: {catalogue()[CAUSE].confirm}." in shown


def test_without_held_out_trials_there_is_no_gain_to_tell(capsys: pytest.CaptureFixture[str]) -> None:
    assert "before and after" not in _told(capsys, diagnosis("named", held_out=False))


def test_a_rival_from_a_users_file_is_told_apart_too(capsys: pytest.CaptureFixture[str]) -> None:
    """It is in no shipped catalogue. Its text may hold brackets."""
    result = replace(diagnosis("cannot_tell"), rivals=((CAUSE, "camera_scale"),))
    shown = _told(capsys, result, catalogue([OWN]))
    assert "To confirm camera_scale: film a ruler." in shown
    assert f"To confirm {CAUSE}: " in shown
