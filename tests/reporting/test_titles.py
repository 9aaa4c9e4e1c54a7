"""Names for people: every cause and every mechanism has one, and a headline reads as a sentence."""

from __future__ import annotations

from dataclasses import replace

import pytest
from diagnosed import diagnosis, learned_diagnosis

from mjfish.diagnosis.forms import NamedMechanism
from mjfish.effects import catalogue
from mjfish.effects.mechanism import MECHANISMS
from mjfish.reporting.titles import cause_title, headline, mechanism_title


def test_every_cause_and_every_mechanism_has_a_title_that_no_other_has() -> None:
    effects = catalogue()
    causes = [cause_title(name, effects) for name in effects]
    mechanisms = [mechanism_title(name, effects) for name in MECHANISMS]
    for titles in (causes, mechanisms):
        assert len(set(titles)) == len(titles)
        for title in titles:
            assert title[0].isupper()
            assert "_" not in title
            assert len(title) < 75
    assert {effect.mechanism for effect in effects.values()} <= {*MECHANISMS, *effects}


def test_a_cause_that_is_its_own_mechanism_says_it_for_both_and_an_unknown_one_by_its_name() -> None:
    own = {"gyro_gain": catalogue()["time_offset"]}
    assert mechanism_title("gyro_gain", own) == "The clocks of camera and drive are apart"
    assert cause_title("lost", {}) == mechanism_title("lost", {}) == "Lost"


def test_a_headline_says_what_acts_and_the_names_of_the_code_stand_in_no_headline() -> None:
    assert headline(diagnosis()) == "The servos follow their command late"
    assert headline(learned_diagnosis()) == "Drag is another function of the speed"
    tail = NamedMechanism("tail_flexibility", "body", "mechanism", "tail_compliance", (), ())
    clock = NamedMechanism("clock", "data", "form", "time_offset", ("time_offset",), ())
    assert headline(diagnosis(mechanisms=(tail, clock))) == "The tail bends, and the camera's clock is off"


@pytest.mark.parametrize("count", [0, 2, 4])
def test_rivals_are_listed_where_they_are_few_and_counted_where_they_are_many(count: int) -> None:
    names = ("servo_lag", "time_offset", "tail_compliance", "linear_drag")[:count]
    found = replace(diagnosis("cannot_tell"), rivals=(names,) if names else ())
    which = "the data cannot tell which"
    assert (
        headline(found)
        == {
            0: "The data cannot tell the cause",
            2: f"The servos follow their command late, or the clocks of camera and drive are apart: {which}",
            4: f"One of 4 causes, and {which}",
        }[count]
    )
