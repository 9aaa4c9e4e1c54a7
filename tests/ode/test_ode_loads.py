"""Loads: forces plugged in by address."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from joint_motions import still, waving

from mjfish import ode
from mjfish.fish import Fish
from mjfish.hydro.load import load


@load
def munk(link: Any, parameters: Any) -> tuple[float, float, float]:
    """Munk's moment as a load: -kappa u p_y."""
    return 0.0, 0.0, -parameters[0] * link.u * link.c_m * (link.added[0] * link.v + link.added[1] * link.w)


@load
def nothing(link: Any, parameters: Any) -> tuple[float, float, float]:
    return 0.0, 0.0, 0.0


@load
def push(link: Any, parameters: Any) -> tuple[float, float, float]:
    """A force at the front joint of the links longer than parameters[3]."""
    if link.length < parameters[3]:
        return 0.0, 0.0, 0.0
    return parameters[0], parameters[1], parameters[2]


INERTIA = {"c_m.head": 0.8, "c_m.body": 1.2, "c_m.tail": 1.0}


@pytest.mark.parametrize("compliance", [0.0, 0.4])
def test_munks_moment_plugged_in_is_munks_moment_built_in(pike: Fish, compliance: float) -> None:
    """A hook sees the velocity and the water of its own link, and acts on it in its own frame."""
    fish = pike.with_values(INERTIA).model_copy(update={"tail_compliance": compliance})
    motion, start = waving(1.0, 1000), np.array([0.5, 0.0, 0.0])
    built_in = ode.simulate(fish.model_copy(update={"munk_moment": 0.7}), motion, velocity=start).state
    plugged = ode.simulate(fish, motion, velocity=start, loads=[(munk, [0.7])]).state
    without = ode.simulate(fish, motion, velocity=start).state
    np.testing.assert_allclose(plugged, built_in, rtol=0.0, atol=1e-11)
    assert np.max(np.abs(without - built_in)) > 0.01


def test_a_load_without_force_is_bitwise_no_load(pike: Fish) -> None:
    motion = waving(1.0, 200)
    without = ode.simulate(pike, motion)
    for loads in ([(nothing, [])], [(munk, [0.0]), (nothing, [])]):
        found = ode.simulate(pike, motion, loads=loads)
        assert np.array_equal(found.state, without.state)
        assert np.array_equal(found.derivative, without.derivative)


def test_several_loads_add_up_each_with_its_own_parameters(pike: Fish) -> None:
    motion = waving(0.5, 100)
    once = ode.simulate(pike, motion, loads=[(push, [0.3, -0.2, 0.05, 0.0]), (munk, [0.5])])
    twice = ode.simulate(
        pike, motion, loads=[(push, [0.1, 0.1, 0.05, 0.0]), (munk, [0.5]), (push, [0.2, -0.3, 0.0, 0.0])]
    )
    np.testing.assert_allclose(twice.state, once.state, rtol=0.0, atol=1e-12)


def test_a_force_on_the_head_accelerates_the_whole_mass(pike: Fish) -> None:
    """F = m a for the stretched fish pushed along its axis, in the model's frame: +x is towards the tail."""
    fish = pike.with_values({})
    rollout = ode.simulate(fish, still(0.01, 1, (0.0,) * 4), loads=[(push, [-2.0, 0.0, 0.0, 0.2])])
    mass = sum(link.mass for link in fish.links)
    assert rollout.derivative[0, 0, 0] == pytest.approx(2.0 / mass, rel=1e-12)
    assert rollout.derivative[0, 0, 1:3] == pytest.approx([0.0, 0.0], abs=1e-14)


def test_a_load_does_no_impulse_where_the_rates_jump(pike: Fish) -> None:
    """A finite force has no impulse in no time, so the jump is the same with a load as without."""
    motion = waving(0.2, 40)
    rate = motion.rate.copy()
    rate[20:] += np.array([0.5, -0.2, 0.3, 1.0])
    kicked = type(motion)(motion.time, motion.angle, rate, motion.acceleration)

    def jump(loads: list[Any]) -> Any:
        state = ode.simulate(pike, kicked, velocity=np.zeros(3), loads=loads).state
        return state[20, 0] - state[19, 1]

    np.testing.assert_allclose(jump([(push, [50.0, 20.0, 1.0, 0.0])]), jump([]), rtol=0.0, atol=1e-12)
