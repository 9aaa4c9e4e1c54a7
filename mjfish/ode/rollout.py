"""Rollouts of the head-frame model: joint motion in, velocity and pose of the nose out.

`simulate` prepares the arrays, `integrate` is the compiled loop over the steps of the joint motion.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, NamedTuple

import numpy as np

from mjfish.drive.motion import JointMotion
from mjfish.errors import InputError
from mjfish.fish import Fish, frames
from mjfish.hydro.link import link_records
from mjfish.hydro.load import ANSWER, Load, LoadTable, load_rows, memory_of
from mjfish.numerics.arrays import BoolArray, FloatArray
from mjfish.numerics.compiled import borrowing, merged
from mjfish.ode.equation import STATES, TAIL, Joints, System, derivative, tail_of

Coriolis = Literal["corrected", "printed"]
#: A rollout has diverged once a velocity passes this [m/s or rad/s]: no fish does.
DIVERGED = 1e3
#: Phases of a step: the end of the step before and the jump, where joint rates jump, then the four Runge-Kutta stages.
PHASE_END, PHASE_JUMP = -2, -1
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
        memory: (n, 2, states) memory of the loads.
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

    def at_steps(self) -> FloatArray:
        """Return states, the memory of loads behind them, (n + 1, 8 + memory) at the boundaries, after each jump."""
        states = self.state if self.memory is None else np.concatenate([self.state, self.memory], axis=2)
        return np.concatenate([states[:, 0], states[-1:, 1]])

    def at(self, time: FloatArray) -> FloatArray:
        """Return the state (m, 8) at any times, by cubic Hermite interpolation; at a jump, the value after it.

        Before the start it is the state at the start; after the end it is NaN.
        """
        index, at = place_in(self.time, time)
        s, width = at[:, None], (self.time[index + 1] - self.time[index])[:, None]
        weights = (1 + 2 * s) * (1 - s) ** 2, s * (1 - s) ** 2 * width, s**2 * (3 - 2 * s), s**2 * (s - 1) * width
        return self._blend(time, index, weights)

    def rate_at(self, time: FloatArray) -> FloatArray:
        """Return the rate of `at` by the times (m, 8); zero before the start, NaN after the end."""
        index, at = place_in(self.time, time)
        s, width = at[:, None], (self.time[index + 1] - self.time[index])[:, None]
        rise = 6 * s * (1 - s) / width
        weights = (-rise, (1 - s) * (1 - 3 * s), rise, s * (3 * s - 2))
        return np.asarray(self._blend(time, index, weights) * (time >= self.time[0])[:, None])

    def _blend(self, time: FloatArray, index: Any, weights: tuple[FloatArray, ...]) -> FloatArray:
        """Return the cubic of each time from its weights of value and rate at the start and at the end of its step."""
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
        """Return what `integrate` wrote, of which `done` steps are good, in the forward frame; turns it in place."""
        kept = max(done, 1)
        ok = done == len(motion.time) - 1
        states[:kept, :, :STATES] *= TO_FORWARD
        rates[:kept, :, :STATES] *= TO_FORWARD
        return cls(
            motion=motion,
            state=np.ascontiguousarray(states[:kept, :, :STATES]),
            derivative=np.ascontiguousarray(rates[:kept, :, :STATES]),
            memory=states[:kept, :, STATES:],
            status="ok" if ok else "diverged",
            message="" if ok else f"diverged at {motion.time[done]:.3f} s",
        )


def place_in(edges: FloatArray, time: FloatArray) -> tuple[Any, FloatArray]:
    """Return the step (m,) in which each time is and where in it (m,), 0 to 1; at an edge, the start of the next."""
    index = np.clip(np.searchsorted(edges, time + 1e-12, side="right") - 1, 0, len(edges) - 2)
    return index, np.where(time < edges[0], 0.0, time - edges[index]) / (edges[index + 1] - edges[index])


@dataclass(frozen=True, eq=False)
class Conditions:
    """What a rollout is simulated under.

    Attributes:
        values: coefficients by name that replace the fish's.
        velocity: (3,) surge, sway [m/s], yaw rate [rad/s] at the start; None: at rest.
        pose: (3,) x, y [m], yaw [rad] of the nose at the start; NaN or None: 0.
        coriolis: ``printed`` drops the term U x p as the paper does (an error; see docs/theory.md).
        loads: extra forces on every link, with their parameters.
    """

    values: Mapping[str, float] | None = None
    velocity: FloatArray | None = None
    pose: FloatArray | None = None
    coriolis: Coriolis = "corrected"
    loads: Sequence[tuple[Load, Sequence[float]]] = ()


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
        values, velocity, pose, coriolis, loads: see `Conditions`.

    Returns:
        The rollout; one that diverges has ``status == "diverged"`` and ends there.

    Raises:
        InputError: the motion has not as many joints as the fish.
    """
    if motion.joints != fish.joints:
        raise InputError(f"the motion has {motion.joints} joints, {fish.name} has {fish.joints}")
    start = start_of(velocity, pose, memory_of(loads, len(fish.links)))
    states, rates = np.zeros((2, len(motion.time) - 1, 2, len(start)))
    system = system_of(fish, values, coriolis, load_rows(loads, len(fish.links), STATES))
    workspace = Workspace.of(len(start), motion.joints)
    done = integrate(system, joints_of(motion), motion.time, motion.jumps, start, workspace, states, rates)
    rollout = Rollout.of(motion, states, rates, done)
    if rollout.status == "ok":
        return rollout
    named = ", ".join(f"{name} = {value:g}" for name, value in {**fish.values, **(values or {})}.items())
    return replace(rollout, message=f"{rollout.message} with {named}; check the coefficients and the drive")


