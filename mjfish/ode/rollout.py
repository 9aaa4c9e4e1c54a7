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
from mjfish.hydro.load import Load, load_rows, memory_of
from mjfish.ode.equation import STATES
from mjfish.ode.integrate import integrate

Coriolis = Literal["corrected", "printed"]
#: Default step of the model [s]. The nominal fish's rms error is then below 3e-5 m/s and 1.5e-4 rad/s, at start-up up
#: to 4e-4 m/s and 2e-3 rad/s (omega 26); it falls sixteenfold with each halving (docs/theory.md).
STEP = 0.005
#: Signs that turn velocity and pose from the model's frame to the forward frame; deflections keep theirs.
TO_FORWARD = np.concatenate([frames.flip(np.ones(3)), frames.flip(np.ones(3)), np.ones(2)])


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
        memory: (n, 2, hidden) hidden states of the loads.
    """

    motion: JointMotion
    state: FloatArray
    derivative: FloatArray
    status: Literal["ok", "diverged"]
    message: str
    memory: FloatArray | None = None

    @property
    def time(self) -> FloatArray:
        """Boundaries of the steps (n + 1,) [s], as far as the rollout went."""
        return self.motion.time[: len(self.state) + 1]

    def at(self, time: FloatArray) -> FloatArray:
        """Return the state (m, 8) at any times, by cubic Hermite interpolation; at a jump, the value after it.

        Before the start it is the state at the start; after the end it is NaN.
        """
        index, at = place_in(self.time, time)
        width = (self.time[index + 1] - self.time[index])[:, None]
        return self._blend(time, index, hermite(at[:, None], width))

    def rate_at(self, time: FloatArray) -> FloatArray:
        """Return the rate of `at` by the times (m, 8); zero before the start, NaN after the end."""
        index, at = place_in(self.time, time)
        width = (self.time[index + 1] - self.time[index])[:, None]
        s = at[:, None]
        rise = 6 * s * (1 - s) / width
        weights = (-rise, (1 - s) * (1 - 3 * s), rise, s * (3 * s - 2))
        return np.asarray(self._blend(time, index, weights) * (time >= self.time[0])[:, None])

    def _blend(self, time: FloatArray, index: Any, weights: tuple[FloatArray, ...]) -> FloatArray:
        left, left_rate, right, right_rate = weights
        values = (
            left * self.state[index, 0]
            + left_rate * self.derivative[index, 0]
            + right * self.state[index, 1]
            + right_rate * self.derivative[index, 1]
        )
        return np.where((time > self.time[-1] + 1e-9)[:, None], np.nan, values)

    @classmethod
    def of(cls, motion: JointMotion, states: FloatArray, rates: FloatArray, done: int) -> Rollout:
        """Return what `mjfish.ode.integrate` wrote, of which `done` steps are good, in the forward frame."""
        kept = max(done, 1)
        ok = done == len(motion.time) - 1
        return cls(
            motion=motion,
            state=states[:kept, :, :STATES] * TO_FORWARD,
            derivative=rates[:kept, :, :STATES] * TO_FORWARD,
            memory=states[:kept, :, STATES:],
            status="ok" if ok else "diverged",
            message="" if ok else f"diverged at {motion.time[done]:.3f} s",
        )


def place_in(edges: FloatArray, time: FloatArray) -> tuple[Any, FloatArray]:
    """Return the step (m,) in which each time is and where in it (m,), 0 to 1; at an edge, the start of the next."""
    index = np.clip(np.searchsorted(edges, time + 1e-12, side="right") - 1, 0, len(edges) - 2)
    at = np.where(time < edges[0], 0.0, time - edges[index]) / (edges[index + 1] - edges[index])
    return index, at


def hermite(s: FloatArray, width: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return the weights of value and rate at the start, and at the end, of a step: cubic Hermite interpolation."""
    return (1 + 2 * s) * (1 - s) ** 2, s * (1 - s) ** 2 * width, s**2 * (3 - 2 * s), s**2 * (s - 1) * width


def simulate(
    fish: Fish,
    motion: JointMotion,
    *,
    values: Mapping[str, float] | None = None,
    velocity: FloatArray | None = None,
    pose: FloatArray | None = None,
    coriolis: Coriolis = "corrected",
    loads: Sequence[tuple[Load, Sequence[float]]] = (),
) -> Rollout:
    """Simulate the fish driven by `motion`, from rest or from `velocity`.

    Args:
        fish: the fish.
        motion: joint motion on the half-step grid.
        values: coefficients by name that replace the fish's.
        velocity: (3,) surge, sway [m/s], yaw rate [rad/s] at the start; None: at rest.
        pose: (3,) x, y [m], yaw [rad] of the nose at the start; NaN or None: 0.
        coriolis: ``printed`` drops the term U x p as the paper does (an error; see docs/theory.md).
        loads: extra forces on every link, with their parameters.

    Returns:
        The rollout; one that diverges has ``status == "diverged"`` and ends there.
    """
    if motion.joints != fish.joints:
        raise InputError(f"the motion has {motion.joints} joints, {fish.name} has {fish.joints}")
    steps = len(motion.time) - 1
    start = start_of(velocity, pose, memory_of(loads, len(fish.links)))
    states, rates = np.zeros((steps, 2, len(start))), np.zeros((steps, 2, len(start)))
    done = integrate(
        link_records(fish, values), motion.time, *motion.trigonometry, motion.rate, motion.acceleration,
        np.ascontiguousarray(motion.angle[:, :, -1]), start, tail_of(fish), coriolis == "printed",
        *load_rows(loads, len(fish.links), STATES), states, rates,
    )  # fmt: skip
    rollout = Rollout.of(motion, states, rates, done)
    if rollout.status == "ok":
        return rollout
    named = ", ".join(f"{name} = {value:g}" for name, value in {**fish.values, **(values or {})}.items())
    return replace(rollout, message=f"{rollout.message} with {named}; check the coefficients and the drive")


def start_of(velocity: FloatArray | None, pose: FloatArray | None = None, hidden: int = 0) -> FloatArray:
    """Return the state (STATES + hidden,) at the start, in the model's frame, from what it is in the forward one.

    None is rest, or the origin; a NaN of the pose is 0.
    """
    start = np.zeros(STATES + hidden)
    if velocity is not None:
        start[:3] = frames.flip(np.asarray(velocity, dtype=np.float64))
    if pose is not None:
        start[3:6] = frames.flip(np.nan_to_num(np.asarray(pose, dtype=np.float64)))
    return start


def tail_of(fish: Fish) -> FloatArray:
    """Return flexible (0 or 1), stiffness [N m/rad] and damping [N m s/rad] of the last joint's deflection (3,)."""
    flexible = fish.tail_compliance > 0.0
    return np.array([float(flexible), 1.0 / fish.tail_compliance if flexible else 0.0, fish.tail_damping])
