"""Forces of the water's causes against the equations of their docstrings, written down once more."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from link_forces import LINKS, STATES, VALUES, force, moving
from scipy.interpolate import BSpline

from mjfish.effects import Effect, catalogue, of_fish
from mjfish.fish import Fish
from mjfish.fish.outline import outlines, section_at
from mjfish.hydro.link import link_records
from mjfish.hydro.load import ANSWER, LoadBuffers, load_rows, loads_on
from mjfish.numerics.arrays import FloatArray

RHO, NU, REFERENCE = 1000.0, 1e-6, 0.3
Three = tuple[float, float, float]


@dataclass(frozen=True)
class _Link:
    """A link in motion: strips at r of height h and width dr, coefficients and sizes."""

    u: float
    v: float
    w: float
    r: FloatArray
    h: FloatArray
    dr: FloatArray
    length: float
    last: bool
    c_m: float
    c_d: float
    c_f: float
    wetted: float
    edge: float
    area: float
    momentum: float

    @property
    def q(self) -> FloatArray:
        """Speed across of every strip."""
        return self.v + self.w * self.r

    def at(self, share: float) -> float:
        """Return the speed across of a point of the chord."""
        return self.v + share * self.length * self.w

    def drag(self, along: float, across: FloatArray | float) -> Three:
        """Return drag whose coefficients are these times the link's."""
        friction = -0.5 * RHO * self.c_f * self.wetted * along * abs(self.u) * self.u
        pressure = -0.5 * RHO * self.c_d * across * self.h * np.abs(self.q) * self.q * self.dr
        return friction, float(np.sum(pressure)), float(np.sum(pressure * self.r))


def _link(fish: Fish, index: int, state: Three, fine: int = 0) -> _Link:
    """Return a link with the strips of the loads, or with `fine` ones of its own."""
    outline, link = outlines(fish)[index], fish.links[index]
    start = sum(one.length for one in fish.links[:index])
    r, dr, h = outline.coarse_r, outline.coarse_weight, outline.coarse_height
    if fine:
        r = link.length * (np.arange(fine) + 0.5) / fine
        dr, h = np.full(fine, link.length / fine), section_at(fish.sections, start + r)[0]
    own = {kind: VALUES[f"{kind}.{link.group}"] for kind in ("c_m", "c_d", "c_f")}
    u, v, w = state
    return _Link(
        u, v, w, r, h, dr, link.length, index == len(fish.links) - 1, own["c_m"], own["c_d"], own["c_f"],
        outline.wetted, float(section_at(fish.sections, np.array([start + link.length]))[0][0]),
        float(outline.height_moment[-1, 0]), own["c_m"] * float(outline.added[0] * v + outline.added[1] * w),
    )  # fmt: skip


def _power(on: _Link, friction: float, pressure: float) -> Three:
    along = (max(abs(on.u), 1e-4) / REFERENCE) ** friction - 1.0
    return on.drag(along, (np.maximum(np.abs(on.q), 1e-4) / REFERENCE) ** pressure - 1.0)


def _whole(on: _Link, friction: float, pressure: float) -> Three:
    middle = on.at(0.5)
    along = -0.5 * RHO * friction * on.c_f * on.wetted * (np.hypot(on.u, middle) - abs(on.u)) * on.u
    across = -0.5 * RHO * pressure * on.c_d * on.h * on.dr * (np.hypot(on.u, on.q) - np.abs(on.q)) * on.q
    return float(along), float(np.sum(across)), float(np.sum(across * on.r))


def _exponential(on: _Link, friction: float, pressure: float, reynolds: float) -> Three:
    rise = np.exp(-np.hypot(on.u, on.q) * on.h / NU / (1e3 * reynolds))
    return on.drag(friction * float(np.sum(rise * on.dr)) / on.length, pressure * rise)


def _foil(on: _Link, lift: Callable[[float], float], normal: float, place: float, velocity: float) -> Three:
    """Return lift of the coefficient C_L(alpha) across the stream and (b / 2) sin 2 alpha across the chord."""
    q = on.at(velocity)
    speed, alpha = np.hypot(on.u, q), np.arctan2(q, abs(on.u))
    pressure = 0.5 * RHO * on.area * speed**2
    ahead = -1.0 if on.u > 0.0 else 1.0
    fx = -ahead * pressure * lift(alpha) * np.sin(alpha)  # (fx, fy) stands across the stream (u, q), against q
    fy = -pressure * (lift(alpha) * np.cos(alpha) + 0.5 * normal * np.sin(2.0 * alpha))
    return float(fx), float(fy), float(place * on.length * fy)