def system_of(fish: Fish, values: Mapping[str, float] | None, coriolis: Coriolis, loads: LoadTable) -> System:
    """Return fish and loads for compiled code; `values` replaces coefficients by name."""
    return System(link_records(fish, values), tail_of(fish), coriolis == "printed", loads)


def joints_of(motion: JointMotion) -> Joints:
    """Return the joint motion for compiled code."""
    cos, sin = motion.trigonometry
    return Joints(cos, sin, motion.rate, motion.acceleration, np.ascontiguousarray(motion.angle[:, :, -1]))


def start_of(velocity: FloatArray | None, pose: FloatArray | None = None, memory_states: int = 0) -> FloatArray:
    """Return the state (STATES + memory,) at the start, in the model's frame, from what it is in the forward one.

    None is rest, or the origin; a NaN of the pose is 0.
    """
    start = np.zeros(STATES + memory_states)
    if velocity is not None:
        start[:3] = frames.flip(np.asarray(velocity, dtype=np.float64))
    if pose is not None:
        start[3:6] = frames.flip(np.nan_to_num(np.asarray(pose, dtype=np.float64)))
    return start


class Workspace(NamedTuple):
    """Scratch of an integration: state, trial state, weighted sum of the stages, rates; output of a load; joints."""

    state: FloatArray
    trial: FloatArray
    total: FloatArray
    rates: FloatArray
    output: FloatArray
    joint_rate: FloatArray
    joint_acceleration: FloatArray
    tail: FloatArray

    @classmethod
    def of(cls, states: int, joints: int, kind: Any = np.float64) -> Workspace:
        """Return scratch for a number of states and joints; `kind` of numbers is real or complex."""
        state, trial, total, rates = (np.zeros(states, dtype=kind) for _ in range(4))
        rate, acceleration = (np.zeros(joints, dtype=kind) for _ in range(2))
        return cls(state, trial, total, rates, np.zeros(ANSWER), rate, acceleration, np.zeros(TAIL, dtype=kind))


