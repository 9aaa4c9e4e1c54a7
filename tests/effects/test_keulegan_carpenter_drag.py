"""Drag across by the amplitude of the beat."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from link_forces import LINKS, STATES, VALUES, moving
from link_velocities import link_velocities
from recovery import derivative_error
from scipy import integrate

from mjfish.data import Trial
from mjfish.effects.keulegan_carpenter_drag import KeuleganCarpenterDrag
from mjfish.fish import Fish
from mjfish.fish.outline import outlines
from mjfish.hydro.load import ANSWER, LoadBuffers, load_rows, loads_on
from mjfish.model import Model
from mjfish.model.sensitivity import sensitivities
from mjfish.numerics.arrays import FloatArray, readonly

POWER = "keulegan_carpenter_drag.power"
TAU, FLOOR, KC_0, RHO = 0.5, 0.3, 3.0, 1000.0
#: y and s of front joint and end: at rest, a beating link, one whose front is still.
MEMORIES = ((0.0, 0.0, 0.0, 0.0), (0.01, -0.04, 1e-4, 1.2e-3), (0.0, 0.05, 0.0, 2e-3))


def _call(
    fish: Fish, state: tuple[float, float, float], memory: tuple[float, ...], index: int, power: float
) -> tuple[FloatArray, FloatArray]:
    """Return force and rates of the hidden states of all links."""
    assert KeuleganCarpenterDrag.load is not None
    states, rates = np.zeros(20), np.zeros(20)
    states[4 * index : 4 * index + 4] = memory
    table = load_rows([(KeuleganCarpenterDrag.load, (power,))], 5)
    buffers = LoadBuffers(np.zeros(ANSWER), states, rates)
    return np.array(loads_on(moving(fish, state), index, index, table, False, buffers)), rates


@pytest.mark.parametrize("power", [1.0 / 3.0, -0.7, 1.5])
def test_the_force_is_that_of_its_equation(pike: Fish, power: float) -> None:
    """On every link, whatever it remembers; friction is left alone, and so is the memory of the other links."""
    for state in STATES:
        for memory in MEMORIES:
            for index in LINKS:
                outline, link = outlines(pike)[index], pike.links[index]
                r, h, dr = outline.coarse_r, outline.coarse_height, outline.coarse_weight
                ends = [np.sqrt(FLOOR**2 + (2.0 * np.pi / h) ** 2 * 2.0 * s) for s in memory[2:]]
                kc = ends[0] + (ends[1] - ends[0]) * r / link.length
                q = state[1] + state[2] * r
                c_d = VALUES[f"c_d.{link.group}"]
                excess = -0.5 * RHO * c_d * h * dr * np.abs(q) * q * ((kc / KC_0) ** -power - 1.0)
                found, rates = _call(pike, state, memory, index, power)
                expected = [0.0, np.sum(excess), np.sum(excess * r)]
                np.testing.assert_allclose(found, expected, rtol=1e-8, atol=1e-12)
                end = state[1] + state[2] * link.length
                y, s = np.array(memory[:2]), np.array(memory[2:])
                own = [*(np.array([state[1], end]) - y / TAU), *((y**2 - s) / TAU)]
                np.testing.assert_allclose(rates[4 * index : 4 * index + 4], own, rtol=1e-12, atol=1e-15)
                assert not np.delete(rates, np.s_[4 * index : 4 * index + 4]).any()


def test_at_its_null_there_is_no_force_and_the_memory_goes_on(pike: Fish) -> None:
    for state in STATES[1:]:
        for memory in MEMORIES:
            found, rates = _call(pike, state, memory, 3, 0.0)
            assert not found.any()
            assert rates.any()


def test_a_plate_that_beats_eight_times_less_far_has_twice_the_drag(pike: Fish) -> None:
    """8 KC^(-1/3) of plates, beyond the floor: 1 + excess at one amplitude, against that at an eighth of it."""
    state, outline = (0.0, 0.3, 0.0), outlines(pike)[4]
    drag = -0.5 * RHO * VALUES["c_d.tail"] * 0.09 * np.sum(outline.coarse_height * outline.coarse_weight)
    wide, narrow = (_call(pike, state, (0.0, 0.0, a**2 / 2, a**2 / 2), 4, 1.0 / 3.0)[0][1] + drag for a in (1.6, 0.2))
    assert narrow / wide == pytest.approx(2.0, rel=0.01)


def test_the_amplitude_is_that_of_the_last_beats(pike: Fish, straight: Trial) -> None:
    """sqrt(2 s) of steady swimming against sqrt(2) times the rms of the way of either end of each link.

    Once the start, which beats wider, is forgotten. The leak loses two percent.
    """
    model = Model(pike, (KeuleganCarpenterDrag(),))
    time = readonly(np.arange(451) / 50.0)
    long = replace(straight, time=time, velocity=readonly(np.zeros((451, 3))))
    rollout = model.predict(long, model.values(VALUES | {POWER: 0.2})).rollout
    assert rollout.memory is not None
    velocity, lengths = link_velocities(pike, rollout), np.array([link.length for link in pike.links])
    late, time = rollout.time > 7.0, rollout.time
    for k, q in enumerate((velocity[..., 1], velocity[..., 1] + velocity[..., 2] * lengths)):
        way = integrate.cumulative_trapezoid(q - q[late].mean(axis=0), time, axis=0, initial=0.0)[late]
        way -= np.polynomial.polynomial.polyval(time[late], np.polynomial.polynomial.polyfit(time[late], way, 1)).T
        seen = np.sqrt(2.0 * rollout.memory[:, 1].reshape(-1, 5, 4)[late[1:], :, 2 + k]).mean(axis=0)
        np.testing.assert_allclose(seen, np.sqrt(2.0) * way.std(axis=0), rtol=0.05)


def test_what_is_remembered_follows_its_equation(pike: Fish, turning: Trial) -> None:
    """The equations of y and s of every link, integrated by another method, up to the step of the drive."""
    model = Model(pike, (KeuleganCarpenterDrag(),))
    rollout = model.predict(turning, model.values(VALUES | {POWER: 0.4})).rollout
    assert rollout.memory is not None
    until = rollout.time < 1.49
    time, velocity = rollout.time[until], link_velocities(pike, rollout)[until]
    lengths = np.array([link.length for link in pike.links])
    ends = np.stack([velocity[..., 1], velocity[..., 1] + velocity[..., 2] * lengths], axis=2)
    growth = np.exp((time - time[-1]) / TAU)[:, None, None]
    y = integrate.cumulative_trapezoid(ends * growth, time, axis=0, initial=0.0) / growth
    s = integrate.cumulative_trapezoid(y**2 * growth, time, axis=0, initial=0.0) / growth / TAU
    found = rollout.memory[: len(time) - 1, 1].reshape(-1, 5, 4)
    np.testing.assert_allclose(found[..., :2], y[1:], rtol=0.0, atol=2e-3 * np.abs(y).max())
    np.testing.assert_allclose(found[..., 2:], s[1:], rtol=0.0, atol=5e-3 * s.max())


@pytest.mark.parametrize("power", [-1.0, 1.5])
def test_a_run_begins_from_rest_at_either_bound(pike: Fish, straight: Trial, power: float) -> None:
    """No singular start: half the step changes the run by little."""
    coarse, fine = (
        Model(pike, (KeuleganCarpenterDrag(),), step=step).predict(straight, VALUES | {POWER: power})
        for step in (0.005, 0.0025)
    )
    assert coarse.status == "ok"
    assert np.abs(coarse.velocity - fine.velocity)[:, :2].max() < 2e-3
    nominal = Model(pike).predict(straight, VALUES).velocity
    assert np.abs(coarse.velocity - nominal)[:, :2].max() > 0.02


@pytest.mark.parametrize("power", [-0.5, 0.0, 0.4])
def test_its_derivatives(pike: Fish, turning: Trial, power: float) -> None:
    """By the power, at the null and at either side, and by a coefficient, which moves what is remembered."""
    effect = KeuleganCarpenterDrag()
    assert derivative_error(pike, turning, effect, {"power": power}, "power") < 2e-5
    model = Model(pike, (effect,))
    trial = replace(turning, time=turning.time[:60], velocity=turning.velocity[:60])
    values = VALUES | {POWER: power}
    found = sensitivities(model, trial, values, ["c_d.body", "c_m.tail"])
    for k, name in enumerate(("c_d.body", "c_m.tail")):
        at = lambda v, name=name: model.predict(trial, values | {name: v}).velocity  # noqa: E731
        here, h = values[name], 1e-3
        by = (8.0 * (at(here + h) - at(here - h)) - at(here + 2 * h) + at(here - 2 * h)) / (12.0 * h)
        np.testing.assert_allclose(found[1:, :, k], by[1:], rtol=0.0, atol=1e-5 * np.abs(by).max())
