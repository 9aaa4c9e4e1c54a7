"""Conservation laws of a fish in an ideal fluid (Kirchhoff: the whole Munk moment, no drag)."""

from __future__ import annotations

import numpy as np
import pytest
from joint_motions import still, waving
from referee import Referee

from mjfish import ode
from mjfish.drive import cpg
from mjfish.drive.cpg import DriveSegment
from mjfish.drive.motion import JointMotion
from mjfish.fish import Fish, frames
from mjfish.numerics.arrays import FloatArray

IDEAL = {f"{kind}.{group}": 0.0 for kind in ("c_d", "c_f") for group in ("head", "body", "tail")}
INERTIA = {"c_m.head": 0.8, "c_m.body": 1.2, "c_m.tail": 1.0}
START = np.array([0.4, -0.15, 1.1])


def _ideal(fish: Fish, munk: float = 1.0) -> Fish:
    """Return the fish in a fluid without friction: coefficients outside the declared bounds, so past the check."""
    changed = {name: p.rebound(low=0.0, start=0.0) for name, p in zip(fish.values, fish.parameters, strict=True)}
    values = {**dict.fromkeys(IDEAL, 0.0), **INERTIA}
    return fish.with_coefficients(changed).with_values(values).model_copy(update={"munk_moment": munk})


def _impulse(fish: Fish, motion: JointMotion, velocity: FloatArray | None = None) -> FloatArray:
    """Return P_x, P_y, H about the world's origin and the kinetic energy (2 steps, 4), by the referee's sums."""
    rollout = ode.simulate(fish, motion, velocity=velocity)
    assert rollout.status == "ok"
    referee = Referee(fish)
    rows = []
    for step in range(len(rollout.state)):
        for end, stage in ((0, 0), (1, 2)):
            moving, pose = frames.flip(rollout.state[step, end, :3]), frames.flip(rollout.state[step, end, 3:6])
            shape = referee.shape(pose, motion.angle[step, stage])
            turn = moving[2] + np.concatenate([[0.0], np.cumsum(motion.rate[step, stage])])
            nose = frames.to_world(moving[:2], pose[2])
            linear_x, linear_y, angular, _ = referee.momentum(shape, nose[None], turn[None])[0]
            about_nose = angular - (pose[0] * linear_y - pose[1] * linear_x)
            energy = 0.5 * (linear_x * nose[0] + linear_y * nose[1] + about_nose * moving[2])  # joints still
            rows.append([linear_x, linear_y, angular, energy])
    return np.array(rows)


def _jump(motion: JointMotion) -> int:
    """Return the step that begins with the only jump of the joint rates."""
    sizes = np.max(np.abs(motion.rate[1:, 0] - motion.rate[:-1, 2]), axis=1)
    (before,) = np.flatnonzero(sizes > 1.0)
    return int(before) + 1


def test_impulse_is_conserved_while_the_joints_move(pike: Fish) -> None:
    """No force from outside acts: whatever the joints do, linear and angular impulse stay. Catches every gamma slip."""
    found = _impulse(_ideal(pike), waving(2.0, 800), START)[:, :3]
    np.testing.assert_allclose(found, np.broadcast_to(found[0], found.shape), rtol=0.0, atol=1e-7)
    assert np.max(np.abs(found[0])) > 0.1


def test_impulse_is_conserved_where_the_joint_rates_jump(pike: Fish) -> None:
    drive = (DriveSegment(0.0, 18.0, (0.0,) * 4), DriveSegment(0.5, 30.0, (0.0, 1.0, 1.5, 2.0)))
    motion = cpg.joint_motion(pike.cpg, drive, 1.0, 0.001)
    jump = _jump(motion)
    found = _impulse(_ideal(pike), motion)[:, :3]
    np.testing.assert_allclose(found[2 * jump], found[2 * jump - 1], rtol=0.0, atol=1e-13)  # over the jump alone
    np.testing.assert_allclose(found, np.broadcast_to(found[0], found.shape), rtol=0.0, atol=1e-6)


def test_a_jump_conserves_impulse_with_drag_and_a_morison_slice_too(pike: Fish) -> None:
    """Forces are finite, so in no time they do nothing, whatever they are."""
    drive = (DriveSegment(0.0, 18.0, (0.0,) * 4), DriveSegment(0.5, 30.0, (0.0, 1.0, 1.5, 2.0)))
    motion = cpg.joint_motion(pike.cpg, drive, 0.6, 0.001)
    found = _impulse(pike, motion)[:, :3]
    jump = _jump(motion)
    np.testing.assert_allclose(found[2 * jump], found[2 * jump - 1], rtol=0.0, atol=1e-13)
    velocity = ode.simulate(pike, motion).state
    assert np.max(np.abs(velocity[jump, 0, :3] - velocity[jump - 1, 1, :3])) > 0.1


def test_energy_is_conserved_with_still_joints_and_the_whole_munk_moment(pike: Fish) -> None:
    """A rigid bent body in an ideal fluid tumbles for ever."""
    energy = _impulse(_ideal(pike), still(3.0, 1200), START)[:, 3]
    np.testing.assert_allclose(energy, energy[0], rtol=1e-9)


def test_the_morison_slice_does_not_conserve_angular_impulse(pike: Fish) -> None:
    """Kappa = 0 lacks u p_y: a modelling choice of the paper, seen here. Catches kappa that is not wired through."""
    found = _impulse(_ideal(pike, munk=0.0), still(3.0, 1200), START)
    assert np.ptp(found[:, 2]) > 1e-2
    assert np.ptp(found[:, 0]) == pytest.approx(0.0, abs=1e-8)  # the force row is complete


def test_drag_only_takes_energy(pike: Fish) -> None:
    fish = pike.with_values({**INERTIA}).model_copy(update={"munk_moment": 1.0})
    energy = _impulse(fish, still(2.0, 800), START)[:, 3]
    assert np.all(np.diff(energy) <= 1e-12)
    assert energy[-1] < 0.3 * energy[0]
