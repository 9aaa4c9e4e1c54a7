"""Rollouts of the head-frame model: joint motion in, velocity and pose of the nose out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from mjfish import frames
from mjfish.arrays import FloatArray
from mjfish.drive.motion import JointMotion
from mjfish.errors import InputError
from mjfish.fish import Fish
from mjfish.hydro.link import link_records
from mjfish.hydro.load import Load, load_table
from mjfish.ode.equation import STATES
from mjfish.ode.integrate import integrate

Coriolis = Literal["corrected", "printed"]
#: Default step of the model [s]. The nominal fish's rms error is then below 3e-5 m/s and 1.5e-4 rad/s, at start-up up
#: to 4e-4 m/s and 2e-3 rad/s (omega 26); it falls sixteenfold with each halving (docs/theory.md).
STEP = 0.005
#: Signs that turn velocity and pose from the model's frame to the forward frame; deflections keep theirs.
_TO_FORWARD = np.concatenate([frames.flip(np.ones(3)), frames.flip(np.ones(3)), np.ones(2)])


@dataclass(frozen=True, eq=False)
class Rollout:
    """A simulated run in the forward frame.

    Attributes:
        motion: joint motion it was driven by.
        state: (n, 2, 8) at start and end of each step: surge, sway [m/s], yaw rate [rad/s], x, y [m], yaw [rad], tail
            deflection [rad] and its rate [rad/s].
        derivative: (n, 2, 8) its time derivative.
        status: ``ok`` or ``diverged``.
        message: when and with which parameters it diverged, else empty.
    """

    motion: JointMotion
    state: FloatArray
    derivative: FloatArray
    status: Literal["ok", "diverged"]
    message: str

    @property
    def time(self) -> FloatArray:
        """Boundaries of the steps (n + 1,) [s], as far as the rollout went."""
        return self.motion.time[: len(self.state) + 1]

    def at(self, time: FloatArray) -> FloatArray:
        """Return the state (m, 8) at any times, by cubic Hermite interpolation; at a jump, the value after it.

        Before the start it is the state at the start; after the end it is NaN. Times may be complex, their imaginary
        part a derivative (`mjfish.ode.tangent`).
        """
        edges, when = self.time, time.real
        index = np.clip(np.searchsorted(edges, when + 1e-12, side="right") - 1, 0, len(self.state) - 1)
        width = (edges[index + 1] - edges[index])[:, None]
        s = np.where(when < edges[0], 0.0, time - edges[index])[:, None] / width
        left, right = self.state[index, 0], self.state[index, 1]
        slope_left, slope_right = self.derivative[index, 0] * width, self.derivative[index, 1] * width
        values = (
            (1 + 2 * s) * (1 - s) ** 2 * left
            + s * (1 - s) ** 2 * slope_left
            + s**2 * (3 - 2 * s) * right
            + s**2 * (s - 1) * slope_right
        )
        return np.where((when > edges[-1] + 1e-9)[:, None], np.nan, values)


def simulate(
    fish: Fish,
    motion: JointMotion,
    *,
    values: Mapping[str, float] | None = None,
    velocity: FloatArray | None = None,
    coriolis: Coriolis = "corrected",
    loads: Sequence[tuple[Load, Sequence[float]]] = (),
) -> Rollout:
    """Simulate the fish driven by `motion`, from rest or from `velocity`.

    Args:
        fish: the fish.
        motion: joint motion on the half-step grid.
        values: coefficients by name that replace the fish's.
        velocity: (3,) surge, sway [m/s], yaw rate [rad/s] at the start; None: at rest.
        coriolis: ``printed`` drops the term U x p as the paper does (an error; see docs/theory.md).
        loads: extra forces on every link, with their parameters.

    Returns:
        The rollout; one that diverges has ``status == "diverged"`` and ends there.
    """
    if motion.joints != fish.joints:
        raise InputError(f"the motion has {motion.joints} joints, {fish.name} has {fish.joints}")
    cos, sin = motion.trigonometry
    moving = (cos, sin, motion.rate, motion.acceleration, np.ascontiguousarray(motion.angle[:, :, -1]))
    rollout = integrated(
        motion, link_records(fish, values), moving, start_of(velocity), tail_of(fish), coriolis, load_table(loads)
    )
    if rollout.status == "ok":
        return rollout
    named = ", ".join(f"{name} = {value:g}" for name, value in {**fish.values, **(values or {})}.items())
    return replace(rollout, message=f"{rollout.message} with {named}; check the coefficients and the drive")


def integrated(
    motion: JointMotion,
    links: Any,
    moving: tuple[Any, ...],
    start: Any,
    tail: Any,
    coriolis: Coriolis,
    loads: tuple[Any, Any],
) -> Rollout:
    """Integrate, in the model's frame, numbers or complex numbers (`mjfish.ode.tangent`); return the forward frame's.

    Args:
        motion: gives the steps.
        links: (links,) records.
        moving: cosine, sine, rate, acceleration of the joints (n, 3, joints) and the angle of the last (n, 3).
        start: (STATES,).
        tail: (3,) of the flexible tail.
        coriolis: form of the gyroscopic terms.
        loads: addresses and parameters of `mjfish.hydro.load.load_table`.
    """
    steps = len(motion.time) - 1
    states = np.zeros((steps, 2, STATES), dtype=start.dtype)
    rates = np.zeros_like(states)
    run: Any = integrate  # also compiled for complex numbers
    done = run(links, motion.time, *moving, start, tail, coriolis == "printed", *loads, states, rates)
    kept = max(done, 1)
    return Rollout(
        motion=motion,
        state=states[:kept] * _TO_FORWARD,
        derivative=rates[:kept] * _TO_FORWARD,
        status="ok" if done == steps else "diverged",
        message="" if done == steps else f"diverged at {motion.time[done]:.3f} s",
    )


def start_of(velocity: FloatArray | None) -> FloatArray:
    """Return the state (STATES,) at the start, in the model's frame: at rest, or with a velocity of the forward one."""
    start = np.zeros(STATES)
    if velocity is not None:
        start[:3] = frames.flip(np.asarray(velocity, dtype=np.float64))
    return start


def tail_of(fish: Fish) -> FloatArray:
    """Return flexible (0 or 1), stiffness [N m/rad] and damping [N m s/rad] of the last joint's deflection (3,)."""
    flexible = fish.tail_compliance > 0.0
    return np.array([float(flexible), 1.0 / fish.tail_compliance if flexible else 0.0, fish.tail_damping])
