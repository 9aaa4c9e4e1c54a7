"""Derivatives of loads by differences, against a gradient that was derived by hand."""

from __future__ import annotations

import numpy as np
from link_forces import LINKS, STATES, moving

from mjfish.effects.sheared_current import ShearedCurrent
from mjfish.fish import Fish
from mjfish.hydro.load import ANSWER, AT_GRADIENT, AT_WANTED, PARAMETERS, SLOPES, load_rows
from mjfish.hydro.load_derivatives import gradient_on
from mjfish.numerics.arrays import FloatArray

#: Current, held, shears [1/s] and the place of the start [m] of a sheared current, which has a hidden state.
NUMBERS = (0.12, -0.07, 0.4, 0.25, -0.14, 0.6, -0.4)
AMPLITUDES = (0, 1, 3, 4)


def _gradient(fish: Fish, index: int, numbers: tuple[float, ...], *, exact: bool, active: bool = True) -> FloatArray:
    load = ShearedCurrent.load
    assert load is not None
    row = load_rows([(load, numbers)], 5).rows[0]
    row[AT_WANTED] += sum(1 << column for column in AMPLITUDES)
    if not exact:
        row[AT_GRADIENT] = 0.0
    before, records, found = row.copy(), moving(fish, STATES[2]), np.zeros((ANSWER, SLOPES))
    records["x"], records["y"], records["heading"] = 0.3, -0.8, 1.1
    was = records.copy()
    gradient_on(records, index, np.uint64(load.address), row, active, np.array([1.3]), np.zeros((2, ANSWER)), found)
    assert np.array_equal(row, before)
    assert all(np.array_equal(records[name], was[name]) for name in ("u", "v", "w", "x", "y", "heading"))
    return found[:4]


def test_differences_are_the_gradient(pike: Fish) -> None:
    """By parameters, velocity, place and the hidden state, on every link; what was moved is put back."""
    for index in LINKS:
        exact, found = (_gradient(pike, index, NUMBERS, exact=way) for way in (True, False))
        np.testing.assert_allclose(found, exact, rtol=1e-6, atol=1e-7 * np.abs(exact).max())
        assert np.count_nonzero(found[:3, list(AMPLITUDES)]) > 8


def test_an_inactive_load_is_derived_by_its_parameters_alone(pike: Fish) -> None:
    null = (0.0, 0.0, 0.4, 0.0, 0.0, 0.6, -0.4)
    for index in LINKS:
        exact, found = (_gradient(pike, index, null, exact=way, active=False) for way in (True, False))
        wanted = exact[:3, list(AMPLITUDES)]
        np.testing.assert_allclose(found[:3, list(AMPLITUDES)], wanted, rtol=1e-6, atol=1e-6 * np.abs(wanted).max())
        assert not found[:, PARAMETERS:].any()
