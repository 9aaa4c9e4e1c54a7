"""The learned lift: across the stream it takes no power, and formulas are special cases of it."""

from __future__ import annotations

import numpy as np
import pytest
from link_forces import LINKS, STATES, force, moving

from mjfish.effects import find
from mjfish.fish import Fish

LIFT = find("lift")
#: A formula and the numbers of the learned form that make it.
SPECIAL = {
    "stream_lift": ({"slope": 1.7}, {"fin_1": 1.7, "place": 0.25, "downwash": 0.75}),
    "fin_lift": ({"slope": 1.7}, {"fin_normal": 1.7, "place": 0.25, "downwash": 0.75}),
    "body_lift": ({"slope": 0.8}, {"body_normal": 0.8, "body_place": 0.5, "body_downwash": 0.5}),
}


def test_lift_across_the_stream_takes_no_power(pike: Fish) -> None:
    """Where force and velocity are of one point of the chord, which is any: at random coefficients and states."""
    rng = np.random.default_rng(3)
    for _ in range(50):
        point = rng.uniform()
        places = dict.fromkeys(("place", "downwash", "body_place", "body_downwash"), point)
        values = {**places, "fin_1": rng.normal(), "fin_2": rng.normal(), "body_1": rng.normal()}
        state = rng.normal(size=3) * [0.5, 0.3, 3.0]
        records = moving(pike, (state[0], state[1], state[2]))
        for link in LINKS:
            pushed = force(LIFT, values, records, link)
            assert abs(pushed @ state) < 1e-12 * np.abs(pushed * state).max()
            assert np.abs(pushed).max() > 0.0


def test_force_across_the_chord_takes_power(pike: Fish) -> None:
    for state in STATES[1:]:
        if state[0] == 0.0:
            continue
        values = {"fin_normal": 0.7, "place": 0.4, "downwash": 0.4}
        assert force(LIFT, values, moving(pike, state), 4) @ state < 0.0


@pytest.mark.parametrize("name", SPECIAL)
def test_formulas_are_special_cases(pike: Fish, name: str) -> None:
    own, learned = SPECIAL[name]
    for state in STATES:
        records = moving(pike, state)
        for link in LINKS:
            formula, found = force(find(name), own, records, link), force(LIFT, learned, records, link)
            np.testing.assert_allclose(found, formula, rtol=1e-9, atol=1e-12)


def test_the_second_harmonic_has_no_force_at_45_degrees_and_is_odd_about_them(pike: Fish) -> None:
    """C_L = sin 4 alpha / 4: the force across the stream at 45 - x degrees is minus that at 45 + x."""

    def across(degrees: float) -> float:
        alpha = np.radians(degrees)
        velocity = (-np.cos(alpha), np.sin(alpha), 0.0)
        pushed = force(LIFT, {"fin_2": 1.0}, moving(pike, velocity), 4)
        return float(pushed[0] * -np.sin(alpha) - pushed[1] * np.cos(alpha))

    for x in (5.0, 20.0, 40.0):
        assert across(45.0 - x) == pytest.approx(-across(45.0 + x), rel=1e-12)
    assert abs(across(45.0)) < 1e-12 * across(22.5)
