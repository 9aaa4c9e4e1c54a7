"""docs/roll.md holds what its tool writes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import cumulative_trapezoid

from studies.roll import __main__ as tool

_ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def page() -> str:
    return (_ROOT / "docs" / "roll.md").read_text(encoding="utf-8")


def test_fast_start_is_in_the_page_as_it_runs_today(page: str) -> None:
    """Catches a page that was not written anew after the force, the trim or the fish changed."""
    assert tool.fast() in page


def test_a_mode_is_in_the_page_as_it_runs_today(page: str) -> None:
    pair = tool.turn(18.0, "t2", "λ*")
    middle, amplitude = pair.swing(tool.END)
    assert f"| 18 | t2 | {pair.peak(tool.ONSET):.1f} | {middle:.1f} ± {amplitude:.1f} |" in page


def test_fast_start_is_smooth_and_goes_both_ways() -> None:
    """Catches a rate or an acceleration that is not that of the angle."""
    motion = tool.fast_start()
    angle = motion.angle[:, 0, 0]
    assert (angle.max(), angle.min()) == (pytest.approx(0.5), pytest.approx(-0.3))
    assert motion.angle[-1, 2].tolist() == [0.0] * 4
    start = motion.time[:-1]
    for what, of in (("rate", "angle"), ("acceleration", "rate")):
        summed = cumulative_trapezoid(getattr(motion, what)[:, 0, 0], start, initial=0)
        reached = getattr(motion, of)[:, 0, 0]
        np.testing.assert_allclose(summed, reached, atol=1e-3 * np.abs(reached).max())


@pytest.mark.slow
def test_the_whole_page_is_what_the_tool_writes(page: str) -> None:
    assert tool.page() == page
