"""Many directions in one pass against a complex rollout for each."""

from __future__ import annotations

import numpy as np
import pytest
from complex_step import TINY, rollout_along
from joint_motions import waving
from pike_coefficients import COEFFICIENTS

from mjfish import ode
from mjfish.drive.motion import JointMotion
from mjfish.fish import Fish
from mjfish.hydro.link import LINK, NUMBERS, column, numbers_of
from mjfish.numerics.arrays import FloatArray
from mjfish.ode.equation import TAIL
from mjfish.ode.rollout import Conditions
from mjfish.ode.tangents import Direction, simulate_tangents

VALUES = dict(zip(COEFFICIENTS, (1.0, 0.5, 0.6, 2.0, 1.5, 2.5, 0.02, 0.01, 0.02), strict=True))
START = np.array([0.3, 0.02, -0.4])


def _swim(pike: Fish, compliance: float = 0.0) -> tuple[Fish, JointMotion, FloatArray]:
    """Return a fish with a Munk moment, a motion whose rates jump once, and times that are no grid's."""
    springs = {"tail_compliance": compliance, "tail_hardening": 30.0, "tail_quadratic": -3.0}
    fish = pike.model_copy(update={"munk_moment": 0.7, **springs})
    motion = waving(0.6, 240)
    rate = motion.rate.copy()
    rate[100:] += np.array([0.5, -0.2, 0.3, 1.0])
    return fish, JointMotion(motion.time, motion.angle, rate, motion.acceleration), np.linspace(0.0, 0.6, 47)


def _of_links(field: str, links: int = 5) -> Direction:
    """Change a field of every link, each by another amount."""
    rows = np.zeros((links, NUMBERS))
    width = int(np.prod(LINK[field].shape))
    amount = np.linspace(1.0, 2.0, links)[:, None] * np.linspace(0.5, 1.5, width)
    rows[:, column(field) : column(field) + width] = amount
    return Direction(links=rows)


def _of_joints(motion: JointMotion, part: int, seed: int) -> Direction:
    """Change angles, rates or accelerations, with a jump of their own."""
    rates = np.zeros((3, *motion.angle.shape))
    wave = np.sin(np.arange(motion.angle[:, :, 0].size) * 0.02 + seed).reshape(motion.angle.shape[:2])
    rates[part] = wave[:, :, None] * np.array([0.3, -0.5, 1.0, 0.7])
    rates[part, 150:] += 0.2
    return Direction(motion=rates)


def _of_rates(motion: JointMotion) -> Direction:
    """Change the rates, and by more from the jump of the motion on."""
    rates = np.zeros((3, *motion.angle.shape))
    rates[1] = np.array([0.3, -0.5, 1.0, 0.7])
    rates[1, 100:] *= 1.7
    return Direction(motion=rates)


def _worst(found: FloatArray, fish: Fish, motion: JointMotion, directions: list[Direction], time: FloatArray) -> float:
    worst = 0.0
    for k, direction in enumerate(directions):
        exact = rollout_along(fish, motion, direction, VALUES, START).at(time).imag / TINY
        scale = np.abs(exact).max(axis=0)
        assert scale[:3].min() > 0.0
        worst = max(worst, float(np.max(np.abs(found[:, :, k] - exact) / np.where(scale > 0.0, scale, 1.0))))
    return worst


@pytest.mark.parametrize("compliance", [0.0, 0.4])
def test_every_number_of_a_link_joint_tail_and_start(pike: Fish, compliance: float) -> None:
    """A term missing in a product rule, a sign, a lever arm, a jump without its tangents, a direction out of order."""
    fish, motion, time = _swim(pike, compliance)
    fields = ("mass", "com", "inertia", "length", "density", "c_m", "c_d", "c_f", "munk", "wetted", "added",
              "node_height", "height_moment")  # fmt: skip
    directions = [
        *map(_of_links, fields[:6]),
        *(_of_joints(motion, part, part) for part in (0, 2)),
        _of_rates(motion),
        *map(_of_links, fields[6:]),
        *(Direction(velocity=row) for row in np.eye(3)),
    ]
    if compliance:
        directions += [Direction(tail=row) for row in np.eye(TAIL)[1:]]
    rollout, found = simulate_tangents(fish, motion, directions, time, conditions=Conditions(VALUES, START))
    plain = ode.simulate(fish, motion, values=VALUES, velocity=START)
    assert np.array_equal(rollout.state, plain.state)
    assert np.array_equal(rollout.derivative, plain.derivative)
    assert _worst(found, fish, motion, directions, time) < 1e-10


def test_coefficients_to_eleven_digits(pike: Fish) -> None:
    """Two routes that share no formula of a derivative, over a jump and many changes of sign of the drag."""
    fish, motion, time = _swim(pike)
    rows = []
    for name in COEFFICIENTS:
        kind, _, group = name.partition(".")
        row = np.zeros_like(numbers_of(fish))
        row[[link.group == group for link in fish.links], column(kind)] = 1.0
        rows.append(Direction(links=row))
    _, found = simulate_tangents(fish, motion, rows, time, conditions=Conditions(VALUES, START))
    assert _worst(found, fish, motion, rows, time) < 1e-11


def test_rates_that_jump_in_a_direction_only(pike: Fish) -> None:
    """The motion itself has no jump there: the head's velocity jumps all the same, in proportion."""
    motion = waving(0.4, 160)
    kick = np.array([0.5, -0.2, 0.3, 1.0])
    rates = np.zeros((3, *motion.angle.shape))
    rates[1, 80:] = kick
    _, found = simulate_tangents(pike, motion, [Direction(motion=rates)], motion.time, conditions=Conditions(VALUES))

    def at(size: float) -> FloatArray:
        moved = JointMotion(motion.time, motion.angle, motion.rate + size * rates[1], motion.acceleration)
        return ode.simulate(pike, moved, values=VALUES).at(motion.time)

    h = 1e-4
    np.testing.assert_allclose(found[:, :, 0], (at(h) - at(-h)) / (2.0 * h), rtol=0.0, atol=1e-6)
    assert np.abs(found[80, :3, 0] - found[79, :3, 0]).max() > 0.01


def test_the_printed_form(pike: Fish) -> None:
    fish, motion, time = _swim(pike)
    directions = [_of_links("mass"), _of_links("c_d")]
    _, found = simulate_tangents(
        fish, motion, directions, time, conditions=Conditions(VALUES, START, coriolis="printed")
    )
    for k, direction in enumerate(directions):
        exact = rollout_along(fish, motion, direction, VALUES, START, "printed").at(time).imag / TINY
        np.testing.assert_allclose(found[:, :, k], exact, rtol=1e-9, atol=1e-10 * np.abs(exact).max())


def test_after_a_divergence_there_is_nothing(pike: Fish) -> None:
    """Tangents of a rollout that blew up must not be read as numbers."""
    fish, motion, time = _swim(pike)
    wild = VALUES | {"c_d.tail": -10.0}
    rollout, found = simulate_tangents(fish, motion, [_of_links("c_d")], time, conditions=Conditions(wild, START))
    assert rollout.status == "diverged"
    assert np.isnan(found[time > rollout.time[-1]]).all()
    assert np.isfinite(found[0]).all()
