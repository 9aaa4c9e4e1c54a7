"""The declaration of a number that can be fitted."""

from __future__ import annotations

import math
from dataclasses import FrozenInstanceError, replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mjfish.errors import ParameterError
from mjfish.parameters import Parameter

DRAG = Parameter("c_d.head", "-", default=1.0, low=0.1, high=4.0, start=2.0, scale=0.2, about="drag across the head")


def test_a_name_is_a_group_and_what_it_is_within_it() -> None:
    assert DRAG.group == "c_d"
    assert replace(DRAG, name="servo_lag.time_constant").group == "servo_lag"


@pytest.mark.parametrize("value", [0.1, 4.0, 1.7])
def test_a_value_within_the_bounds_is_returned(value: float) -> None:
    assert DRAG.check(value) == value


@pytest.mark.parametrize("value", [0.0999, 4.0001, -1.0, math.nan, math.inf, -math.inf])
def test_a_value_outside_is_refused_by_name_with_the_bounds_and_the_remedy(value: float) -> None:
    with pytest.raises(ParameterError) as caught:
        DRAG.check(value)
    message = str(caught.value)
    for part in ("c_d.head", f"{value:g}", "[0.1, 4]", "choose a value inside, or widen the bounds"):
        assert part in message


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"low": 4.0, "high": 0.1}, r"bounds \[4, 0.1\] are empty; low must be below high"),
        ({"low": 1.0, "high": 1.0}, r"bounds \[1, 1\] are empty"),
        ({"default": 5.0}, r"default 5 - is outside its bounds \[0.1, 4\]"),
        ({"start": 0.0}, r"start 0 - is outside its bounds"),
        ({"scale": 0.0}, "scale is 0, expected a positive number"),
        ({"scale": -1.0}, "scale is -1, expected a positive number"),
        ({"high": math.nan}, "high is nan, expected a finite number"),
        ({"high": math.inf}, "high is inf, expected a finite number"),
        ({"default": math.nan}, "default is nan, expected a finite number"),
    ],
)
def test_declarations_that_contradict_themselves_are_refused(change: dict[str, float], complaint: str) -> None:
    with pytest.raises(ParameterError, match="c_d.head: " + complaint):
        replace(DRAG, **change)


def test_a_declaration_cannot_be_changed() -> None:
    with pytest.raises(FrozenInstanceError):
        DRAG.low = 0.0


@given(st.floats(-5.0, 5.0), st.floats(0.01, 5.0))
def test_new_bounds_take_default_and_start_to_the_nearest_of_them(low: float, width: float) -> None:
    moved = DRAG.rebound(low=low, high=low + width)
    assert (moved.low, moved.high) == (low, low + width)
    for old, new in ((DRAG.default, moved.default), (DRAG.start, moved.start)):
        assert new == min(max(old, low), low + width)
    assert (moved.name, moved.unit, moved.scale) == (DRAG.name, DRAG.unit, DRAG.scale)


def test_new_bounds_keep_what_is_not_given() -> None:
    assert DRAG.rebound() == DRAG
    assert DRAG.rebound(start=3.0) == replace(DRAG, start=3.0)
    assert DRAG.rebound(high=1.5) == replace(DRAG, high=1.5, start=1.5)


def test_a_new_start_outside_the_new_bounds_is_refused() -> None:
    with pytest.raises(ParameterError, match="start 9"):
        DRAG.rebound(start=9.0)
