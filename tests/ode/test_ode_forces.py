"""The forces on the links, summed, are what moves the fish: Newton's law in the world, written out a second time."""

from __future__ import annotations

import numpy as np
import pytest
from joint_motions import LAGS, waving

from mjfish import ode
from mjfish.drive import cpg, modes
from mjfish.drive.motion import JointMotion
from mjfish.effects import find
from mjfish.errors import InputError
from mjfish.fish import Fish
from mjfish.numerics.arrays import FloatArray
from mjfish.ode.forces import LinkForces, link_forces
from mjfish.ode.rollout import Rollout

START = np.array([0.4, -0.15, 1.1])


def _boundaries(samples: FloatArray) -> FloatArray:
    """Return samples (n, 3, ...) or (n, 2, ...) at the n + 1 boundaries, after jumps."""
    return np.concatenate([samples[:, 0], samples[-1:, -1]])


def _needed(fish: Fish, motion: JointMotion, rollout: Rollout) -> tuple[FloatArray, FloatArray]:
    """Return the rate of linear momentum (n, 2) and of angular momentum about the world's origin (n,) of the body.

    From kinematics of the centres of mass in the world: c'' = nose'' + sums of alpha'' n - alpha'^2 t along the chain.
    """
    state, rate = _boundaries(rollout.state), _boundaries(rollout.derivative)
    yaw = state[:, 5]
    bend = [_boundaries(array) for array in (motion.angle, motion.rate, motion.acceleration)]
    for array, column in zip(bend[:2], (state[:, 6], rate[:, 6]), strict=True):
        array[:, -1] += column
    bend[2][:, -1] += rate[:, 7]
    chain = [np.concatenate([head[:, None], head[:, None] + np.cumsum(array, axis=1)], axis=1)
             for head, array in zip((yaw, state[:, 2], rate[:, 2]), bend, strict=True)]  # fmt: skip
    alpha, turn, spin = chain
    axis = -np.stack([np.cos(alpha), np.sin(alpha)], axis=2)  # towards the tail
    normal = np.stack([-axis[..., 1], axis[..., 0]], axis=2)
    bent = spin[..., None] * normal - turn[..., None] ** 2 * axis
    c, s = np.cos(yaw), np.sin(yaw)
    du = rate[:, 0] - state[:, 2] * state[:, 1]
    dv = rate[:, 1] + state[:, 2] * state[:, 0]
    nose = np.stack([c * du - s * dv, s * du + c * dv], axis=1)
    length = np.array([link.length for link in fish.links])[:, None]
    com = np.array([link.com for link in fish.links])[:, None]
    mass = np.array([link.mass for link in fish.links])
    zero = np.zeros((len(state), 1, 2))
    place = state[:, None, 3:5] + np.concatenate([zero, np.cumsum((length * axis)[:, :-1], axis=1)], axis=1)
    force = nose[:, None] + np.concatenate([zero, np.cumsum((length * bent)[:, :-1], axis=1)], axis=1) + com * bent
    force = mass[:, None] * force
    inertia = np.array([link.inertia for link in fish.links])
    return force.sum(axis=1), (_cross(place + com * axis, force) + inertia * spin).sum(axis=1)


def _cross(arm: FloatArray, force: FloatArray) -> FloatArray:
    return np.asarray(arm[..., 0] * force[..., 1] - arm[..., 1] * force[..., 0])


def _close(fish: Fish, motion: JointMotion, rollout: Rollout, forces: LinkForces) -> None:
    total = forces.drag + forces.added_mass + forces.load
    moment = (_cross(forces.joint, total[..., :2]) + total[..., 2]).sum(axis=1)
    force_needed, moment_needed = _needed(fish, motion, rollout)
    np.testing.assert_allclose(total[..., :2].sum(axis=1), force_needed, rtol=0.0, atol=1e-8)
    np.testing.assert_allclose(moment, moment_needed, rtol=0.0, atol=1e-8)
    assert np.max(np.abs(force_needed)) > 0.5


@pytest.mark.parametrize("kappa", [0.0, 1.0])
def test_forces_on_the_links_close_newtons_law(pike: Fish, kappa: float) -> None:
    """Catches a force of one link that is turned, signed or placed wrong, and an acceleration term left out."""
    fish = pike.model_copy(update={"munk_moment": kappa})
    motion = waving(1.0, 200, bias=np.array([0.1, 0.2, 0.3, 0.1]))
    rollout = ode.simulate(fish, motion, velocity=START)
    _close(fish, motion, rollout, link_forces(fish, motion, _boundaries(rollout.state)))


def test_they_close_it_with_a_flexible_tail(pike: Fish) -> None:
    fish = pike.model_copy(update={"tail_compliance": 0.05, "tail_damping": 0.02})
    motion = waving(1.0, 400)
    rollout = ode.simulate(fish, motion)
    assert np.ptp(rollout.state[:, 0, 6]) > 0.01
    _close(fish, motion, rollout, link_forces(fish, motion, _boundaries(rollout.state)))


def test_they_close_it_with_loads_that_an_effect_adds(pike: Fish) -> None:
    load = find("reynolds_drag").load
    assert load is not None
    motion = waving(1.0, 200)
    loads = [(load, [0.5, 0.8])]
    rollout = ode.simulate(pike, motion, loads=loads)
    forces = link_forces(pike, motion, _boundaries(rollout.state), loads=loads)
    assert np.max(np.abs(forces.load)) > 0.01
    _close(pike, motion, rollout, forces)


def test_they_close_it_over_a_step_of_the_drive_with_other_coefficients(pike: Fish) -> None:
    assert pike.cpg is not None
    values = {"c_d.tail": 1.3, "c_m.body": 0.6}
    motion = cpg.joint_motion(pike.cpg, modes.drive("v1-t2"), 6.0, 0.005)
    rollout = ode.simulate(pike, motion, values=values)
    _close(pike, motion, rollout, link_forces(pike, motion, _boundaries(rollout.state), values=values))


def test_drag_opposes_the_motion_of_every_link_that_slips_sideways(pike: Fish) -> None:
    """A stretched fish pushed to port feels the drag to starboard, on all links, where their outline is densest."""
    time = np.linspace(0.0, 0.01, 3)
    held = np.zeros((2, 3, len(LAGS)))
    forces = link_forces(pike, JointMotion(time, held, held, held), np.array([[0.0, 0.3, 0.0]]))
    assert np.all(forces.drag[0, :, 1] < -1e-3)
    np.testing.assert_allclose(forces.drag[0, :, 0], 0.0, atol=1e-12)
    point = forces.point(forces.drag)[0]
    assert np.all(point[:, 0] < forces.joint[0, :, 0])  # behind each joint, and in front of the next
    assert np.all(point[:-1, 0] > forces.joint[0, 1:, 0])


def test_the_point_of_application_gives_the_moment_of_the_force(pike: Fish) -> None:
    motion = waving(1.0, 100)
    forces = link_forces(pike, motion, _boundaries(ode.simulate(pike, motion).state))
    arm = forces.point(forces.drag) - forces.joint
    inside = np.linalg.norm(arm, axis=2)
    held = (inside > 1e-9) & (inside < forces.length - 1e-9)
    assert np.mean(held) > 0.5
    np.testing.assert_allclose(_cross(arm, forces.drag[..., :2])[held], forces.drag[..., 2][held], atol=1e-12)


def test_more_states_than_the_motion_has_are_refused(pike: Fish) -> None:
    with pytest.raises(InputError, match="12 samples, the motion 11"):
        link_forces(pike, waving(0.1, 10), np.zeros((12, 8)))
