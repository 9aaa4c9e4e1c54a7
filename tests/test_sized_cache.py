"""A cache limited by the memory of what it holds."""

from __future__ import annotations

import numpy as np

from mjfish.arrays import FloatArray
from mjfish.sized_cache import sized_cache


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
