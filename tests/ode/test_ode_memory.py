"""Loads that know where their link is and what was before."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from joint_motions import still, waving
from pike_coefficients import COEFFICIENTS

from mjfish import ode
from mjfish.drive.motion import JointMotion
from mjfish.errors import ParameterError
from mjfish.fish import Fish
from mjfish.hydro.link import NUMBERS, column, numbers_of
from mjfish.hydro.load import PARAMETERS, load
from mjfish.numerics.arrays import FloatArray
from mjfish.ode.forces import link_forces
from mjfish.ode.rollout import Conditions
from mjfish.ode.tangents import Direction, simulate_tangents

VALUES = dict(zip(COEFFICIENTS, (1.0, 0.5, 0.6, 2.0, 1.5, 2.5, 0.02, 0.01, 0.02), strict=True))
POSE = np.array([1.2, -0.7, 2.5])


@load(memory=3)
def where(link: Any, parameters: Any) -> tuple[float, ...]:
    """Push with nothing, and remember the path."""
    return 0.0, 0.0, 0.0, link.x, link.y, link.heading


@load(memory=1)
def rising(link: Any, parameters: Any) -> tuple[float, ...]:
    """Rise to one, whatever happens."""
    return 0.0, 0.0, 0.0, (1.0 - link.memory[0]) / parameters[0]


@load
def nothing(link: Any, parameters: Any) -> tuple[float, float, float]:
    return 0.0, 0.0, 0.0


@load(memory=2)
def everything(link: Any, parameters: Any) -> tuple[float, ...]:
    """Depend on all there is: velocity, place, two memories that mix, a coefficient, two parameters."""
    pull = parameters[0] * (link.x - 1.0) * np.cos(link.heading) + link.memory[0] * link.v
    turn = 0.1 * np.sin(link.y) * link.memory[1]
    first = (parameters[0] * link.c_d * link.u * link.u + link.x - link.memory[0]) / parameters[1]
    return pull, link.memory[1] * link.u, turn, first, link.memory[0] * link.w - 3.0 * link.memory[1]


def test_a_memory_follows_its_rate(pike: Fish) -> None:
    """1 - exp(-t / tau) on every link, to the order of the integrator; behind another load's, not on top of it."""
    fish, motion = pike.with_values({}), still(0.6, 120, (0.0,) * 4)
    memory = ode.simulate(fish, motion, loads=[(where, []), (nothing, []), (rising, [0.2])]).memory
    assert memory is not None
    assert memory.shape == (120, 2, 5 * 3 + 5)
    np.testing.assert_allclose(
        memory[:, 1, 15:], 1.0 - np.exp(-motion.time[1:, None] / 0.2) @ np.ones((1, 5)), atol=1e-8
    )


@pytest.mark.parametrize("compliance", [0.0, 0.4])
def test_a_load_knows_the_place_of_its_link(pike: Fish, compliance: float) -> None:
    """Joint and heading of every link, of the forward frame, from a measured start, on a bending fish."""
    fish = pike.model_copy(update={"tail_compliance": compliance})
    motion = waving(0.4, 400)
    rollout = ode.simulate(
        fish, motion, values=VALUES, velocity=np.array([0.4, 0.0, 0.3]), pose=POSE, loads=[(where, [])]
    )
    assert rollout.memory is not None
    assert np.allclose(rollout.state[0, 0, 3:6], POSE, rtol=0.0, atol=1e-15)
    state = np.concatenate([rollout.state[:, 0], rollout.state[-1:, 1]])
    forces = link_forces(fish, motion, state, values=VALUES)
    path = np.concatenate([forces.joint, np.arctan2(-forces.axis[..., 1:], -forces.axis[..., :1])], axis=2)
    path[..., 2] = np.unwrap(path[..., 2], axis=0)
    middle = np.diff(motion.time)[:, None, None] * 0.5 * (path[1:] + path[:-1])
    found = rollout.memory[-1, 1].reshape(5, 3)
    turns = np.round((found - middle.sum(axis=0))[:, 2] / (2.0 * np.pi * 0.4)) * 2.0 * np.pi * 0.4
    np.testing.assert_allclose(found - turns[:, None] * np.array([0.0, 0.0, 1.0]), middle.sum(axis=0), atol=1e-5)


def test_the_water_is_the_same_everywhere(pike: Fish) -> None:
    """Where nothing reads the place, a start elsewhere turns and moves the path and nothing else."""
    motion = waving(0.5, 100)
    here, there = (ode.simulate(pike, motion, values=VALUES, pose=pose).state for pose in (None, POSE))
    np.testing.assert_allclose(there[..., :3], here[..., :3], rtol=0.0, atol=1e-12)
    turned = ode.simulate(pike, motion, values=VALUES, pose=np.array([np.nan, np.nan, 2.5])).state
    np.testing.assert_array_equal(turned[0, 0, 3:6], [0.0, 0.0, 2.5])


