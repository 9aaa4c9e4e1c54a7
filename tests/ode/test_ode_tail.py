"""The elastic deflection of the last link about its joint."""

from __future__ import annotations

import numpy as np
import pytest
from joint_motions import still, waving
from referee import Referee

from mjfish import ode
from mjfish.drive import cpg, modes
from mjfish.fish import Fish, frames
from mjfish.numerics.arrays import FloatArray
from mjfish.ode.rollout import Rollout

START = np.array([0.5, -0.2, 0.6])


def _flexible(fish: Fish, compliance: float, damping: float, hardening: float = 0.0, quadratic: float = 0.0) -> Fish:
    springs = {"tail_hardening": hardening, "tail_quadratic": quadratic}
    return fish.model_copy(update={"tail_compliance": compliance, "tail_damping": damping, **springs})


def _energy(fish: Fish, rollout: Rollout) -> FloatArray:
    """Return kinetic energy of body and water plus that of the spring, at the start of every step, joints still."""
    referee = Referee(fish)
    found = []
    for state, angle in zip(rollout.state[:, 0], rollout.motion.angle[:, 0], strict=True):
        moving, pose = frames.flip(state[:3]), frames.flip(state[3:6])
        shape = referee.shape(pose, angle + np.array([0.0, 0.0, 0.0, state[6]]))
        nose = frames.to_world(moving[:2], pose[2])
        turn = np.full(5, moving[2]) + np.array([0.0, 0.0, 0.0, 0.0, state[7]])
        p_x, p_y, angular, last = referee.momentum(shape, nose[None], turn[None])[0]
        about_nose = angular - (pose[0] * p_y - pose[1] * p_x)
        kinetic = 0.5 * (p_x * nose[0] + p_y * nose[1] + about_nose * moving[2] + last * state[7])
        spring = 0.5 * state[6] ** 2 + 0.25 * fish.tail_hardening * state[6] ** 4
        spring += fish.tail_quadratic * abs(state[6]) ** 3 / 3.0
        found.append(kinetic + spring / fish.tail_compliance)
    return np.array(found)


def _frictionless(fish: Fish) -> Fish:
    free = {p.name: p.rebound(low=0.0) for p in fish.parameters}
    still_water = {f"{kind}.{group}": 0.0 for kind in ("c_d", "c_f") for group in ("head", "body", "tail")}
    inertia = {"c_m.head": 0.8, "c_m.body": 1.2, "c_m.tail": 1.0}
    fish = fish.with_coefficients(free).with_values({**still_water, **inertia})
    return fish.model_copy(update={"munk_moment": 1.0})


def test_a_stiff_tail_approaches_the_rigid_one_in_proportion_to_its_compliance(pike: Fish) -> None:
    """First order in the compliance, like the deflection of a spring. Catches a spring of the wrong stiffness."""
    motion = waving(2.0, 8000)
    rigid = ode.simulate(pike, motion).state[4000:, 0, :3]
    compliances = 0.02 / 2.0 ** np.arange(4)
    errors = [
        np.sqrt(np.mean((ode.simulate(_flexible(pike, c, 0.05), motion).state[4000:, 0, :3] - rigid) ** 2))
        for c in compliances
    ]
    assert errors[0] > 1e-4
    assert np.log2(np.array(errors[:-1]) / np.array(errors[1:])) == pytest.approx(1.0, abs=0.15)


def test_the_deflection_is_quasi_statically_the_compliance_times_the_moment(pike: Fish) -> None:
    """A tail that is dragged sideways at constant speed is bent against its motion, by moment times compliance."""
    fish = _flexible(pike, 0.05, 0.05)
    heavy = fish.model_copy(
        update={"links": (fish.links[0].model_copy(update={"mass": 1e4, "inertia": 1e4}), *fish.links[1:])}
    )
    rollout = ode.simulate(heavy, still(1.0, 4000, (0.0,) * 4), velocity=np.array([0.0, 0.3, 0.0]))
    v = -rollout.state[-1, 1, 1]
    station = np.linspace(0.0, 0.137, 20001)
    height = np.where(station < 0.06165, 0.06 - 0.03 * station / 0.06165, 0.03 + 0.08 * (station - 0.06165) / 0.07535)
    deflection = rollout.state[-1, 1, 6]
    # Bent by delta the tail meets the water at v cos(delta); the moment keeps its sign along it.
    moment = -0.5 * 1000.0 * 2.5 * np.trapezoid(height * station, station) * (v * np.cos(deflection)) ** 2 * np.sign(v)
    assert deflection == pytest.approx(0.05 * moment, rel=1e-2)
    assert abs(deflection) > 1e-3


@pytest.mark.parametrize(("hardening", "quadratic"), [(0.0, 0.0), (200.0, 0.0), (0.0, 20.0), (40.0, -10.0)])
def test_energy_of_an_undamped_tail_in_an_ideal_fluid_is_conserved(
    pike: Fish, hardening: float, quadratic: float
) -> None:
    """M = delta (1 + b |delta| + h delta^2) / k has the energy delta^2 (1 / 2 + b |delta| / 3 + h delta^2 / 4) / k."""
    fish = _flexible(_frictionless(pike), 0.5, 0.0, hardening, quadratic)
    rollout = ode.simulate(fish, still(2.0, 4000), velocity=START)
    assert np.ptp(rollout.state[:, 0, 6]) > 0.01
    largest = np.max(np.abs(rollout.state[:, 0, 6]))
    assert np.ptp(rollout.state[:, 0, 6]) > 1.1 * largest  # it bends to both sides
    assert hardening * largest**2 > 0.1 or hardening == 0.0
    assert abs(quadratic) * largest > 0.1 or quadratic == 0.0
    energy = _energy(fish, rollout)
    np.testing.assert_allclose(energy, energy[0], rtol=1e-8)


def test_damping_of_the_tail_takes_its_power_from_the_energy(pike: Fish) -> None:
    """dE/dt = -c delta'^2, at every instant; so energy never grows. Catches a damping of the wrong sign or joint."""
    fish = _flexible(_frictionless(pike), 0.5, 0.05)
    rollout = ode.simulate(fish, still(2.0, 4000), velocity=START)
    energy = _energy(fish, rollout)
    assert np.all(np.diff(energy) <= 1e-12)
    power = 0.05 * rollout.state[:, 0, 7] ** 2
    lost = np.concatenate([[0.0], np.cumsum(0.5 * (power[1:] + power[:-1])) * 0.0005])
    np.testing.assert_allclose(energy[0] - energy, lost, atol=1e-6 * energy[0])
    assert lost[-1] > 1e-3 * energy[0]


def test_null_compliance_is_bitwise_the_rigid_tail_whatever_the_damping(pike: Fish) -> None:
    motion = cpg.joint_motion(pike.cpg, modes.drive("v1-t2"), 6.0, 0.005)
    rigid = ode.simulate(pike, motion)
    null = ode.simulate(_flexible(pike, 0.0, 3.0), motion)
    assert np.array_equal(rigid.state, null.state)
    assert np.array_equal(rigid.derivative, null.derivative)
    assert not np.any(rigid.state[..., 6:])


def test_a_flexible_tail_swims_differently(pike: Fish) -> None:
    motion = waving(2.0, 4000)
    difference = ode.simulate(_flexible(pike, 1.0, 0.02), motion).state - ode.simulate(pike, motion).state
    assert np.max(np.abs(difference[..., 2])) > 0.05
