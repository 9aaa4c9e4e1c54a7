"""Kirchhoff's water without drag: energy and impulse of body and water stay, but for the integrator's own error."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from mjfish.mujoco.coupling_choice import Coupling
from mjfish.numerics.arrays import FloatArray
from proofs import parts
from proofs.dense_equation import dried
from proofs.derivation import motion_of
from proofs.parts import Part
from proofs.slices import energy, impulse, strips

#: What must stay; the impulse about the world's zero point.
KEPT = ("energy", "impulse", "angular impulse")
STEPS = (4e-3, 2e-3, 1e-3, 5e-4, 2.5e-4)
_DURATION = 0.8
_SAMPLES = 20
CURRENT = (0.4, -0.3, 0.2)


@dataclass(frozen=True, eq=False)
class Drifts:
    """Drift of what must stay.

    Attributes:
        steps: (s,) [s].
        relative: (s, 3) largest change within a run, of `KEPT`, as a part of the largest of its parts.
        orders: (3,) slope of log drift against log step.
    """

    steps: FloatArray
    relative: FloatArray

    @property
    def orders(self) -> FloatArray:
        """Fitted over all steps."""
        return np.polyfit(np.log(self.steps), np.log(self.relative), 1)[0]


def invariants(
    dry: mujoco.MjModel, data: mujoco.MjData, parts_: Sequence[Part]
) -> tuple[float, FloatArray, FloatArray]:
    """Return energy [J], impulse [N s] and angular impulse [N m s] of bodies and water, in the drifting frame.

    Bodies by their masses, water by slices: nothing of the coupling is in it. `dry` places its data at the state.
    """
    mujoco.mj_fwdPosition(dry, data)
    mujoco.mj_fwdVelocity(dry, data)
    total, linear, angular = 0.0, np.zeros(3), np.zeros(3)
    for part in parts_:
        index = dry.body(part.name).id
        twist = np.zeros(6)
        mujoco.mj_objectVelocity(dry, data, mujoco.mjtObj.mjOBJ_BODY, index, twist, 0)
        omega, velocity = twist[:3], twist[3:] - dry.opt.wind
        at = data.xipos[index] - dry.opt.wind * data.time
        turned = data.xmat[index].reshape(3, 3)
        spin = turned @ np.array(part.inertia) @ turned.T @ omega
        total += 0.5 * part.mass * velocity @ velocity + 0.5 * omega @ spin
        linear += part.mass * velocity
        angular += part.mass * np.cross(at, velocity) + spin
        for link in part.strips:
            one = strips(link)
            motion = motion_of(dry, data, part.name, one)
            momentum, moment = impulse(one, motion)
            total += energy(one, motion)
            linear += momentum
            angular += moment
    return total, linear, angular


def drifts(
    free: Sequence[Part], coupling: Coupling, *, integrator: str = "RK4", current: bool = False,
    steps: Sequence[float] = STEPS,
) -> Drifts:  # fmt: skip
    """Let a tree of parts float, without drag, and return how much of what must stay is lost, step by step."""
    ideal = parts.with_water(free, munk_moment=1.0, c_d=0.0, c_f=0.0)
    relative = []
    for step in steps:
        model = parts.spec(ideal, integrator=integrator, step=step).compile()
        if current:
            model.opt.wind[:] = CURRENT
        fluid = parts.wet(model, ideal, coupling)
        dry = dried(model)
        data, alone = mujoco.MjData(model), mujoco.MjData(dry)
        parts.stir(model, data, seed=2, speed=0.7)
        found = []
        with fluid.installed():
            for _ in range(_SAMPLES + 1):
                alone.time, alone.qpos[:], alone.qvel[:] = data.time, data.qpos, data.qvel
                found.append(np.concatenate([np.atleast_1d(invariant) for invariant in invariants(dry, alone, ideal)]))
                mujoco.mj_step(model, data, round(_DURATION / _SAMPLES / step))
        change = np.abs(np.array(found) - found[0])
        scale = np.abs(found[0])
        parted = (slice(0, 1), slice(1, 4), slice(4, 7))
        relative.append([change[:, one].max() / scale[one].max() for one in parted])
    return Drifts(np.array(steps), np.array(relative))
