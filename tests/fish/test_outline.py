"""Integrals of the outline over each link."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy import integrate

from mjfish.fish import Fish, Section, outline
from mjfish.fish.outline import INTERVALS, outlines, perimeter, section_at

#: Rows: INT m_a r^k dr (k = 0, 1, 2) at c_m = 1 [kg, kg m, kg m2], INT h dr, INT p dr [m2]; columns: links, nose first.
TABLE = {
    "m_a": (1.68505982, 0.39501129, 0.29684281, 0.21269839, 0.42322489),
    "m_a r": (0.28808204, 0.01170192, 0.00873115, 0.00619513, 0.0385619),
    "m_a r^2": (0.058171, 0.0004726, 0.0003513, 0.00024798, 0.00425135),
    "h": (0.0243389299, 0.00558, 0.004836, 0.004092, 0.00804875),
    "p": (0.0702359775, 0.0158873875, 0.0133173182, 0.0107639050, 0.0174422782),
}


def _digits(value: float) -> float:
    """Return half a unit of the last printed digit, the best that a printed number can say."""
    return 0.5 * 10.0 ** -len(f"{value!r}".partition(".")[2])


@pytest.mark.parametrize("row", TABLE)
def test_integrals_of_the_pike_are_those_of_the_table(pike: Fish, row: str) -> None:
    """To 1e-8 relative, or to the last digit printed where that is coarser."""
    found = {
        "m_a": [link.added[0] for link in outlines(pike)],
        "m_a r": [link.added[1] for link in outlines(pike)],
        "m_a r^2": [link.added[2] for link in outlines(pike)],
        "h": [link.height_moment[-1, 0] for link in outlines(pike)],
        "p": [link.wetted for link in outlines(pike)],
    }[row]
    for value, expected in zip(found, TABLE[row], strict=True):
        assert abs(value - expected) <= max(1e-8 * expected, 1.01 * _digits(expected))


def _height(fish: Fish, station: float) -> float:
    """Return the height by the formulas of the design, for the pike alone."""
    if station < 0.1746:
        return 0.096 * np.sqrt(1.0 - (1.0 - station / 0.1746) ** 2)
    return float(np.interp(station, [0.1746, 0.291, 0.477, 0.53865, 0.614], [0.096, 0.096, 0.060, 0.030, 0.110]))


def test_integrals_equal_adaptive_quadrature_to_1e8(pike: Fish) -> None:
    """Every integral, where the printed table has too few digits. Catches a wrong power of r or a piece left out."""
    start = 0.0
    for link, found in zip(pike.links, outlines(pike), strict=True):
        kinks = [x - start for x in (0.1746, 0.53865) if start < x < start + link.length]
        for k in range(4):

            def moment(r: float, power: int, k: int = k, start: float = start) -> float:
                return _height(pike, start + r) ** power * r**k

            options = {"points": kinks or None, "epsabs": 0.0, "epsrel": 1e-11, "limit": 200}
            first = integrate.quad(moment, 0.0, link.length, args=(1,), **options)[0]
            assert found.height_moment[-1, k] == pytest.approx(first, rel=1e-8)
            if k < 3:
                second = 250.0 * np.pi * integrate.quad(moment, 0.0, link.length, args=(2,), **options)[0]
                assert found.added[k] == pytest.approx(second, rel=1e-8)
        start += link.length


def test_cumulative_moments_are_exact_at_their_nodes(pike: Fish) -> None:
    for link, length in zip(outlines(pike)[1:4], (0.062, 0.062, 0.062), strict=True):
        r = length * (np.arange(INTERVALS + 1) / INTERVALS) ** 2
        slope = (link.node_height[-1] - link.node_height[0]) / length
        for k in range(4):
            closed = link.node_height[0] * r ** (k + 1) / (k + 1) + slope * r ** (k + 2) / (k + 2)
            np.testing.assert_allclose(link.height_moment[:, k], closed, rtol=1e-12, atol=1e-18)


def test_perimeter_of_circle_and_plate() -> None:
    """Exact for a circle; of a plate of height h, Ramanujan's first approximation gives pi (3 - sqrt 3) h / 2."""
    assert perimeter(np.array([0.2]), np.array([0.2]))[0] == pytest.approx(0.2 * np.pi)
    assert perimeter(np.array([0.2]), np.array([0.0]))[0] == pytest.approx(0.1 * np.pi * (3.0 - np.sqrt(3.0)))


def test_profiles_start_and_end_as_given() -> None:
    nose = Section(start=0.0, end=0.2, profile="elliptic", height=(0.0, 0.1), width=(0.02, 0.06))
    cone = Section(start=0.2, end=0.3, height=(0.08, 0.02), width=(0.05, 0.01))
    height, width = section_at((nose, cone), np.array([0.0, 0.1, 0.2, 0.2 + 1e-9, 0.25, 0.3]))
    np.testing.assert_allclose(height, [0.0, 0.1 * np.sqrt(0.75), 0.1, 0.08, 0.05, 0.02], atol=1e-8)
    np.testing.assert_allclose(width, [0.02, 0.02 + 0.04 * np.sqrt(0.75), 0.06, 0.05, 0.03, 0.01], atol=1e-8)


def test_strips_integrate_what_has_a_closed_form(pike: Fish) -> None:
    """The strips that loads use: lengths and moments of the outline, also across the kinks of the tail."""
    for link, found in zip(pike.links, outlines(pike), strict=True):
        assert np.sum(found.strip_weight) == pytest.approx(link.length, rel=1e-13)
        assert np.all((found.strip_r > 0.0) & (found.strip_r < link.length))
        tolerance = 5e-5 if link.group == "head" else 1e-12  # the blunt nose is no polynomial
        for k in range(4):
            moment = np.sum(found.strip_weight * found.strip_height * found.strip_r**k)
            assert moment == pytest.approx(found.height_moment[-1, k], rel=tolerance)
        assert np.sum(found.strip_weight * found.strip_perimeter) == pytest.approx(found.wetted, rel=5e-5)


def test_an_outline_of_many_pieces_is_as_good_as_one_of_few(pike: Fish) -> None:
    """A digitised outline may have more pieces a link than there are strips."""
    head, *rest = (pike.sections[1], *pike.sections[2:])
    ends = np.linspace(0.0, 0.291, 61)
    pieces = tuple(
        Section(start=a, end=b, height=(0.02 + 0.2 * a, 0.02 + 0.2 * b), width=(0.05, 0.05))
        for a, b in itertools.pairwise(ends)
    )
    whole = Section(start=0.0, end=0.291, height=(0.02, 0.0782), width=(0.05, 0.05))
    assert head.end == 0.291
    many = outlines(pike.model_copy(update={"sections": (*pieces, *rest)}))[0]
    one = outlines(pike.model_copy(update={"sections": (whole, *rest)}))[0]
    np.testing.assert_allclose(many.height_moment, one.height_moment, rtol=1e-10, atol=1e-18)
    np.testing.assert_allclose(many.added, one.added, rtol=1e-10)
    assert np.sum(many.strip_weight * many.strip_height) == pytest.approx(one.height_moment[-1, 0], rel=1e-6)


def test_outlines_cannot_be_written_to(pike: Fish) -> None:
    with pytest.raises(ValueError, match="read-only"):
        outline.outlines(pike)[0].added[0] = 1.0
