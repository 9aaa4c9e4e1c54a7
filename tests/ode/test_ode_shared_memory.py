"""Hidden states that all links of a fish share."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from joint_motions import still, waving
from pike_coefficients import COEFFICIENTS

from mjfish import ode
from mjfish.fish import Fish
from mjfish.hydro.link import NUMBERS, column
from mjfish.hydro.load import PARAMETERS, load
from mjfish.numerics.arrays import FloatArray
from mjfish.ode.rollout import Conditions
from mjfish.ode.tangents import Direction, simulate_tangents

VALUES = dict(zip(COEFFICIENTS, (1.0, 0.5, 0.6, 2.0, 1.5, 2.5, 0.02, 0.01, 0.02), strict=True))
START = np.array([0.3, 0.02, -0.4])


@load(memory=2, shared=True)
def summed(link: Any, parameters: Any) -> tuple[float, ...]:
    """Push with nothing; every link adds its mass and its place, weighted by its length."""
    return 0.0, 0.0, 0.0, parameters[0] * link.mass, link.length * link.x


@load(memory=1)
def own(link: Any, parameters: Any) -> tuple[float, ...]:
    """Push with nothing; every link remembers its length."""
    return 0.0, 0.0, 0.0, link.length


@load(memory=2, shared=True)
def pendulum(link: Any, parameters: Any) -> tuple[float, ...]:
    """Lean by what all links feel and where they are, as a pendulum; push back by the lean."""
    side = link.c_d * (link.v + 0.5 * link.length * link.w) * (1.0 + 0.3 * link.x)
    swing = parameters[1] * side
    turn = 0.0
    if link.last == 1.0:
        turn = link.memory[1]
        swing -= 30.0 * link.memory[0] + 2.0 * link.memory[1]
    push = -parameters[0] * link.memory[0] * (1.0 + 0.1 * link.memory[1])
    return push * link.u, push, 0.01 * push * link.w, turn, swing


def test_rates_are_sums_over_the_links(pike: Fish) -> None:
    """Once for the fish; what a load before it or behind it remembers on each link stays apart."""
    fish, motion = pike.with_values({}), still(0.5, 100, (0.0,) * 4)
    rollout = ode.simulate(fish, motion, pose=np.array([0.7, 0.0, 0.0]), loads=[(own, []), (summed, [2.0]), (own, [])])
    assert rollout.memory is not None
    assert rollout.memory.shape == (100, 2, 5 + 2 + 5)
    time, lengths = motion.time[1:, None], np.array([link.length for link in fish.links])
    joints = 0.7 - np.concatenate([[0.0], np.cumsum(lengths)[:-1]])
    expected = [sum(2.0 * link.mass for link in fish.links), float(lengths @ joints)]
    np.testing.assert_allclose(rollout.memory[:, 1, 5:7], time * expected, rtol=1e-12)
    for each in (rollout.memory[:, 1, :5], rollout.memory[:, 1, 7:]):
        np.testing.assert_allclose(each, time * lengths, rtol=1e-12)


def test_every_link_reads_the_same(pike: Fish) -> None:
    """In no water, a clock for all links that pushes each by its mass: the fish goes t^3 / 6 ahead."""

    @load(memory=1, shared=True)
    def pushed(link: Any, parameters: Any) -> tuple[float, ...]:
        return -link.mass * link.memory[0], 0.0, 0.0, link.last

    motion = still(0.5, 100, (0.0,) * 4)
    state = ode.simulate(pike, motion, values=dict.fromkeys(COEFFICIENTS, 0.0), loads=[(pushed, [])]).state
    np.testing.assert_allclose(state[:, 1, 0], 0.5 * motion.time[1:] ** 2, rtol=1e-9)
    np.testing.assert_allclose(state[:, 1, 1:3], 0.0, atol=1e-12)


def _difference(at: Any, h: float) -> FloatArray:
    return np.asarray((8.0 * (at(h) - at(-h)) - at(2.0 * h) + at(-2.0 * h)) / (12.0 * h))


@pytest.mark.parametrize("compliance", [0.0, 0.4])
def test_derivatives_go_through_what_is_shared(pike: Fish, compliance: float) -> None:
    """By either parameter of the load, a coefficient that it reads, one that it does not, and the start velocity."""
    fish, motion, numbers = pike.model_copy(update={"tail_compliance": compliance}), waving(0.4, 160), [0.9, 40.0]
    rows = np.zeros((2, 5, NUMBERS))
    rows[0, [k for k, link in enumerate(fish.links) if link.group == "body"], column("c_d")] = 1.0
    rows[1, -1, column("c_f")] = 1.0
    by_load = np.zeros((2, 2, PARAMETERS))
    by_load[0, 1, 0] = by_load[1, 1, 1] = 1.0
    along = np.array([1.0, 0.3, -0.5])
    directions = [
        *(Direction(loads=row) for row in by_load),
        *(Direction(links=row) for row in rows),
        Direction(velocity=along),
    ]

    def at(**by: float) -> FloatArray:
        moved = {"first": 0.0, "second": 0.0, "c_d.body": 0.0, "c_f.tail": 0.0, "start": 0.0, **by}
        values = VALUES | {name: VALUES[name] + moved[name] for name in ("c_d.body", "c_f.tail")}
        loads = [(own, []), (pendulum, [numbers[0] + moved["first"], numbers[1] + moved["second"]])]
        start = START + moved["start"] * along
        return ode.simulate(fish, motion, values=values, velocity=start, loads=loads).at(motion.time)

    rollout, found = simulate_tangents(
        fish, motion, directions, motion.time,
        conditions=Conditions(VALUES, START, loads=[(own, []), (pendulum, numbers)]),
    )  # fmt: skip
    assert np.array_equal(rollout.at(motion.time), at())
    without = ode.simulate(fish, motion, values=VALUES, velocity=START).at(motion.time)
    assert np.abs(rollout.at(motion.time) - without)[:, :3].max() > 0.02
    steps = {"first": 1e-3, "second": 1e-2, "c_d.body": 1e-3, "c_f.tail": 1e-3, "start": 1e-3}
    for k, (name, h) in enumerate(steps.items()):
        exact = _difference(lambda by, name=name: at(**{name: by}), h)
        scale = np.abs(exact).max(axis=0) + 1e-3 * np.abs(exact).max()
        assert np.max(np.abs(found[:, :, k] - exact) / scale) < 1e-6, name


def test_one_that_exerts_nothing_yet_leans_all_the_same(pike: Fish) -> None:
    """At the null of its amplitude the fish swims as without it; the derivative needs what all links together did."""
    motion = waving(0.4, 160)
    direction = Direction(loads=np.eye(1, PARAMETERS))
    rollout, found = simulate_tangents(
        pike, motion, [direction], motion.time, conditions=Conditions(VALUES, START), inactive=[(pendulum, [0.0, 40.0])]
    )
    assert np.array_equal(rollout.state, ode.simulate(pike, motion, values=VALUES, velocity=START).state)

    def at(size: float) -> FloatArray:
        loads = [(pendulum, [size, 40.0])]
        return ode.simulate(pike, motion, values=VALUES, velocity=START, loads=loads).at(motion.time)

    exact = _difference(at, 1e-3)
    assert np.abs(exact[:, :3]).max() > 1e-2
    np.testing.assert_allclose(found[:, :, 0], exact, rtol=0.0, atol=1e-5 * np.abs(exact).max())
