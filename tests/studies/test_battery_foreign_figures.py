"""Figures of mechanisms on handmade answers."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mjfish.errors import InputError
from studies.battery import foreign_figures
from studies.battery.__main__ import every_form, tasks
from studies.battery.answers import Answered, Judged, Sealed, judged, run, sealed_answers
from studies.battery.generator.foreign import FOREIGN
from studies.battery.generator.truth import Truth

TRUTH = Truth(
    seed=1,
    split="open",
    kind="foreign",
    causes=("drag_crisis",),
    psi={
        "drag_crisis.size": 0.5,
        "drag_crisis.share": 0.0,
        "drag_crisis.across": 0.4,
        "drag_crisis.along": 0.2,
        "drag_crisis.width": 0.5,
    },
    exact={"drag_crisis": False},
    theta={"c_d.body": 1.2},
    strength={"drag_crisis": 200.0},
    strength_all={},
    reached={},
    absorbed={},
    n=5000,
    noise={"kind": "white"},
    stated=True,
    disturbance={},
    pose=True,
    roll=False,
    runs=(("a",), ("b",)),
)


def _curve(error: float, half: float) -> dict[str, Any]:
    """Return a curve that is off by a share, with a band of half a width; visited from 0.2 to 0.8 m/s."""
    x = np.linspace(0.1, 1.0, 10)
    y = (1.0 + error) * 1.2 * (1.0 + 0.5 / (1.0 + (x / 0.4) ** 4))
    values = {"values": list(y), "low": list((1.0 - half) * y), "high": list((1.0 + half) * y)}
    return {
        "quantity": "c_d",
        "group": "body",
        "x": {"values": list(x)},
        "y": values,
        "nominal": list(y / (1.0 + error) * 1.3),
        "visited": [0.2, 0.8],
    }


def _case(
    *named: tuple[str, str, str], truth: Truth = TRUTH, sets: tuple[tuple[str, ...], ...] = (), curve: Any = None
) -> Judged:
    mechanisms = [
        {"name": name, "level": level, "form": form, "forms": [form], "curves": [curve] if curve else []}
        for name, level, form in named
    ]
    held = {"nominal": {"pooled": 0.5}, "extended": {"pooled": 0.4 if named else 0.5}}
    answer = {
        "verdict": "named" if named else "cannot_tell",
        "message": "",
        "mechanisms": mechanisms,
        "causes": {form: {} for _, _, form in named},
        "alternatives": [list(names) for names in sets],
        "gain": {"held_out": held},
        "floor": 0.3,
        "seconds": 1.0,
    }
    return Judged(truth, answer)


def _row(cases: list[Judged], what: str) -> foreign_figures.Figure:
    return next(row for row in foreign_figures.figures(cases) if what in row.what)


RIGHT = ("drag_law", "mechanism", "drag_law")
CLAIM = ("drag_law", "form", "reynolds_drag")


def test_the_mechanism_is_right_alone_and_a_formula_may_be_claimed() -> None:
    weak = replace(TRUTH, strength={"drag_crisis": 40.0})
    cases = [_case(RIGHT), _case(CLAIM), _case(RIGHT, ("lift", "mechanism", "lift")), _case(), _case(RIGHT, truth=weak)]
    medium = _row(cases, "lambda of 90 or more")
    assert (medium.count, medium.total) == (2, 4)
    assert (_row(cases, "below 90").count, _row(cases, "below 90").total) == (1, 1)
    claim = _row(cases, "another formula claimed")
    assert (claim.count, claim.total) == (1, 3)
    wrong = _row(cases, "not there")
    assert (wrong.count, wrong.total) == (1, 4)


def test_the_same_law_under_the_solvers_name_is_no_false_claim() -> None:
    truth = replace(TRUTH, causes=("shed_momentum",), strength={"shed_momentum": 200.0}, psi={})
    assert not foreign_figures.claimed(_case(("reactive_force", "form", "edge_momentum"), truth=truth))
    assert foreign_figures.claimed(_case(("reactive_force", "form", "munk_moment"), truth=truth))


def test_sets_that_stay_are_judged_by_their_mechanisms() -> None:
    cases = [
        _case(sets=(("servo_lag",), ("reynolds_drag",))),
        _case(sets=(("servo_lag",), ("reynolds_drag", "fin_lift"))),
        _case(sets=(("reynolds_drag", "linear_drag"),)),
    ]
    assert [foreign_figures.in_sets(case) for case in cases] == [True, False, True]


def test_a_curve_is_held_against_the_planted_one_where_the_runs_have_been() -> None:
    (near,) = foreign_figures.curve_scores(_case(RIGHT, curve=_curve(0.02, 0.05)))
    assert near.error == pytest.approx(0.02)
    assert near.nominal == pytest.approx(0.3)
    assert near.inside == (True,) * 7
    (far,) = foreign_figures.curve_scores(_case(RIGHT, curve=_curve(-0.1, 0.05)))
    assert far.error == pytest.approx(0.1)
    assert not any(far.inside)
    whole = replace(TRUTH, causes=("whole_speed_power",), psi={"whole_speed_power.pressure": 0.2})
    assert not foreign_figures.curve_scores(_case(RIGHT, truth=whole, curve=_curve(0.0, 0.1)))
    assert not foreign_figures.curve_scores(_case(("lift", "mechanism", "lift"), curve=_curve(0.0, 0.1)))


def test_the_gain_counts_what_is_above_the_noise() -> None:
    """0.25 falls to 0.16 with noise at 0.09: 9 of 16."""
    assert foreign_figures.share_gained([_case(RIGHT)]) == pytest.approx(9.0 / 16.0)
    assert foreign_figures.share_gained([_case()]) == 0.0
    assert foreign_figures.share_gained([_case(RIGHT), _case()]) == pytest.approx(9.0 / 32.0)


def test_a_domain_off_the_list_is_wrong_where_nothing_acts_in_it() -> None:
    battery = replace(TRUTH, kind="off_list", causes=("fading_battery",), psi={})
    cases = [_case(truth=battery) for _ in range(3)]
    for case, domain in zip(cases, ("drive", "water", None), strict=True):
        case.answer["domain"] = domain  # type: ignore[index]
    wrong = _row(cases, "a wrong domain stated")
    assert (wrong.count, wrong.total) == (1, 3)
    assert _row(cases, "off the list: named").count == 0


def test_a_pair_is_exact_by_its_mechanisms() -> None:
    pair = replace(TRUTH, kind="foreign_pair", causes=("drag_crisis", "servo_lag"), psi={})
    servo = ("servo_dynamics", "form", "servo_lag")
    row = _row([_case(RIGHT, servo, truth=pair), _case(servo, truth=pair)], "pairs, one of a foreign form")
    assert (row.count, row.total) == (1, 2)


def test_catalogue_cases_are_right_by_mechanism_where_the_form_is_another() -> None:
    truth = replace(TRUTH, kind="one", causes=("servo_lag",), strength={"servo_lag": 200.0}, psi={})
    cases = [
        _case(("servo_dynamics", "form", "servo_lag"), truth=truth),
        _case(("servo_dynamics", "mechanism", "servo_second_order"), truth=truth),
        _case(("clock", "form", "time_offset"), truth=truth),
    ]
    assert _row(cases, "catalogue: right mechanism").count == 2
    assert _row(cases, "catalogue: right form").count == 1


def test_the_table_has_a_row_by_form() -> None:
    rows = foreign_figures.by_form([_case(RIGHT), _case(CLAIM), _case()])
    assert rows[-1] == "| drag_law | `drag_crisis` | 3 | 2 | 1 | 0 | 1 `cannot_tell` |"
    assert "RIGHT CLAIMED" in foreign_figures.line(_case(CLAIM))


def test_every_form_has_a_medium_and_a_weak_case() -> None:
    made = every_form(100, "open")
    assert [task.cause for task in made[: len(FOREIGN)]] == [cause.name for cause in FOREIGN]
    assert len({task.name for task in made}) == len({task.seed for task in made}) == 2 * len(FOREIGN)


def test_truths_are_sealed_before_any_diagnosis_and_told_by_their_hash(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A truth that is drawn, or committed, after an answer is known."""
    order: list[str] = []

    def sealed(piece: Sealed) -> dict[str, Any]:
        order.append("truth")
        truth = replace(TRUTH, seed=piece.task.seed)
        return {"truth": asdict(truth), "seal": truth.seal}

    def answered(_: Answered) -> dict[str, Any]:
        order.append("answer")
        return dict(_case(RIGHT).answer)

    monkeypatch.setattr(Sealed, "result", sealed)
    monkeypatch.setattr(Answered, "result", answered)
    drawn = tasks("foreign:2", "open", 7, "none")
    assert run(drawn, tmp_path).made == 2
    assert run(drawn, tmp_path).there == 2
    assert order == ["truth", "truth", "answer", "answer"]
    first, second = judged(tmp_path)
    assert (first.truth, second.truth) == (replace(TRUTH, seed=7), replace(TRUTH, seed=8))
    told = sealed_answers(tmp_path)
    assert [one["truth"] for one in told] == [first.truth.seal, second.truth.seal]
    assert told[0]["mechanisms"] == [
        {"name": "drag_law", "level": "mechanism", "form": "drag_law", "forms": ["drag_law"]}
    ]
    assert "crisis" not in json.dumps(told)
    (tmp_path / "truth" / "pieces" / f"{Sealed(drawn[0]).key}.json").unlink()
    with pytest.raises(InputError, match="is missing"):
        judged(tmp_path)


def test_a_case_that_fails_is_not_left_out_of_the_figures(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A battery that is better for the cases on which the program breaks."""

    def broken(_: Answered) -> dict[str, Any]:
        raise ZeroDivisionError("by nothing")

    monkeypatch.setattr(Sealed, "result", lambda _: {"truth": asdict(TRUTH), "seal": TRUTH.seal})
    monkeypatch.setattr(Answered, "result", broken)
    assert run(every_form(7, "open", ["drag_crisis"]), tmp_path).failed == 2
    with pytest.raises(InputError, match="failed: ZeroDivisionError: by nothing"):
        judged(tmp_path)
