"""Forces of the water on every link along a run: drag, added mass, and loads from outside the Morison model.

In the frame of a link (x towards the tail, origin at its front joint) the added mass pushes with -(M_ad V' + gamma_ad),
[Yu2016] eqs. (8) and (13), the drag as in eqs. (9) and (10). The head's acceleration is the one that the equation of
motion gives at the state, so that together the forces move the fish exactly as the rollout says it moves.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mjfish import frames
from mjfish.arrays import FloatArray
from mjfish.compiled import compiled
from mjfish.drive.motion import JointMotion
from mjfish.errors import InputError
from mjfish.fish import Fish
from mjfish.hydro.force import added_mass, drag, gyroscopic
from mjfish.hydro.link import link_records
from mjfish.hydro.load import ANSWER, Load, load_rows, loads_on, memory_of
from mjfish.ode.equation import STATES, derivative


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
        across = self.axis[..., 0] * wrench[..., 1] - self.axis[..., 1] * wrench[..., 0]
        safe = np.where(np.abs(across) > 1e-12, across, np.inf)
        r = np.clip(wrench[..., 2] / safe, 0.0, self.length)
        return np.asarray(self.joint + r[..., None] * self.axis)


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
    hidden = memory_of(loads, len(fish.links))
    full = np.zeros((len(state), max(STATES + hidden, state.shape[1])))
    full[:, : state.shape[1]] = state
    full[:, :3], full[:, 3:6] = frames.flip(full[:, :3]), frames.flip(full[:, 3:6])
    angle, rate, acceleration = (
        np.concatenate([samples[:, 0], samples[-1:, 2]])[: len(state)]
        for samples in (motion.angle, motion.rate, motion.acceleration)
    )
    addresses, parameters = load_rows(loads, len(fish.links), STATES)
    links = link_records(fish, values)
    wrench = np.zeros((3, len(state), len(links), 3))
    flexible = fish.tail_compliance > 0.0
    tail = np.array([float(flexible), 1.0 / fish.tail_compliance if flexible else 0.0, fish.tail_damping])
    _wrenches(links, angle, rate, acceleration, full, tail, addresses, parameters, wrench)
    if flexible:
        angle[:, -1] += full[:, 6]
    heading = full[:, 5:6] + np.concatenate([np.zeros((len(state), 1)), np.cumsum(angle, axis=1)], axis=1)
    axis = -np.stack([np.cos(heading), np.sin(heading)], axis=2)  # half a turn from the model's frame
    length = np.array([link.length for link in fish.links])
    reach = np.cumsum(length[:-1, None] * axis[:, :-1], axis=1)
    joint = -full[:, None, 3:5] + np.concatenate([np.zeros((len(state), 1, 2)), reach], axis=1)
    turned = np.empty_like(wrench)
    turned[..., 0] = axis[..., 0] * wrench[..., 0] - axis[..., 1] * wrench[..., 1]
    turned[..., 1] = axis[..., 1] * wrench[..., 0] + axis[..., 0] * wrench[..., 1]
    turned[..., 2] = wrench[..., 2]
    return LinkForces(joint, axis, length, *turned)


@compiled
def _wrenches(
    links: Any,
    angle: FloatArray,
    rate: FloatArray,
    acceleration: FloatArray,
    states: FloatArray,
    tail: FloatArray,
    hooks: Any,
    hook_parameters: FloatArray,
    out: FloatArray,
) -> None:
    """Write drag, added mass and loads (3, n, links, 3) in the frames of the links; `states` in the model's frame."""
    count = links.shape[0]
    moved = np.empty(states.shape[1])
    scratch = np.zeros(ANSWER)
    for k in range(states.shape[0]):
        state = states[k]
        cos = np.cos(angle[k])
        sin = np.sin(angle[k])
        last = angle[k, count - 2]
        derivative(
            links, cos, sin, rate[k], acceleration[k], last, state, tail, False, hooks, hook_parameters, scratch, moved
        )  # leaves the velocities of the links in their records
        if tail[0] > 0.0:
            cos[count - 2] = np.cos(last + state[6])
            sin[count - 2] = np.sin(last + state[6])
        u = moved[0]
        v = moved[1]
        w = moved[2]
        for i in range(count):
            link = links[i]
            if i > 0:
                turn = link.w - links[i - 1].w
                across = v + links[i - 1].length * w
                c = cos[i - 1]
                s = sin[i - 1]
                u, v = c * u + s * across + turn * link.v, c * across - s * u - turn * link.u  # eq. (4)
                w += acceleration[k, i - 1]
                if tail[0] > 0.0 and i == count - 1:
                    w += moved[7]
            a0, a1, a2 = added_mass(link)
            gyro_x, gyro_y, gyro_z = gyroscopic(link)
            drag_x, drag_y, drag_z = drag(link)
            out[0, k, i, 0] = drag_x
            out[0, k, i, 1] = drag_y
            out[0, k, i, 2] = drag_z
            out[1, k, i, 0] = gyro_x
            out[1, k, i, 1] = gyro_y - a0 * v - a1 * w
            out[1, k, i, 2] = gyro_z - a1 * v - a2 * w
            if hooks.shape[0] > 0:
                load_x, load_y, load_z = loads_on(
                    links, i, i, hooks, hook_parameters, False, scratch, state, moved
                )  # fmt: skip
                out[2, k, i, 0] = load_x
                out[2, k, i, 1] = load_y
                out[2, k, i, 2] = load_z
