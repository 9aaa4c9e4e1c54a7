"""Added mass by the amplitude of the beat, as a formula and learned."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from link_forces import LINKS, STATES, VALUES, moving, numbers
from recovery import derivative_error

from mjfish.data import Trial
from mjfish.diagnosis import curves
from mjfish.effects import Effect, find
from mjfish.effects.momentum_rate import SETTLE
from mjfish.fish import Fish
from mjfish.fish.outline import outlines
from mjfish.hydro.forced_motion import forced_motion
from mjfish.hydro.load import ANSWER, LoadBuffers, load_rows, loads_on
from mjfish.model import Model
from mjfish.model.sensitivity import sensitivities
from mjfish.numerics.arrays import FloatArray

LAW, FORMULA = find("added_mass_law"), find("added_mass_amplitude")
KNOTS = [p.short for p in LAW.parameters]
#: y, s and the lags of both momenta: at rest, and of a beating link.
MEMORIES = (np.zeros(8), np.array([0.01, 4e-4, 0.02, -0.3, 0.8, -0.001, 0.02, -0.05]))
SIZES = {"added_mass_amplitude": {"loss": 0.6, "half": 3.0}, "added_mass_law": dict.fromkeys(KNOTS, -0.4)}
TAU, RHO = 0.5, 1000.0


def _level(factor: float) -> dict[str, float]:
    return dict.fromkeys(KNOTS, float(np.log(factor)))


def _height(fish: Fish, index: int) -> float:
    """Return the height of a link in the mean square [m], from its sections alone."""
    outline = outlines(fish)[index]
    mean = np.sum(outline.strip_weight * outline.strip_height**2) / np.sum(outline.strip_weight)
    return float(np.sqrt(mean))


def _call(
    fish: Fish, effect: Effect, values: dict[str, float], at: tuple[tuple[float, float, float], FloatArray, int]
) -> tuple[FloatArray, FloatArray]:
    """Return force and rates of the hidden states of a link."""
    state, memory, index = at
    assert effect.load is not None
    states, rates = np.zeros(40), np.zeros(40)
    states[8 * index : 8 * index + 8] = memory
    table = load_rows([(effect.load, numbers(effect, values))], 5)
    found = loads_on(moving(fish, state), index, index, table, False, LoadBuffers(np.zeros(ANSWER), states, rates))
    return np.array(found), rates[8 * index : 8 * index + 8]


@pytest.mark.parametrize("effect", [FORMULA, LAW], ids=lambda effect: effect.name)
def test_the_force_is_that_of_its_equation(pike: Fish, effect: Effect) -> None:
    """The missing momentum's rate, its part in w p, and the Munk moment; hidden states follow their own equations."""
    fish = pike.model_copy(update={"munk_moment": 0.7})
    for state in STATES:
        for memory in MEMORIES:
            for index in LINKS:
                u, v, w = state
                link, added = fish.links[index], outlines(fish)[index].added
                kc = np.hypot(0.3, 2.0 * np.pi * np.sqrt(2.0 * memory[1]) / _height(fish, index))
                excess = -0.6 * kc**2 / (kc**2 + 9.0) if effect is FORMULA else np.expm1(-0.4)
                p = VALUES[f"c_m.{link.group}"] * np.array([added[0] * v + added[1] * w, added[1] * v + added[2] * w])
                first = (p - memory[[2, 5]]) / SETTLE
                rate = 3.0 * first - 3.0 * memory[[3, 6]] + memory[[4, 7]]
                expected = excess * np.array([w * p[0], -rate[0], -rate[1] - 0.7 * u * p[0]])
                found, rates = _call(fish, effect, SIZES[effect.name], (state, memory, index))
                np.testing.assert_allclose(found, expected, rtol=2e-3, atol=1e-9 * np.abs(first).max() + 1e-15)
                own = [v + 0.5 * link.length * w - memory[0] / TAU, (memory[0] ** 2 - memory[1]) / TAU]
                lags = np.stack([first, (first - memory[[3, 6]]) / SETTLE, (memory[[3, 6]] - memory[[4, 7]]) / SETTLE])
                np.testing.assert_allclose(rates, [*own, *lags.T.ravel()], rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("effect", [FORMULA, LAW], ids=lambda effect: effect.name)
def test_at_its_null_there_is_no_force_and_the_memory_goes_on(pike: Fish, effect: Effect) -> None:
    for state in STATES[1:]:
        found, rates = _call(pike, effect, {}, (state, MEMORIES[1], 3))
        assert not found.any()
        assert rates.all()


@pytest.mark.parametrize("hertz", [1.0, 2.0, 3.0, 5.0])
def test_the_force_of_a_swung_link_is_the_exact_one_but_for_the_third_power_of_the_lag(
    pike: Fish, hertz: float
) -> None:
    """A link swung as V cos w t, with one factor f at all amplitudes: F = (f - 1) c_m A_0 w V sin w t.

    The largest error is (w tau)^3 / (1 + w^2 tau^2)^(3/2) of the force, 0.5 % at 3 Hz, whatever f is.
    """
    omega, step = 2.0 * np.pi * hertz, 0.001
    time = 0.5 * step * np.arange(2 * int(3.0 / step) + 1)
    velocity = np.zeros((len(time), 3))
    velocity[:, 1] = 0.4 * np.cos(omega * time)
    assert LAW.load is not None
    records, index = moving(pike, (0.0, 0.0, 0.0)), 2
    found = forced_motion(records, index, [(LAW.load, numbers(LAW, _level(0.6)))], velocity, step)[:, 1]
    mass = -0.4 * records[index]["c_m"] * records[index]["added"][0]
    exact = mass * 0.4 * omega * np.sin(omega * time[::2])
    settled = time[::2] > 1.0
    error = np.abs(found - exact)[settled].max() / np.abs(exact).max()
    assert error == pytest.approx((omega * SETTLE) ** 3 / (1.0 + (omega * SETTLE) ** 2) ** 1.5, rel=0.02)
    assert error < 0.006 or hertz > 3.0


@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_one_level_of_all_knots_is_another_coefficient(pike: Fish, turning: Trial, factor: float) -> None:
    """Within 7 % of what the change of c_m does to a swim with a turn; at once after a start and a jump it is late.

    The lags begin at zero though the joints move already: that stays. Catches an added mass that is felt in part.
    """
    scaled = {name: factor * value if name.startswith("c_m") else value for name, value in VALUES.items()}
    model = Model(pike, (LAW,))
    values = VALUES | {f"added_mass_law.{short}": level for short, level in _level(factor).items()}
    apart = np.all([np.abs(turning.time - segment.start) > 0.03 for segment in turning.drive], axis=0)
    learned, exact, nominal = (
        found.velocity[apart]
        for found in (
            model.predict(turning, values), Model(pike).predict(turning, scaled), Model(pike).predict(turning, VALUES)
        )
    )  # fmt: skip
    off, whole = (np.sqrt(np.mean((found - exact) ** 2, axis=0)) for found in (learned, nominal))
    assert np.all(off < 0.07 * whole), off / whole


@pytest.mark.parametrize("coefficient", [0.05, 2.5])
@pytest.mark.parametrize("flexible", [0.0, 0.3])
@pytest.mark.parametrize("bound", ["low", "high"])
@pytest.mark.parametrize("effect", [FORMULA, LAW], ids=lambda effect: effect.name)
def test_it_is_integrated_stably_at_its_bounds(
    pike: Fish, turning: Trial, effect: Effect, bound: str, flexible: float, coefficient: float
) -> None:
    """Under the step of the model, with the lightest and the heaviest water, and behind a tail that gives way."""
    fish = pike.model_copy(update={"tail_compliance": flexible, "tail_damping": 0.05})
    own = {p.name: getattr(p, bound) if not p.shape else p.low for p in effect.parameters}
    heavy = {name: coefficient if name.startswith("c_m") else value for name, value in VALUES.items()} | own
    coarse, fine = (Model(fish, (effect,), step=step).predict(turning, heavy) for step in (0.005, 0.001))
    assert coarse.status == fine.status == "ok"
    apart = np.all([np.abs(turning.time - segment.start) > 0.03 for segment in turning.drive], axis=0)
    off = np.sqrt(np.mean((coarse.velocity - fine.velocity)[apart] ** 2, axis=0))
    assert np.all(off < 0.02 * np.ptp(fine.velocity, axis=0))


def test_half_of_the_loss_is_there_at_its_number(pike: Fish, turning: Trial) -> None:
    """A curve is read off a link that is swung: c_m (1 - a / 2) at KC = K, and nearly all of c_m at rest."""
    model = Model(pike, (FORMULA,))
    values = VALUES | {"added_mass_amplitude.loss": 0.5, "added_mass_amplitude.half": 4.0}
    fish = curves._Fish.of(model, values, turning)
    numbers_seen = np.array([0.4, 1.0, 4.0, 12.0])
    for index, link in enumerate(pike.links):
        found = curves._inertia(index, pike, fish, numbers_seen) / VALUES[f"c_m.{link.group}"]
        expected = 1.0 - 0.5 * numbers_seen**2 / (numbers_seen**2 + 16.0)
        np.testing.assert_allclose(found, expected, rtol=4e-3)
    assert expected[2] == 0.75


@pytest.mark.parametrize("values", [{"loss": 0.5, "half": 3.0}, {"loss": -0.7, "half": 6.0}])
def test_the_learned_form_begins_like_the_formula(pike: Fish, turning: Trial, values: dict[str, float]) -> None:
    """Within 6 % of c_m over the octaves that it has."""
    learned = LAW.like("added_mass_amplitude", values)
    at = np.geomspace(0.7, 14.0, 9)
    found, expected = (
        curves._inertia(
            2,
            pike,
            curves._Fish.of(
                Model(pike, (effect,)), VALUES | {f"{effect.name}.{k}": v for k, v in own.items()}, turning
            ),
            at,
        )
        for effect, own in ((LAW, learned), (FORMULA, values))
    )
    np.testing.assert_allclose(found, expected, rtol=0.06)
    taller = LAW.like("section_height", {"error": 0.1})
    assert list(taller.values()) == pytest.approx([2.0 * np.log(1.1)] * len(KNOTS))
    assert LAW.like("another", {}) == {}


@pytest.mark.parametrize("effect", [FORMULA, LAW], ids=lambda effect: effect.name)
def test_its_derivatives(pike: Fish, turning: Trial, effect: Effect) -> None:
    """By every parameter off the null, and by coefficients, which move what is remembered."""
    values = SIZES[effect.name] | ({"knot_2": 0.3, "knot_4": 0.1} if effect is LAW else {})
    shown = [p.short for p in effect.parameters if p.short not in ("knot_5",)]
    for short in shown:
        assert derivative_error(pike, turning, effect, values, short) < 2e-5
    model = Model(pike, (effect,))
    trial = replace(turning, time=turning.time[:60], velocity=turning.velocity[:60])
    full = VALUES | {f"{effect.name}.{short}": value for short, value in values.items()}
    names = ["c_d.body", "c_m.tail"]
    found = sensitivities(model, trial, full, names)
    for k, name in enumerate(names):
        at = lambda v, name=name: model.predict(trial, full | {name: v}).velocity  # noqa: E731
        here, h = full[name], 1e-3
        by = (8.0 * (at(here + h) - at(here - h)) - at(here + 2 * h) + at(here - 2 * h)) / (12.0 * h)
        np.testing.assert_allclose(found[1:, :, k], by[1:], rtol=0.0, atol=1e-5 * np.abs(by).max())
