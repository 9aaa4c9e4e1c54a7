"""The learned drag law: what its curves mean, what power it takes, and its analytic derivatives."""

from __future__ import annotations

import numpy as np
import pytest
from link_forces import LINKS, STATES, VALUES, force, moving, numbers

from mjfish.effects import Effect, find
from mjfish.fish import Fish, load_fish
from mjfish.hydro.force import drag
from mjfish.hydro.load import ANSWER, PARAMETERS, SLOPES, load_rows
from mjfish.hydro.load_derivatives import gradient_on
from mjfish.numerics.arrays import FloatArray

KINDS = ("across", "along")


@pytest.fixture(scope="module")
def law(pike: Fish) -> Effect:
    """The law of the pike."""
    made = find("drag_law").for_fish(pike)
    assert made is not None
    return made


def _knots(law: Effect, kind: str) -> list[str]:
    return [p.short for p in law.parameters if p.short.startswith(f"{kind}_")]


def _random(law: Effect, rng: np.random.Generator) -> dict[str, float]:
    """Return any curves within the bounds or from bound to bound, and any shapes."""
    share = rng.uniform(size=len(law.parameters))
    share = share if rng.uniform() < 0.5 else np.round(share)
    return {p.short: p.low + s * (p.high - p.low) for p, s in zip(law.parameters, share, strict=True)}


def _power_law(law: Effect, exponent: float) -> dict[str, float]:
    """Return knots on a line that is zero at the reference speed: c goes as V to this power."""
    below = {kind: next(k for k, short in enumerate(_knots(law, kind)) if _octave(law, short) == 0) for kind in KINDS}
    line = {
        short: exponent * np.log(2.0) * (k - below[kind])
        for kind in KINDS
        for k, short in enumerate(_knots(law, kind))
    }  # fmt: skip
    return {"whole_across": 0.0, "whole_along": 0.0, "height": 0.0, **line}


def _octave(law: Effect, short: str) -> int:
    """Return where a knot stands, as its description says: 2^k times the reference speed."""
    return int(law.declaration(short).about.partition("2^")[2].partition(" ")[0])


def test_the_reference_is_two_lengths_a_second_and_the_tallest_section(pike: Fish) -> None:
    for fish in (pike, load_fish("eth_tendon")):
        made = find("drag_law").for_fish(fish)
        assert made is not None
        speed, height = made.constants(None)  # type: ignore[arg-type]
        assert speed == pytest.approx(2.0 * sum(link.length for link in fish.links))
        tallest = max(max(section.height) for section in fish.sections)
        assert 0.98 * tallest < height <= tallest
    assert find("drag_law").for_fish(pike) is find("drag_law").for_fish(pike)


@pytest.mark.parametrize("exponent", [-0.5, 0.8])
def test_a_line_over_the_octaves_is_a_power_of_the_speed(pike: Fish, law: Effect, exponent: float) -> None:
    """The coefficient is c (V / U_0)^n between the second knot and the last but one, V the speed across or along.

    Eight strips have the head's drag to 0.12 %.
    """
    speed, values = 2.0 * sum(link.length for link in pike.links), _power_law(law, exponent)
    for local in speed * np.array([0.26, 0.5, 0.77, 1.1, 1.4, 1.9]):
        records = moving(pike, (-local, local, 0.0))
        for link in LINKS:
            nominal = np.array(drag(records[link]))
            expected = np.expm1(exponent * np.log(local / speed)) * nominal
            np.testing.assert_allclose(force(law, values, records, link)[:2], expected[:2], rtol=2e-3)


def test_beyond_the_outermost_knots_the_coefficients_are_constant(pike: Fish, law: Effect) -> None:
    """Slower and faster than any knot the drag is the nominal one times exp of the curve's end."""
    values = _power_law(law, 0.8)
    for kind, part in (("along", 0), ("across", 1)):
        knots = _knots(law, kind)
        for (short, next_to_it), factor in ((knots[:2], 0.3), (knots[:-3:-1], 3.0)):
            end = (4.0 * values[short] + 2.0 * values[next_to_it]) / 6.0  # the coefficients are mirrored there
            local = factor * 2.0 ** _octave(law, short) * 2.0 * sum(link.length for link in pike.links)
            for further in (1.0, factor):
                records = moving(pike, (-local * further, local * further, 0.0))
                found = force(law, values, records, 1)[part]
                assert found == pytest.approx(np.expm1(end) * drag(records[1])[part], rel=1e-4)