@borrowing
def integrate(
    system: System, joints: Joints, time: FloatArray, jumps: BoolArray, start: FloatArray, workspace: Workspace,
    states: FloatArray, rates: FloatArray,
) -> int:  # fmt: skip
    """Integrate by classical Runge-Kutta steps; return the number of steps done before divergence.

    Where the joint rates jump between two steps, the head's velocity jumps with them: no impulse acts on the fish, so
    that sum_i T_i^T (M_i + M_ad,i) dV_i = 0.

    Args:
        system: fish and loads.
        joints: at start, middle and end of every step.
        time: (steps + 1,) [s].
        jumps: (steps,) whether the joint rates jump before a step.
        start: (STATES + memory,).
        workspace: scratch.
        states, rates: (steps, 2, STATES + memory), written: state and derivative at start and end of each step.
    """
    steps = time.shape[0] - 1
    state, trial, k = workspace.state, workspace.trial, workspace.rates
    copy(start, state)
    for step in range(steps + 1):
        over = step == steps
        jump = step > 0 and (over or jumps[step])
        for phase in range(PHASE_END if jump else 0, PHASE_JUMP if over else 4):
            if phase <= 0:
                copy(state, trial)
            now, stage = sample_of(step, phase)
            at = joints_in(joints, now, stage, workspace)
            copy(system.tail, workspace.tail)
            acting = system.loads.addresses.shape[0]
            if phase == PHASE_JUMP:
                acting = 0
                rest(trial, workspace.tail)
                strike(joints, step, workspace)
            loads = LoadTable(system.loads.addresses[:acting], system.loads.rows)
            now_system = System(system.links, workspace.tail, system.printed, loads)
            derivative(now_system, at, trial, workspace.output, k)
            if phase == PHASE_JUMP:
                for row in (0, 1, 2, 7):
                    state[row] += k[row]
                continue
            if phase == PHASE_END or (phase == 0 and step > 0 and not jump):
                copy(k, rates[step - 1, 1])
            if phase == PHASE_END:
                continue
            if phase == 0:
                copy(state, states[step, 0])
                copy(k, rates[step, 0])
            advance(phase, time[step + 1] - time[step], k, workspace.total, trial, state)
        if not over:
            copy(state, states[step, 1])
            if not (abs(state[0]) < DIVERGED and abs(state[1]) < DIVERGED and abs(state[2]) < DIVERGED):
                return step
    return int(steps)


@merged
def sample_of(step: int, phase: int) -> tuple[int, int]:
    """Return of which step, and where in it (0 start, 1 middle, 2 end), the joints are taken in a phase."""
    if phase == PHASE_END:
        return step - 1, 2
    return step, 0 if phase <= 0 else (2 if phase == 3 else 1)


@merged
def joints_in(joints: Joints, step: int, stage: int, workspace: Workspace) -> Joints:
    """Return the joints at one sample; their rates and accelerations are copies in the workspace."""
    for j in range(workspace.joint_rate.shape[0]):
        workspace.joint_rate[j] = joints.rate[step, stage, j]
        workspace.joint_acceleration[j] = joints.acceleration[step, stage, j]
    return Joints(
        joints.cos[step, stage], joints.sin[step, stage], workspace.joint_rate, workspace.joint_acceleration,
        joints.angle_last[step, stage],
    )  # fmt: skip


@merged
def rest(state: FloatArray, tail: FloatArray) -> None:
    """Keep heading and deflection only: the fish on which a jump of the joint rates acts is at rest, its tail loose."""
    tail[1:] = 0.0
    for row in (0, 1, 2, 3, 4, 7):
        state[row] = 0.0


@merged
def strike(joints: Joints, step: int, workspace: Workspace) -> None:
    """Make the jump of the rates before a step an acceleration that acts on joints at rest."""
    for j in range(workspace.joint_rate.shape[0]):
        workspace.joint_rate[j] = 0.0
        workspace.joint_acceleration[j] = joints.rate[step, 0, j] - joints.rate[step - 1, 2, j]


@merged
def advance(phase: int, h: float, k: FloatArray, total: FloatArray, trial: FloatArray, state: FloatArray) -> None:
    """Take up the rates `k` of a Runge-Kutta stage; after the last one, advance the state by the step `h`."""
    if phase == 0:
        copy(k, total)
    else:
        weight = 1.0 if phase == 3 else 2.0
        for i in range(state.shape[0]):
            total[i] += weight * k[i]
    if phase < 3:
        reach = h if phase == 2 else 0.5 * h
        for i in range(state.shape[0]):
            trial[i] = state[i] + reach * k[i]
    else:
        for i in range(state.shape[0]):
            state[i] += h / 6.0 * total[i]


@merged
def copy(source: FloatArray, target: FloatArray) -> None:
    """Copy vectors."""
    for i in range(target.shape[0]):
        target[i] = source[i]
