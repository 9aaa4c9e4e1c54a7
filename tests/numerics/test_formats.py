"""Numbers in words, for pages, logs and the terminal."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mjfish.diagnosis import Estimate
from mjfish.numerics.formats import fall, number, p_value, percent


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "0"),
        (3.14159, "3.14"),
        (-0.0195, "−0.0195"),
        (123456.0, "123456"),
        (5.84e-5, "5.84 × 10⁻⁵"),
        (-2.5e9, "−2.50 × 10⁹"),
        (np.nan, "–"),
        (9.9999, "10.0"),
    ],
)
def test_numbers_have_three_digits_and_no_letter_e(value: float, text: str) -> None:
    assert number(value) == text


def test_an_estimate_has_as_many_places_as_its_interval_deserves() -> None:
    value = Estimate(0.123456, 0.0834, 0.1634, "s")
    assert (value.rounded, value.interval) == ("0.123", "0.083 to 0.163")
    assert replace(value, low=0.12345, high=0.12346).rounded == "0.1234560"
    assert replace(value, low=0.123456, high=0.123456).rounded == "0.123"  # on a bound: no interval


def test_an_estimate_on_its_bound_is_the_bound_and_an_interval_without_width_is_left_out() -> None:
    value = Estimate(0.0005, 0.0005, 0.04, "-", at_bound=True)
    assert (value.rounded, value.interval) == ("0.0005", "0.001 to 0.040")
    assert replace(value, high=0.0005).interval == ""


def test_p_values_below_one_in_ten_thousand_are_not_told_apart() -> None:
    assert [p_value(p) for p in (0.0, 9e-5, 0.0123, 1.0)] == ["< 0.0001", "< 0.0001", "0.012", "1.0"]
    assert percent(0.1234) == "12.3\N{NO-BREAK SPACE}%"


def test_a_number_of_which_the_data_say_nothing_has_no_interval() -> None:
    """0.00 (0.00 to 1.00) was shown of a share between 0 and 1."""
    held = Estimate(0.0, 0.0, 1.0, "-", settled=False)
    assert held.told == "0.00 (these runs do not settle it)"
    assert replace(held, high=0.4, settled=True).told == "0.00 (0.00 to 0.40)"


@pytest.mark.parametrize(
    ("before", "after", "told"), [(2.0, 1.0, "50.0 % less"), (1.0, 1.016, "1.60 % more"), (0, 1, "–")]
)
def test_what_grows_does_not_fall_by_a_negative_share(before: float, after: float, told: str) -> None:
    assert fall(before, after).replace("\N{NO-BREAK SPACE}", " ") == told