def test_drag_takes_power_whatever_the_knots(pike: Fish, law: Effect) -> None:
    """Nominal drag and excess together, at random curves, shapes and velocities; all of it at the lower bounds too.

    The nominal drag is an exact integral and the excess a sum over eight strips: what they differ by is less than the
    twentieth of the drag that the lower bounds leave.
    """
    rng, worst = np.random.default_rng(7), -np.inf
    for draw in range(300):
        values, state = _random(law, rng), rng.normal(size=3) * [0.5, 0.3, 4.0]
        if draw % 3 == 0:
            values = {p.short: p.default if p.shape else p.low for p in law.parameters}
        records = moving(pike, (state[0], state[1], state[2]))
        for link in LINKS:
            nominal = np.array(drag(records[link]))
            together = nominal + force(law, values, records, link)
            worst = max(worst, float(together @ state) / -float(nominal @ state))
    assert worst < 0.0


def test_its_derivatives_are_those_of_the_force(pike: Fish, law: Effect) -> None:
    """By every parameter and by the velocity, against central differences."""
    assert law.load is not None
    assert law.load.gradient != 0
    rng, count = np.random.default_rng(8), len(law.parameters)
    for state in STATES[1:]:
        values = {p.short: 0.5 * rng.normal() if not p.shape else rng.uniform(0.1, 0.9) for p in law.parameters}
        records, row = moving(pike, state), load_rows([(law.load, numbers(law, values))]).rows[0]
        for link in LINKS:
            found = np.full((3, SLOPES), np.nan)
            gradient_on(
                records, link, np.uint64(law.load.address), row, True, np.zeros(0), np.zeros((2, ANSWER)), found
            )
            expected = np.stack([_slope(law, values, p.short, records, link) for p in law.parameters], axis=1)
            scale = np.abs(expected).max(axis=1, keepdims=True) + 1e-12
            assert np.max(np.abs(found[:, :count] - expected) / scale) < 1e-7
            assert not found[:, count:PARAMETERS].any()
            moved = np.stack([_by_velocity(law, values, pike, state, k, link) for k in range(3)], axis=1)
            np.testing.assert_allclose(
                found[:, PARAMETERS : PARAMETERS + 3], moved, rtol=1e-6, atol=1e-6 * np.abs(moved).max()
            )


def _by_velocity(
    law: Effect, values: dict[str, float], fish: Fish, state: tuple[float, float, float], k: int, link: int
) -> FloatArray:
    """Return the derivative of the force on a link by one of its own velocities."""
    h, found = 1e-6, []
    for by in (h, -h):
        records = moving(fish, state)
        records[("u", "v", "w")[k]][link] += by
        found.append(force(law, values, records, link))
    return np.asarray(found[0] - found[1]) / (2.0 * h)


def _slope(law: Effect, values: dict[str, float], short: str, records: object, link: int) -> FloatArray:
    h = 1e-5
    right, left = (force(law, {**values, short: values[short] + by}, records, link) for by in (h, -h))
    return np.asarray(right - left) / (2.0 * h)


def test_shapes_do_nothing_to_curves_that_are_level(pike: Fish, law: Effect) -> None:
    """A level alone is another coefficient."""
    level = {p.short: 0.3 for p in law.parameters if not p.shape}
    records = moving(pike, STATES[1])
    shapes = [dict.fromkeys(("whole_across", "whole_along", "height"), b) for b in (0.0, 1.0)]
    found = [force(law, {**level, **shape}, records, 2) for shape in shapes]
    np.testing.assert_allclose(found[0], found[1], rtol=1e-13)
    np.testing.assert_allclose(found[0], np.expm1(0.3) * np.array(drag(records[2])), rtol=1e-3)
    assert VALUES["c_d.body"] > 0.0
