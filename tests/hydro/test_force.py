"""Drag, gyroscopic force and added mass of single links."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import integrate

from mjfish.errors import UnknownNameError
from mjfish.fish import Fish, load_fish
from mjfish.fish.outline import section_at
from mjfish.hydro.force import added_mass, drag, gyroscopic, partial_moments
from mjfish.hydro.link import link_records
from mjfish.numerics.arrays import FloatArray, RecordArray

PIKE = load_fish("pike")
STARTS = np.concatenate([[0.0], np.cumsum([link.length for link in PIKE.links])])
EDGES = np.array([0.1746, 0.53865])

links = st.integers(0, 4)
speeds = st.floats(-2.0, 2.0)
rates = st.floats(-20.0, 20.0)
quick = settings(deadline=None, derandomize=True, max_examples=60, database=None)


def _link(index: int, u: float = 0.0, v: float = 0.0, w: float = 0.0, **fields: float) -> Any:
    record = link_records(PIKE)[index]
    for name, value in {"u": u, "v": v, "w": w, **fields}.items():
        record[name] = value
    return record


def _drag(index: int, u: float, v: float, w: float) -> FloatArray:
    return np.array(drag(_link(index, u, v, w)))


def _strip_sum(index: int, v: float, w: float) -> tuple[float, float]:
    """Return drag across and its moment by Gauss points between all kinks and the root of v + w r."""
    length, start = PIKE.links[index].length, STARTS[index]
    cuts = {0.0, length, *(edge - start for edge in EDGES if 0.0 < edge - start < length)}
    if w != 0.0 and 0.0 < -v / w < length:
        cuts.add(-v / w)
    points, weights = np.polynomial.legendre.leggauss(60)
    t, share = 0.5 * (points + 1.0), 0.5 * weights
    force = moment = 0.0
    ends = sorted(cuts)
    for a, b in itertools.pairwise(ends):
        r = a + (b - a) * t * t  # takes the square root out of the blunt nose
        height = section_at(PIKE.sections, start + r)[0]
        q = v + w * r
        slices = -0.5 * 1000.0 * PIKE.values[f"c_d.{PIKE.links[index].group}"] * height * np.abs(q) * q
        slices *= share * 2.0 * t * (b - a)
        force += float(np.sum(slices))
        moment += float(np.sum(slices * r))
    return force, moment


@pytest.mark.parametrize("index", range(5))
def test_drag_equals_fine_quadrature_wherever_the_sign_changes(index: int) -> None:
    """The root is swept over the link, from nose or joint to tip: closed form against strips split at the root.

    Catches a sign that belongs to the wrong side, a moment of the wrong power, an interpolation that is too coarse.
    """
    length = PIKE.links[index].length
    for w in (-3.0, 5.0):
        size = 0.5 * 1000.0 * PIKE.values["c_d.head"] * 0.1 * length * (w * length) ** 2
        for root in length * np.array([-0.5, 0.0, 1e-6, 1e-3, 0.01, 0.1, 0.33, 0.45, 0.5, 0.77, 0.95, 0.999, 1.0, 1.4]):
            found = _drag(index, 0.0, -w * root, w)[1:]
            expected = _strip_sum(index, -w * root, w)
            np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-7 * size * np.array([1.0, length]).max())


def _stepped() -> Fish:
    """Return a fish whose outline steps at its second joint and within its tail."""
    lengths = (0.2, 0.1, 0.15)
    edges, heights = (0.0, 0.3, 0.38, 0.45), (0.10, 0.05, 0.12)
    names = ("head", "body", "tail")
    chain = zip(names, lengths, strict=True)
    links = tuple(PIKE.links[0].model_copy(update={"name": n, "group": n, "length": x}) for n, x in chain)
    sections = tuple(
        PIKE.sections[1].model_copy(update={"start": a, "end": b, "height": (h, h)})
        for (a, b), h in zip(itertools.pairwise(edges), heights, strict=True)
    )
    return PIKE.model_copy(update={"links": links, "sections": sections, "cpg": None})


def _partial(link: RecordArray, end: float) -> tuple[float, float, float, float]:
    return partial_moments(end, link["length"], link["node_height"], link["height_moment"])


@pytest.mark.parametrize(
    ("index", "heights", "tolerance"),
    [(1, ((0.0, 0.10, 0.10),), 1e-9), (2, ((0.0, 0.08, 0.05), (0.08, 0.15, 0.12)), 2e-3)],
)
def test_moments_of_an_outline_with_steps(index: int, heights: tuple[Any, ...], tolerance: float) -> None:
    """A step at a joint is exact; a step within a link is seen smeared over one cell of the table of moments."""
    record = link_records(_stepped())[index]
    ends = record["length"] * np.linspace(0.01, 1.0, 300)
    for end in ends:
        expected = [
            sum(h * (max(min(b, end), a) ** (k + 1) - a ** (k + 1)) / (k + 1) for a, b, h in heights) for k in range(4)
        ]
        np.testing.assert_allclose(_partial(record, end), expected, atol=tolerance * record["height_moment"][-1, 0])


def test_strip_sum_itself_is_right() -> None:
    """The yardstick above against adaptive quadrature of the raw integrand, in the tail, with the root in the fin."""

    def slice_force(r: float) -> float:
        height = float(section_at(PIKE.sections, np.array([0.477 + r]))[0][0])
        return -0.5 * 1000.0 * 2.5 * height * abs(0.3 - 3.0 * r) * (0.3 - 3.0 * r)

    expected = integrate.quad(slice_force, 0.0, 0.137, points=[0.06165, 0.1], epsrel=1e-11)[0]
    assert _strip_sum(4, 0.3, -3.0)[0] == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("index", range(5))
def test_cumulative_moments_between_nodes(index: int) -> None:
    """Hermite interpolation, to 1e-6 of the whole link's moment, also in the cell where the outline has a kink."""
    link, length, start = _link(index), PIKE.links[index].length, STARTS[index]
    points, weights = np.polynomial.legendre.leggauss(60)
    t, share = 0.5 * (points + 1.0), 0.5 * weights
    for end in length * np.random.default_rng(3).random(40):
        cuts = [0.0, *(edge - start for edge in EDGES if 0.0 < edge - start < end), end]
        expected = np.zeros(4)
        for a, b in itertools.pairwise(cuts):
            r = a + (b - a) * t * t
            height = section_at(PIKE.sections, start + r)[0]
            expected += (height * share * 2.0 * t * (b - a)) @ r[:, None] ** np.arange(4)
        np.testing.assert_allclose(_partial(link, end), expected, atol=1e-6 * link["height_moment"][-1].max())