def _stream_lift(on: _Link, slope: float) -> Three:
    return _foil(on, lambda alpha: 0.5 * slope * np.sin(2.0 * alpha), 0.0, 0.25, 0.75) if on.last else (0.0, 0.0, 0.0)


def _body_lift(on: _Link, slope: float) -> Three:
    fy = -0.5 * RHO * on.area * slope * abs(on.u) * on.at(0.5)
    return (0.0, 0.0, 0.0) if on.last else (0.0, fy, 0.5 * on.length * fy)


def _lift(
    on: _Link, fin_1: float, fin_2: float, fin_3: float, fin_normal: float, place: float, downwash: float,
    body_1: float, body_normal: float, body_place: float, body_downwash: float,
) -> Three:  # fmt: skip
    if not on.last:
        return _foil(on, lambda alpha: 0.5 * body_1 * np.sin(2.0 * alpha), body_normal, body_place, body_downwash)

    def harmonics(alpha: FloatArray) -> FloatArray:
        return np.asarray(sum(a / (2.0 * k) * np.sin(2.0 * k * alpha) for k, a in enumerate((fin_1, fin_2, fin_3), 1)))

    return _foil(on, harmonics, fin_normal, place, downwash)


def _axial(on: _Link, share: float) -> Three:
    return share * on.w * on.momentum, 0.0, 0.0


def _edge(on: _Link, share: float) -> Three:
    if not on.last:
        return 0.0, 0.0, 0.0
    mass, q = on.c_m * RHO * np.pi * on.edge**2 / 4.0, on.at(1.0)
    fy = share * mass * q * min(on.u, 0.0)
    return -0.5 * share * mass * q**2, fy, on.length * fy


def _reactive(on: _Link, munk_body: float, munk_tail: float, axial: float, edge: float) -> Three:
    munk = -(munk_tail if on.last else munk_body) * on.u * on.momentum
    fx, fy, mz = np.add(_axial(on, axial), _edge(on, edge))
    return fx, fy, mz + munk


def _curve(coefficients: FloatArray) -> Callable[[FloatArray | float], FloatArray]:
    count = len(coefficients)
    mirrored = np.concatenate([coefficients[1:2], coefficients, coefficients[-2:-1]])
    spline = BSpline(np.arange(-3.0, count + 3.0), mirrored, 3)
    return lambda t: np.asarray(spline(np.clip(t, 0.0, count - 1.0)))


def _drag_law(on: _Link, whole_d: float, whole_f: float, height: float, *knots: float) -> Three:
    """Reference speed two lengths of the pike a second, height that of its fin; seven knots of c_d, six of c_f."""
    across, along = _curve(np.array(knots[:7])), _curve(np.array(knots[7:]))
    reference, tallest = 2.0 * 0.614, 0.109576
    with np.errstate(divide="ignore"):
        t_d = np.log2(np.sqrt(on.q**2 + whole_d * on.u**2) / reference * (on.h / tallest) ** height) + 3.0
        t_f = np.log2(np.sqrt(on.u**2 + whole_f * on.at(0.5) ** 2) / reference) + 3.0
    return on.drag(float(np.expm1(along(t_f))), np.expm1(across(t_d)))


_KNOTS = np.random.default_rng(11).normal(scale=0.5, size=13)
#: Equation and parameters in declared order.
CASES: dict[str, tuple[Callable[..., Three], tuple[float, ...]]] = {
    "power_drag": (_power, (-0.4, 0.7)),
    "whole_speed_drag": (_whole, (0.8, 1.3)),
    "exponential_drag": (_exponential, (4.0, 2.5, 12.0)),
    "stream_lift": (_stream_lift, (2.3,)),
    "body_lift": (_body_lift, (1.4,)),
    "axial_momentum": (_axial, (0.7,)),
    "edge_momentum": (_edge, (0.9,)),
    "lift": (_lift, (1.1, -0.7, 0.5, 0.4, 0.3, 0.6, 0.9, 0.5, 0.4, 0.8)),
    "reactive_force": (_reactive, (0.6, -0.4, 0.5, 0.8)),
    "drag_law": (_drag_law, (0.4, 0.7, 0.6, *_KNOTS)),
}
over_cases = pytest.mark.parametrize("name", CASES)