def _directions(motion: JointMotion) -> list[tuple[str, Direction]]:
    """Return a direction of each kind."""
    rows = np.zeros((3, 5, NUMBERS))
    rows[0, [1, 4], column("c_d")] = 1.0
    rows[1, [0, 2], column("length")] = 1.0
    rows[2, :, column("mass")] = np.linspace(0.2, 0.5, 5)
    moves = np.zeros((3, *motion.angle.shape))
    moves[:2] = 0.3
    moves[1, 60:, :, 2] += 0.5
    loads = np.zeros((2, 2, PARAMETERS))
    loads[0, 1, 0] = loads[1, 1, 1] = 1.0
    return [
        ("motion", Direction(motion=moves)),
        *(("links", Direction(links=row)) for row in rows),
        ("velocity", Direction(velocity=np.array([1.0, 0.3, -0.5]))),
        *(("loads", Direction(loads=row)) for row in loads),
    ]


@pytest.mark.parametrize("compliance", [0.0, 0.4])
def test_derivatives_go_through_place_and_memory(
    pike: Fish, compliance: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Every kind of direction, against differences of whole rollouts."""
    fish = pike.model_copy(update={"tail_compliance": compliance})
    motion, start, numbers = waving(0.4, 160), np.array([0.3, 0.02, -0.4]), [0.7, 0.15]
    directions = _directions(motion)
    _, found = simulate_tangents(
        fish, motion, [direction for _, direction in directions], motion.time,
        conditions=Conditions(VALUES, start, POSE, loads=[(nothing, []), (everything, numbers)]),
    )  # fmt: skip

    def moved(kind: str, direction: Direction, size: float) -> FloatArray:
        given, driven, begin = list(numbers), motion, start
        if kind == "loads" and direction.loads is not None:
            given = [number + size * rate for number, rate in zip(numbers, direction.loads[1], strict=False)]
        if kind == "motion" and direction.motion is not None:
            sides = (motion.angle, motion.rate, motion.acceleration)
            driven = JointMotion(motion.time, *(a + size * b for a, b in zip(sides, direction.motion, strict=True)))
        if kind == "velocity" and direction.velocity is not None:
            begin = start + size * direction.velocity
        with monkeypatch.context() as patch:
            if kind == "links" and direction.links is not None:
                rows = numbers_of(fish, VALUES) + size * direction.links
                records = rows.reshape(-1).view(np.dtype(_record()))
                patch.setattr("mjfish.ode.rollout.link_records", lambda *_: records)
            return ode.simulate(
                fish, driven, values=VALUES, velocity=begin, pose=POSE, loads=[(nothing, []), (everything, given)]
            ).at(motion.time)

    h = 1e-4
    for k, (kind, one) in enumerate(directions):
        weights = ((1, 2.0 / 3.0), (2, -1.0 / 12.0))
        exact = sum(w * (moved(kind, one, n * h) - moved(kind, one, -n * h)) for n, w in weights) / h
        scale = np.abs(exact).max(axis=0) + 1e-3 * np.abs(exact).max()
        assert np.max(np.abs(found[:, :, k] - exact) / scale) < 2e-7, (kind, k)


def _record() -> Any:
    from mjfish.hydro.link import LINK

    return LINK


def test_an_inactive_load_has_hidden_states(pike: Fish) -> None:
    """At the null value of its amplitude a load exerts nothing; its derivative needs what it would have remembered."""

    @load(memory=1)
    def late(link: Any, parameters: Any) -> tuple[float, ...]:
        missing = link.v - link.memory[0]
        return 0.0, -parameters[0] * missing, 0.0, missing / 0.1

    motion = waving(0.4, 160)
    direction = Direction(loads=np.eye(1, PARAMETERS))
    rollout, found = simulate_tangents(
        pike, motion, [direction], motion.time, conditions=Conditions(VALUES), inactive=[(late, [0.0])]
    )
    assert np.array_equal(rollout.state, ode.simulate(pike, motion, values=VALUES).state)
    h = 1e-3
    right, left = (ode.simulate(pike, motion, values=VALUES, loads=[(late, [s])]).at(motion.time) for s in (h, -h))
    np.testing.assert_allclose(found[:, :, 0], (right - left) / (2.0 * h), rtol=0.0, atol=1e-5)
    assert np.abs(found[-1, :3, 0]).max() > 1e-3


def test_what_cannot_be_is_refused() -> None:
    with pytest.raises(ParameterError, match="memory = 9"):
        load(memory=9)(nothing)