def test_drag_of_pure_translation_is_the_textbook_formula() -> None:
    """rho/2 c A |v| v, at the centre of the area; rho/2 c_f S |u| u along."""
    for index, link in enumerate(PIKE.links):
        record = _link(index)
        area, first = record["height_moment"][-1, :2]
        across = -0.5 * 1000.0 * PIKE.values[f"c_d.{link.group}"] * 0.4 * -0.4
        along = -0.5 * 1000.0 * 0.02 * record["wetted"] * 0.7 * -0.7
        assert _drag(index, -0.7, -0.4, 0.0) == pytest.approx([along, across * area, across * first], rel=1e-12)


@quick
@given(links, speeds, speeds, rates)
def test_drag_is_odd_in_velocity(index: int, u: float, v: float, w: float) -> None:
    np.testing.assert_allclose(_drag(index, -u, -v, -w), -_drag(index, u, v, w), rtol=1e-12, atol=1e-15)


@quick
@given(links, speeds, speeds, rates)
def test_drag_takes_power_and_never_gives_it(index: int, u: float, v: float, w: float) -> None:
    power = _drag(index, u, v, w) @ [u, v, w]
    assert power <= 1e-12
    if max(abs(u), abs(v), abs(w) * PIKE.links[index].length) > 1e-2:
        assert power < 0.0