@pytest.fixture(scope="module")
def known(pike: Fish) -> dict[str, Effect]:
    """All causes as the pike has them."""
    return of_fish(catalogue(), pike)


def test_every_formula_of_the_new_mechanisms_is_here(known: dict[str, Effect]) -> None:
    """A force that joins a mechanism with a learned form joins this test, or has a file of its own."""
    elsewhere = {
        "linear_drag", "reynolds_drag", "keulegan_carpenter_drag", "fin_lift", "munk_moment", "section_height",
        "added_mass_amplitude", "added_mass_law", "added_mass_memory", "wake_memory", "wake_kernel", "roll", "roll_law",
        "roll_loss",
    }  # fmt: skip
    learned = {effect.mechanism for effect in known.values() if effect.learned and effect.load is not None}
    assert {name for name, effect in known.items() if effect.mechanism in learned} - elsewhere == set(CASES)


@over_cases
def test_the_force_is_that_of_its_equation(pike: Fish, known: dict[str, Effect], name: str) -> None:
    """On every link, at a handful of states, to rounding; drag_law adds 1 nm/s before it takes a logarithm."""
    equation, numbers = CASES[name]
    tolerance = 1e-6 if name == "drag_law" else 1e-9
    values = dict(zip((p.short for p in known[name].parameters), numbers, strict=True))
    largest = 0.0
    for state in STATES:
        records = moving(pike, state)
        for index in LINKS:
            expected = equation(_link(pike, index, state), *numbers)
            found = force(known[name], values, records, index)
            scale = np.abs(expected).max()
            largest = max(largest, scale)
            np.testing.assert_allclose(found, expected, rtol=tolerance, atol=1e-10 * scale + 1e-15)
    assert largest > 1e-3


@over_cases
def test_at_its_null_there_is_no_force(pike: Fish, known: dict[str, Effect], name: str) -> None:
    """Whatever the shapes are, to the last bit. The engines do not even call it there; derivatives do."""
    _, numbers = CASES[name]
    effect = known[name]
    values = {p.short: n if p.shape else p.default for p, n in zip(effect.parameters, numbers, strict=True)}
    for state in STATES:
        records = moving(pike, state)
        assert not any(force(effect, values, records, index).any() for index in LINKS)


@pytest.mark.parametrize("name", ["power_drag", "whole_speed_drag", "exponential_drag", "drag_law"])
def test_few_strips_are_enough(pike: Fish, name: str) -> None:
    """Eight Gauss strips a link against 4000: within 2 % of the drag that the link has with these coefficients."""
    equation, numbers = CASES[name]
    for state in STATES[1:]:
        for index in LINKS:
            few, many = (np.array(equation(_link(pike, index, state, fine), *numbers)) for fine in (0, 4000))
            fine = _link(pike, index, state, 4000)
            whole = 0.5 * RHO * fine.c_d * np.sum(fine.h * fine.q**2 * fine.dr) + 0.5 * RHO * fine.c_f * fine.wetted
            assert np.abs(few - many)[:2].max() < 0.02 * whole
            assert abs(few - many)[2] < 0.02 * whole * fine.length


def test_added_mass_that_remembers(pike: Fish, known: dict[str, Effect]) -> None:
    """F = -psi p_lag', tau p_lag' = p - p_lag, of the momentum across a link and of its moment; none along it."""
    load = known["added_mass_memory"].load
    assert load is not None
    records, (psi, tau), lag = link_records(pike, VALUES), (0.7, 0.2), np.array([0.02, -0.001])
    records[2]["u"], records[2]["v"], records[2]["w"] = -0.3, 0.2, -5.0
    added, c_m = outlines(pike)[2].added, VALUES["c_m.body"]
    momentum = c_m * np.array([added[0] * 0.2 + added[1] * -5.0, added[1] * 0.2 + added[2] * -5.0])
    for share in (psi, 0.0):
        state, rates = np.zeros(10), np.zeros(10)
        state[4:6] = lag
        table = load_rows([(load, (share, tau))], 5)
        pushed = loads_on(records, 2, 2, table, False, LoadBuffers(np.zeros(ANSWER), state, rates))
        np.testing.assert_allclose(rates[4:6], (momentum - lag) / tau, rtol=1e-12)
        np.testing.assert_allclose(pushed, [0.0, *(-share * (momentum - lag) / tau)], rtol=1e-12, atol=1e-15)
        assert not np.delete(rates, [4, 5]).any()
