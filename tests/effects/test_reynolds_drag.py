"""Drag coefficients that rise at low Reynolds number, strip by strip."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from link_forces import pushed
from scipy import integrate

from mjfish.data import Trial
from mjfish.effects.reynolds_drag import REFERENCE_SPEED, ReynoldsDrag
from mjfish.fish import Fish
from mjfish.fish.outline import section_at
from mjfish.hydro.force import drag
from mjfish.hydro.link import link_records
from mjfish.model import Model
from mjfish.numerics.arrays import FloatArray


def _records(fish: Fish, u: float, v: float, w: float) -> Any:
    records = link_records(fish)
    records["u"], records["v"], records["w"] = u, v, w
    return records


def _excess(records: Any, link: int, friction: float, pressure: float) -> FloatArray:
    assert ReynoldsDrag.load is not None
    return pushed(ReynoldsDrag.load, [friction, pressure], records, link)


@pytest.mark.parametrize("link", range(5))
@pytest.mark.parametrize(("v", "w"), [(0.2, 0.0), (-0.05, 4.0), (0.3, -8.0), (0.01, -0.6)])
def test_the_strips_add_up_to_the_integral(pike: Fish, link: int, v: float, w: float) -> None:
    """-1/2 rho c_d a INT h sqrt(U_0 |q|) q r^k dr by adaptive quadrature, also where q changes sign in the link."""
    records = _records(pike, 0.0, v, w)
    start = sum(one.length for one in pike.links[:link])
    length = pike.links[link].length

    def integrand(r: float, power: int) -> float:
        height = float(section_at(pike.sections, np.array([start + r]))[0][0])
        q = v + w * r
        return height * np.sqrt(REFERENCE_SPEED * abs(q)) * q * r**power

    edges = [end.end - start for end in pike.sections if 0.0 < end.end - start < length]
    points = sorted([*edges, *([-v / w] if w and 0.0 < -v / w < length else [])])
    factor = -0.5 * 1000.0 * float(records[link]["c_d"]) * 0.8
    expected = [
        factor
        * sum(
            integrate.quad(integrand, a, b, (power,), epsabs=1e-12)[0]
            for a, b in zip([0.0, *points], [*points, length], strict=True)
        )
        for power in (0, 1)
    ]
    found = _excess(records, link, 0.0, 0.8)
    scale = abs(factor) * np.array([1.0, length]) * 0.1 * length * (abs(v) + abs(w) * length) ** 1.5 * 0.5
    assert found[0] == 0.0
    assert np.all(np.abs(found[1:] - expected) < 1e-3 * scale)
    assert np.all(np.abs(found[1:]) > 1e-3 * scale)


@pytest.mark.parametrize("link", range(5))
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_at_the_reference_speed_the_coefficients_are_1_plus_a_times_their_value(
    pike: Fish, link: int, sign: float
) -> None:
    """That is what the parameters are declared to mean."""
    along, across = _records(pike, sign * REFERENCE_SPEED, 0.0, 0.0), _records(pike, 0.0, sign * REFERENCE_SPEED, 0.0)
    np.testing.assert_allclose(_excess(along, link, 0.7, 0.7), 0.7 * np.array(drag(along[link])), rtol=1e-12)
    np.testing.assert_allclose(_excess(across, link, 0.7, 0.7), 0.7 * np.array(drag(across[link])), rtol=1e-3)


def test_the_relative_excess_goes_with_the_root_of_one_over_the_speed(pike: Fish) -> None:
    """c(Re) / c - 1 ~ Re^(-1/2): at a sixteenth of the speed four times as large, along and across."""
    for speed in (0.5, 2.0):
        fast, slow = ((_records(pike, s, 0.5 * s, 2.0 * s)) for s in (speed, speed / 16.0))
        excess = [_excess(records, 0, 1.0, 1.0) / np.array(drag(records[0])) for records in (fast, slow)]
        np.testing.assert_allclose(excess[1], 4.0 * excess[0], rtol=1e-12)


def test_it_takes_power_from_the_fish_at_any_velocity(pike: Fish) -> None:
    rng = np.random.default_rng(5)
    for u, v, w in rng.standard_normal((50, 3)) * [0.5, 0.5, 5.0]:
        records = _records(pike, u, v, w)
        for link in range(5):
            assert _excess(records, link, 1.0, 1.0) @ [u, v, w] < 0.0


@pytest.mark.parametrize("parameter", ["friction", "pressure"])
def test_more_friction_slows_the_fish_and_each_parameter_has_its_own_effect(
    pike: Fish, straight: Trial, parameter: str
) -> None:
    model = Model(pike, (ReynoldsDrag(),))
    late = straight.time > 1.5
    speeds = [
        model.predict(straight, model.values({f"reynolds_drag.{parameter}": a})).velocity[late, 0].mean()
        for a in (0.0, 0.5, 1.0)
    ]
    steps = np.diff(speeds)
    assert np.all(steps < 0.0) if parameter == "friction" else np.all(np.abs(steps) > 1e-3)