@quick
@given(links, speeds, speeds, rates, st.floats(0.1, 3.0))
def test_drag_is_quadratic_in_speed(index: int, u: float, v: float, w: float, factor: float) -> None:
    scaled = _drag(index, factor * u, factor * v, factor * w)
    np.testing.assert_allclose(scaled, factor**2 * _drag(index, u, v, w), rtol=1e-9, atol=1e-12)


@quick
@given(links, rates.filter(lambda w: abs(w) > 0.1), st.sampled_from([0.0, 1.0]), st.sampled_from([-1.0, 1.0]))
def test_drag_is_continuous_where_the_root_enters_a_link(index: int, w: float, end: float, side: float) -> None:
    """At the joint and at the tip, from both sides: a jump here would be felt by every integrator."""
    v = -w * end * PIKE.links[index].length
    here, near = _drag(index, 0.0, v, w), _drag(index, 0.0, v * (1.0 + side * 1e-9) + side * 1e-9, w)
    np.testing.assert_allclose(near, here, atol=1e-6 * (1.0 + w * w))


@quick
@given(links, speeds, st.floats(0.02, 0.98))
def test_drag_is_continuous_where_rotation_sets_in(index: int, v: float, share: float) -> None:
    """From w = 0 to the smallest w with a root inside: the force there is small, the sign must not matter."""
    length = PIKE.links[index].length
    np.testing.assert_allclose(_drag(index, 0.0, v, 1e-9), _drag(index, 0.0, v, 0.0), atol=1e-6)
    slow = 1e-6
    assert np.max(np.abs(_drag(index, 0.0, -slow * share * length, slow))) < 1e-9


@quick
@given(links, speeds, speeds, rates, st.floats(0.0, 3.0))
def test_added_mass_is_positive_semidefinite(index: int, u: float, v: float, w: float, c_m: float) -> None:
    """Kinetic energy of the water is a square, INT m_a (v + w r)^2 dr / 2."""
    a0, a1, a2 = added_mass(_link(index, u, v, w, c_m=c_m))
    assert a0 >= 0.0
    assert a0 * a2 - a1 * a1 >= -1e-15
    assert a0 * v * v + 2.0 * a1 * v * w + a2 * w * w >= -1e-12
    assert (a0, a1, a2) == pytest.approx(c_m * _link(index)["added"], rel=1e-14)


@quick
@given(links, speeds, speeds, rates)
def test_the_force_row_of_gamma_turns_the_added_momentum(index: int, u: float, v: float, w: float) -> None:
    """Angular velocity times p = (0, p_y): along the link only, and with the whole Munk moment it does no work."""
    record = _link(index, u, v, w, c_m=0.8)
    momentum = 0.8 * (record["added"][0] * v + record["added"][1] * w)
    assert gyroscopic(record) == pytest.approx((w * momentum, 0.0, 0.0), rel=1e-12, abs=1e-15)
    fx, fy, mz = gyroscopic(_link(index, u, v, w, c_m=0.8, munk=1.0))
    assert mz == pytest.approx(-u * momentum, rel=1e-12, abs=1e-15)
    assert fx * u + fy * v + mz * w == pytest.approx(0.0, abs=1e-12)


def test_records_carry_the_coefficients_of_their_group(pike: Fish) -> None:
    records = link_records(pike, {"c_d.body": 7.0, "c_f.tail": 0.5})
    assert records["c_d"].tolist() == [4.0, 7.0, 7.0, 7.0, 2.5]
    assert records["c_f"].tolist() == [0.02, 0.02, 0.02, 0.02, 0.5]
    assert link_records(pike)["c_d"].tolist() == [4.0, 1.5, 1.5, 1.5, 2.5]  # the template is not touched


@pytest.mark.parametrize("name", ["c_d.hed", "c_x.head", "munk_moment.kappa"])
def test_records_refuse_what_is_no_coefficient(pike: Fish, name: str) -> None:
    with pytest.raises(UnknownNameError, match=name):
        link_records(pike, {name: 1.0})
