"""Figures of the battery: counted right, intervals exact; and the battery itself at a tenth of its size."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from mjfish.study import Executing
from studies.battery import baselines, figures
from studies.battery.__main__ import tasks
from studies.battery.answers import Judged, judged, run
from studies.battery.generator.truth import Truth

SEED = int(os.environ.get("MJFISH_SEED", "20261121"))
TRUTH = Truth(
    seed=1,
    split="open",
    kind="one",
    causes=("servo_lag",),
    psi={"servo_lag.time_constant": 0.01},
    exact={"servo_lag": True},
    theta={},
    strength={"servo_lag": 200.0},
    strength_all={},
    reached={"servo_lag": True},
    absorbed={},
    n=5000,
    noise={"kind": "white"},
    stated=True,
    disturbance={},
    pose=True,
    roll=False,
    runs=(("a",), ("b",)),
    rho={"servo_lag": {"time_offset": 0.9}},
)


def _case(verdict: str, named: dict[str, float], truth: Truth = TRUTH) -> Judged:
    candidates = [
        {"name": "time_offset", "score": 9.0, "error": 0.2, "held_out_error": 0.05},
        {"name": "servo_lag", "score": 8.0, "error": 0.1, "held_out_error": 0.1},
    ]
    causes = {
        name: {"time_constant": {"estimate": size, "low": 0.9 * size, "high": 1.1 * size, "at_bound": False}}
        for name, size in named.items()
    }
    answer: dict[str, Any] = {"verdict": verdict, "causes": causes, "candidates": candidates, "where": "surge"}
    reached = {"servo_lag": 0.1, "time_offset": 0.2}
    held = {"nominal": {"pooled": 0.3}, "extended": {"pooled": reached.get(next(iter(named), ""), 0.3)}}
    answer["gain"] = {"held_out": held} if named else None
    answer["sparse"] = "servo_lag"
    return Judged(truth, {**answer, "alternatives": [list(named)] if named else [], "certain": list(named)})


def _row(cases: list[Judged], start: str) -> figures.Figure:
    return next(row for row in figures.figures(cases) if row.what.startswith(start))


def test_right_wrong_and_silent_answers_are_counted_apart() -> None:
    cases = [
        _case("named", {"servo_lag": 0.0105}),
        _case("named", {"time_offset": 0.01}),
        _case("nothing_wrong", {}),
        _case("unexplained", {}),
    ]
    assert _row(cases, "right single cause").count == 1
    assert _row(cases, "right single cause").total == 4
    assert _row(cases, "wrong single name").count == 1
    assert _row(cases, "in-list called unexplained").count == 1
    assert _row(cases, "set contains the truth").total == 2
    size = _row(cases, "size of the named cause")
    assert size.value == pytest.approx(0.05)
    assert size.good


def test_recall_is_of_certain_members_and_of_the_set_that_fits_best() -> None:
    """Two sets tie in one member: half is certain, all of it in the one that fits best."""
    pair = replace(TRUTH, kind="two", causes=("servo_lag", "roll"), strength={"servo_lag": 200.0, "roll": 150.0})
    tie = _case("cannot_tell", {}, pair)
    sets = [["servo_lag", "roll"], ["time_offset", "roll"]]
    tied = Judged(pair, {**tie.answer, "alternatives": sets, "certain": ["roll"]})
    other = Judged(pair, {**tie.answer, "alternatives": sets[::-1], "certain": ["roll"]})
    assert _row([tied, other], "two effects: recall, members that are certain").count == 2
    assert _row([tied, other], "two effects: recall of the set that fits best").count == 3


def test_the_gain_is_held_against_that_of_the_true_cause() -> None:
    """0.3 falls to 0.1 with the truth; a wrong name that falls to 0.2 has 5/8 of it, silence nothing."""
    cases = [_case("named", {"servo_lag": 0.01}), _case("named", {"time_offset": 0.01}), _case("nothing_wrong", {})]
    row = _row(cases, "held-out gain")
    assert row.value == pytest.approx((1.0 + 5.0 / 8.0 + 0.0) / 3.0)
    assert not row.good


def test_only_causes_that_can_be_told_apart_must_be_named() -> None:
    """A strength of 200 beyond rho = 0.9: lambda (1 - rho) = 20 with lambda = 200, 10 with 100."""
    weak = replace(TRUTH, strength={"servo_lag": 100.0})
    cases = [_case("named", {"servo_lag": 0.01}), _case("cannot_tell", {}, weak)]
    row = _row(cases, "right single cause")
    assert (row.count, row.total) == (1, 1)


def test_what_the_sets_that_stay_share_is_recalled() -> None:
    """One pair is named, of another one member is certain and one open; a certain one that is not there is false."""
    pair = replace(
        TRUTH, kind="two", causes=("linear_drag", "servo_lag"), strength={"linear_drag": 150.0, "servo_lag": 200.0}
    )
    named, open_ = _case("named", {"servo_lag": 0.01, "linear_drag": 1.0}, pair), _case("cannot_tell", {}, pair)
    halves = [Judged(pair, {**open_.answer, "certain": [name]}) for name in ("servo_lag", "roll")]
    recall, wrong = (_row([named, *halves], f"two effects: {what}") for what in ("recall", "false members"))
    assert (recall.count, recall.total) == (3, 6)
    assert (wrong.count, wrong.total) == (1, 4)
    assert _row([named, *halves], "two effects, each").count == 1


def test_an_alarm_without_an_effect_is_false_whatever_it_says() -> None:
    none = replace(TRUTH, kind="none", causes=(), strength={}, rho={})
    cases = [_case("nothing_wrong", {}, none), _case("cannot_tell", {}, none), _case("unexplained", {}, none)]
    row = _row(cases, "false alarms")
    assert (row.count, row.total, row.good) == (2, 3, False)


def test_intervals_are_those_of_clopper_and_pearson() -> None:
    row = figures.proportion("x", "", [True] * 10 + [False] * 190, lambda _: True)
    assert row.interval == pytest.approx((0.0242, 0.0900), abs=5e-4)


def test_every_guesser_names_a_cause() -> None:
    cases = [_case("unexplained", {}), _case("named", {"servo_lag": 0.01})]
    names = {name: guess(cases[0]) for name, guess in baselines.guessers(cases).items()}
    assert names["refit with the lowest error"] == "servo_lag"
    assert names["refit with the lowest held-out error"] == "time_offset"
    assert names["largest score"] == "time_offset"
    assert names["most frequent cause"] == "servo_lag"


def test_kinds_take_turns_and_may_begin_at_a_strength() -> None:
    made = tasks("none:2,two:4@100", "open", 50, "none")
    assert [task.name for task in made] == ["none-50", "two-50", "two-51", "none-51", "two-52", "two-53"]
    assert {task.least for task in made if task.kind == "two"} == {100.0}
    assert {task.least for task in made if task.kind == "none"} == {10.0}


@pytest.mark.slow
def test_the_battery_holds_at_a_tenth_of_its_size(tmp_path: Path) -> None:
    """Bounds that rates at the bars leave with 99.9 %: 20 quiet cases, 20 single causes, 6 pairs, 6 off the list."""
    first = SEED % 400_000 + 500_000
    drawn = tasks("none:20,one:20,two:6,off_list:6", "open", first, "none")
    run(drawn, tmp_path, executing=Executing(jobs=2))
    cases = judged(tmp_path)
    assert len(cases) == len(drawn)
    alarms = [c for c in cases if c.truth.kind == "none" and c.answer["verdict"] != "nothing_wrong"]
    assert len(alarms) <= 3, [(c.truth.seed, c.answer["message"]) for c in alarms]
    singles = [c for c in cases if c.truth.kind == "one" and figures.apart(c) >= figures.TOLD_APART]
    missed = [(c.truth.seed, c.truth.causes, c.answer["message"]) for c in singles if not c.right]
    assert len(missed) <= 3, missed
    wrong = [
        (c.truth.seed, c.truth.causes, sorted(c.named))
        for c in cases
        if c.truth.kind == "one" and c.named - {*c.truth.causes}
    ]
    assert len(wrong) <= 3, wrong


def test_coefficients_count_where_the_verdict_is_right() -> None:
    """A wrong verdict's coefficients are nobody's, and one at a bound has no interval."""
    truth = replace(TRUTH, theta={"c_d.head": 1.0, "c_d.tail": 1.0, "c_d.body": 1.0})
    own = {
        "c_d.head": {"low": 0.9, "high": 1.1, "at_bound": False},
        "c_d.tail": {"low": 1.1, "high": 1.2, "at_bound": False},
        "c_d.body": {"low": 0.9, "high": 1.1, "at_bound": True},
    }
    right, wrong = _case("named", {"servo_lag": 0.01}, truth), _case("named", {"time_offset": 0.01}, truth)
    for case in (right, wrong):
        case.answer["coefficients"] = own  # type: ignore[index]
    assert figures.coefficients([right]) == [True, False]
    assert figures.coefficients([wrong]) == []
