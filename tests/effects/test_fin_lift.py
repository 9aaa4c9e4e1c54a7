"""Circulatory lift of the last link."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from link_forces import pushed

from mjfish.effects.fin_lift import FinLift
from mjfish.fish import Fish
from mjfish.fish.outline import outlines
from mjfish.hydro.link import link_records
from mjfish.numerics.arrays import FloatArray


def _records(fish: Fish, u: float, v: float, w: float) -> Any:
    records = link_records(fish)
    records["u"], records["v"], records["w"] = u, v, w
    return records


def _force(records: Any, link: int, slope: float = 1.0) -> FloatArray:
    assert FinLift.load is not None
    return pushed(FinLift.load, [slope], records, link)


def test_at_a_small_angle_it_is_thin_foil_theory(pike: Fish) -> None:
    """L = 2 pi alpha * rho / 2 U^2 S at the quarter chord, against the sideways motion. Catches a factor two."""
    speed, angle = 0.8, 1e-3
    fy, mz = _force(_records(pike, -speed, speed * angle, 0.0), 4, 2.0 * np.pi)[1:]
    area, chord = outlines(pike)[4].height_moment[-1, 0], pike.links[4].length
    np.testing.assert_allclose(fy, -np.pi * angle * 1000.0 * speed**2 * area, rtol=1e-13)
    np.testing.assert_allclose(mz / fy, 0.25 * chord, rtol=1e-12)


@pytest.mark.parametrize("link", range(4))
def test_only_the_last_link_has_it(pike: Fish, link: int) -> None:
    assert np.all(_force(_records(pike, -0.5, 0.3, 2.0), link) == 0.0)
    assert _force(_records(pike, -0.5, 0.3, 2.0), 4)[1] < 0.0


def test_the_downwash_is_that_at_three_quarters_of_the_chord(pike: Fish) -> None:
    """A fin that turns about that point has no lift, one that turns about another has."""
    w, chord = 3.0, pike.links[4].length
    assert abs(_force(_records(pike, -0.5, -0.75 * chord * w, w), 4)[1]) < 1e-15
    assert _force(_records(pike, -0.5, -0.5 * chord * w, w), 4)[1] < -1e-3


def test_it_turns_with_the_side_and_not_with_the_stream(pike: Fish) -> None:
    """Mirror: fy and mz change sign with v and w; a fin that backs up is held back too, and none at rest."""
    there = _force(_records(pike, -0.5, 0.2, 1.0), 4)
    assert np.array_equal(_force(_records(pike, -0.5, -0.2, -1.0), 4), -there)
    assert np.array_equal(_force(_records(pike, 0.5, 0.2, 1.0), 4), there)
    assert np.all(_force(_records(pike, 0.0, 0.2, 1.0), 4) == 0.0)
    np.testing.assert_allclose(_force(_records(pike, -1.0, 0.4, 2.0), 4), 4.0 * there, rtol=1e-12)
