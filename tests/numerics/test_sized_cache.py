"""A cache limited by the memory of what it holds."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest

from mjfish.numerics.arrays import FloatArray
from mjfish.numerics.sized_cache import Budget, Recomputable, sized_cache


def test_what_was_not_used_for_longest_is_forgotten_first() -> None:
    made = []

    @sized_cache(lambda block: block.nbytes, 8 * 10)
    def block(count: int) -> FloatArray:
        made.append(count)
        return np.zeros(count)

    for count in (4, 5, 4, 3):  # twelve numbers of ten: the five were not used for longest
        block(count)
    assert block(4) is block(4)
    block(3)
    assert made == [4, 5, 3]
    block(5)
    assert made == [4, 5, 3, 5]


def test_a_result_above_the_limit_is_kept_until_the_next() -> None:
    block = sized_cache(lambda one: one.nbytes, 8.0)(lambda count: np.zeros(count))
    first = block(7)
    assert block(7) is first
    block(1)
    assert block(7) is not first


def test_values_that_can_be_made_again_share_a_budget(monkeypatch: pytest.MonkeyPatch) -> None:
    """The one not asked for longest is dropped and made again; what is out of use leaves its place to others."""
    monkeypatch.setattr(Recomputable, "budget", Budget(8 * 10))
    made: list[int] = []

    def numbers(count: int) -> FloatArray:
        made.append(count)
        return np.arange(float(count))

    four, five, three = (Recomputable(partial(numbers, count)) for count in (4, 5, 3))
    first = four()
    assert five()[4] == 4.0
    assert four() is first
    three()  # twelve numbers of ten: the five were not asked for longest
    assert five.value is None
    del three
    five()
    assert four() is first
    assert made == [4, 5, 3, 5]


def test_a_value_above_the_budget_is_held_until_the_next(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Recomputable, "budget", Budget(0.0))
    known, other = Recomputable(partial(np.zeros, 3), np.ones(3)), Recomputable(partial(np.zeros, 2))
    assert known() is known()
    other()
    assert not known().any()
