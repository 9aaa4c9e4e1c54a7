"""Velocities of the links, and forces of the water on them, along a run: drag, added mass, loads from outside Morison.

In the frame of a link (x towards the tail, origin at its front joint) the added mass pushes with -(M_ad V' + gamma_ad),
[Yu2016] eqs. (8) and (13), the drag as in eqs. (9) and (10). The head's acceleration is the one that the equation of
motion gives at the state, so that together the forces move the fish exactly as the rollout says it moves.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mjfish.drive.motion import JointMotion
from mjfish.errors import InputError
from mjfish.fish import Fish, frames
from mjfish.hydro.force import added_mass, drag, gyroscopic
from mjfish.hydro.load import ANSWER, Load, LoadBuffers, load_rows, loads_on, memory_of
from mjfish.numerics.arrays import FloatArray
from mjfish.numerics.compiled import compiled
from mjfish.ode.equation import STATES, Joints, System, derivative, next_link
from mjfish.ode.rollout import Rollout, system_of


@dataclass(frozen=True, eq=False)
class LinkForces:
    """Wrenches of the water on the links at n instants, in the world of the forward frame.

    Attributes:
        joint: (n, links, 2) front joints of the links; the head's is the nose [m].
        axis: (n, links, 2) unit vectors along the links, towards the tail.
        length: (links,) of the links [m].
        drag, added_mass, load: (n, links, 3) force x, y [N] and moment about the front joint [N m].
    """

    joint: FloatArray
    axis: FloatArray
    length: FloatArray
    drag: FloatArray
    added_mass: FloatArray
    load: FloatArray

    def point(self, wrench: FloatArray) -> FloatArray:
        """Return where the line of action of `wrench` (n, links, 3) meets its link (n, links, 2) [m].

        Where it passes beside the link, the nearer end of the link.
        """
        lateral = self.axis[..., 0] * wrench[..., 1] - self.axis[..., 1] * wrench[..., 0]
        r = wrench[..., 2] / np.where(np.abs(lateral) > 1e-12, lateral, np.inf)
        return np.asarray(self.joint + np.clip(r, 0.0, self.length)[..., None] * self.axis)


def link_forces(
    fish: Fish,
    motion: JointMotion,
    state: FloatArray,
    *,
    values: Mapping[str, float] | None = None,
    loads: Sequence[tuple[Load, Sequence[float]]] = (),
) -> LinkForces:
    """Return the forces on every link at the boundaries of the steps of `motion`.

    Args:
        fish: the fish.
        motion: joint motion that drove the run.
        state: (n, 3), (n, 6) or (n, 8) in the forward frame (see `mjfish.ode.Rollout`) at the first n boundaries of
            the steps, after the jump where there is one, then `Rollout.memory`; what is absent (pose, tail deflection,
            memory) counts as zero.
        values: coefficients by name that replace the fish's.
        loads: extra forces on every link, with their parameters.

    Raises:
        InputError: the state has more samples than the motion has boundaries.
    """
    if len(state) > len(motion.time):
        raise InputError(f"the state has {len(state)} samples, the motion {len(motion.time)} boundaries of steps")
    full = np.zeros((len(state), max(STATES + memory_of(loads, len(fish.links)), state.shape[1])))
    full[:, : state.shape[1]] = state
    full[:, :3], full[:, 3:6] = frames.flip(full[:, :3]), frames.flip(full[:, 3:6])
    angle, rate, acceleration = (
        np.concatenate([samples[:, 0], samples[-1:, 2]])[: len(state)]
        for samples in (motion.angle, motion.rate, motion.acceleration)
    )
    system = system_of(fish, values, "corrected", load_rows(loads, len(fish.links), STATES))
    wrench = np.zeros((3, len(state), len(fish.links), 3))
    joints = Joints(np.cos(angle), np.sin(angle), rate, acceleration, angle[:, -1].copy())
    _wrenches(system, joints, full, wrench)
    if fish.tail_compliance > 0.0:
        angle[:, -1] += full[:, 6]
    heading = full[:, 5:6] + np.concatenate([np.zeros((len(state), 1)), np.cumsum(angle, axis=1)], axis=1)
    axis = -np.stack([np.cos(heading), np.sin(heading)], axis=2)  # half a turn from the model's frame
    length = np.array([link.length for link in fish.links])
    reach = np.cumsum(length[:-1, None] * axis[:, :-1], axis=1)
    joint = -full[:, None, 3:5] + np.concatenate([np.zeros((len(state), 1, 2)), reach], axis=1)
    fx, fy, moment = np.moveaxis(wrench, 3, 0)
    cos, sin = np.moveaxis(axis, 2, 0)
    return LinkForces(joint, axis, length, *np.stack([cos * fx - sin * fy, sin * fx + cos * fy, moment], axis=3))


@compiled
def _wrenches(system: System, joints: Joints, states: FloatArray, out: FloatArray) -> None:
    """Write drag, added mass and loads (3, n, links, 3) in the frames of the links; `states` in the model's frame."""
    links, loads = system.links, system.loads
    count = links.shape[0]
    flexible = system.tail[0] > 0.0
    rates = np.empty(states.shape[1])
    output = np.zeros(ANSWER)
    for k in range(states.shape[0]):
        state = states[k]
        at = Joints(joints.cos[k], joints.sin[k], joints.rate[k], joints.acceleration[k], joints.angle_last[k])
        derivative(system, at, state, output, rates)  # leaves the velocities of the links in their records
        u, v, w = rates[0], rates[1], rates[2]
        for i in range(count):
            link = links[i]
            if i > 0:
                c, s = at.cos[i - 1], at.sin[i - 1]
                if flexible and i == count - 1:
                    c, s = np.cos(at.angle_last + state[6]), np.sin(at.angle_last + state[6])
                turn = link.w - links[i - 1].w
                u, v = next_link(c, s, links[i - 1].length, u, v, w)
                u, v = u + turn * link.v, v - turn * link.u  # eq. (4)
                w += at.acceleration[i - 1]
                if flexible and i == count - 1:
                    w += rates[7]
            a0, a1, a2 = added_mass(link)
            gyro_x, gyro_y, gyro_z = gyroscopic(link)
            out[0, k, i, 0], out[0, k, i, 1], out[0, k, i, 2] = drag(link)
            out[1, k, i, 0], out[1, k, i, 1] = gyro_x, gyro_y - a0 * v - a1 * w
            out[1, k, i, 2] = gyro_z - a1 * v - a2 * w
            if loads.addresses.shape[0] > 0:
                buffers = LoadBuffers(output, state, rates)
                out[2, k, i, 0], out[2, k, i, 1], out[2, k, i, 2] = loads_on(links, i, i, loads, False, buffers)


def link_velocities(fish: Fish, rollout: Rollout) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return u, v, w (n, links) of the links' front joints in their frames (x towards the tail), at starts of steps."""
    state = rollout.state[:, 0]
    angle, rate = rollout.motion.angle[: len(state), 0].copy(), rollout.motion.rate[: len(state), 0].copy()
    if fish.tail_compliance > 0.0:
        angle[:, -1] += state[:, 6]
        rate[:, -1] += state[:, 7]
    u, v, w = frames.flip(state[:, :3]).T
    found = [(u, v, w)]
    for link, own, turn in zip(fish.links[:-1], angle.T, rate.T, strict=True):
        c, s = np.cos(own), np.sin(own)
        sway = v + link.length * w
        u, v, w = c * u + s * sway, c * sway - s * u, w + turn
        found.append((u, v, w))
    u, v, w = np.moveaxis(np.array(found), 0, 2)
    return u, v, w
