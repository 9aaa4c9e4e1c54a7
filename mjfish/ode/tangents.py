"""Rollouts with their derivatives along many directions, exact, in one pass.

`Direction` says what a rollout is derived by, `simulate_tangents` prepares the arrays, `integrate_tangents` is the
compiled loop: `mjfish.ode.rollout.integrate` step for step, with the same formulas, differentiated, for the tangents.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from mjfish.drive.motion import JointMotion
from mjfish.fish import Fish
from mjfish.hydro.link import LINK, NUMBERS, column
from mjfish.hydro.load import AT_WANTED, Load, LoadTable, load_rows, memory_of
from mjfish.hydro.load_derivatives import LOAD_CHANGE, RELATIVE_STEP, LoadChanges
from mjfish.numerics.arrays import BoolArray, FloatArray
from mjfish.numerics.compiled import borrowing, merged
from mjfish.ode.equation import STATES, TAIL, Joints, System, derivative
from mjfish.ode.rollout import (
    DIVERGED,
    PHASE_END,
    PHASE_JUMP,
    TO_FORWARD,
    Conditions,
    Rollout,
    Workspace,
    advance,
    copy,
    joints_in,
    joints_of,
    place_in,
    rest,
    sample_of,
    start_of,
    strike,
    system_of,
)
from mjfish.ode.tangent_rates import LINK_CHANGE, Directions, LinkChanges, TangentScratch, tangent_rates

#: Directions are padded to a multiple of what a vector register holds.
_WIDTH = 4
#: Jump of a direction's joint rates that counts as one, relative to its largest rate: rounding does not.
_JUMP = 1e-7
_TABLES = slice(column("node_height"), column("strip_r"))
_ADDED = slice(column("added"), column("added") + 3)


@dataclass(frozen=True, eq=False)
class Direction:
    """What a rollout is derived by: rates of change of its inputs; None is zero.

    Attributes:
        links: (links, numbers of `LINK`) of the link records.
        tail: (TAIL,) of the flexible tail, see `mjfish.ode.equation.System`.
        velocity: (3,) of the velocity at the start, in the forward frame.
        pose: (3,) of the pose at the start.
        motion: (3, n, 3, joints) of angle, rate and acceleration of the joints.
        loads: (k, PARAMETERS) of the parameters of the loads, those of the conditions and then the inactive ones.
    """

    links: FloatArray | None = None
    tail: FloatArray | None = None
    velocity: FloatArray | None = None
    pose: FloatArray | None = None
    motion: FloatArray | None = None
    loads: FloatArray | None = None


def simulate_tangents(
    fish: Fish,
    motion: JointMotion,
    directions: Sequence[Direction],
    time: FloatArray,
    *,
    conditions: Conditions | None = None,
    inactive: Sequence[tuple[Load, Sequence[float]]] = (),
    with_rates: bool = False,
) -> tuple[Rollout, FloatArray]:
    """Simulate like `mjfish.ode.simulate`, and along with it the derivatives in all directions.

    Args:
        fish, motion: as in `simulate`.
        directions: k of them.
        time: (m,) at which derivatives are asked for [s].
        conditions: of the rollout; None: from rest, with the fish's own coefficients.
        inactive: loads with parameters at which they exert nothing, but would along a direction.
        with_rates: whether the derivatives of the state's rates, as `Rollout.rate_at` has them, are asked for, too.

    Returns:
        The rollout, that of `simulate` to the last bit, and the derivatives of its state (m, 8, k), with those of its
        rates behind them (m, 16, k) where asked for; NaN after the end.
    """
    given = conditions or Conditions()
    motion_first = sorted(range(len(directions)), key=lambda k: directions[k].motion is None)
    ordered = [directions[k] for k in motion_first]
    links, width = len(fish.links), -(-len(directions) // _WIDTH) * _WIDTH
    # Stateful loads take part even where they exert nothing: their hidden states, or poses, must be known.
    stateful_first = sorted(range(len(inactive)), key=lambda k: not inactive[k][0].stateful)
    loads = [*given.loads, *(inactive[k] for k in stateful_first)]
    acting = len(given.loads) + sum(load.stateful for load, _ in inactive)
    row_of = [*range(len(given.loads)), *(len(given.loads) + stateful_first.index(k) for k in range(len(inactive)))]
    start = start_of(given.velocity, given.pose, memory_of(loads[:acting], links))
    table = load_rows(loads, links, STATES, [load for load, _ in inactive])
    system = system_of(fish, given.values, given.coriolis, LoadTable(table.addresses[:acting], table.rows))
    tangents, tail, length = np.zeros((len(start), width)), np.zeros((TAIL, width)), np.zeros((links, width))
    for k, direction in enumerate(ordered):
        if direction.velocity is not None or direction.pose is not None:
            tangents[:STATES, k] = start_of(direction.velocity, direction.pose)
        if direction.tail is not None:
            tail[:, k] = direction.tail
        if direction.links is not None:
            length[:, k] = direction.links[:, column("length")]
    changed = Directions(
        tail, _joint_changes(ordered, motion), _link_changes(ordered, system.links, given.loads),
        LoadChanges(_load_changes(ordered, table, row_of), table.addresses, len(given.loads)), length,
    )  # fmt: skip
    states, rates = np.zeros((2, len(motion.time) - 1, 2, len(start)))
    index, place = place_in(motion.time, time)
    order = np.argsort(index, kind="stable")
    rows = 2 * STATES if with_rates else STATES
    samples = Samples(index[order], place[order], np.full((len(time), rows, len(directions)), np.nan))
    stateful = any(load.stateful for load, _ in given.loads)
    workspace = TangentWorkspace(
        state=Workspace.of(len(start), motion.joints),
        tangents=tangents,
        trial=np.zeros_like(tangents),
        total=np.zeros_like(tangents),
        rates=np.zeros_like(tangents),
        left=np.zeros_like(tangents),
        left_rates=np.zeros_like(tangents),
        motion=np.zeros(changed.motion.shape[2:]),
        tail=np.zeros((TAIL, width)),
        scratch=TangentScratch.empty(motion.joints, len(start), acting, width, stateful),
    )
    jumps = motion.jumps | _jumps(changed.motion, motion.joints)
    done = integrate_tangents(
        system, joints_of(motion), motion.time, jumps, start, changed, samples, workspace, states, rates
    )
    found = samples.values
    if motion_first != sorted(motion_first):
        found = found[:, :, np.argsort(motion_first)]
    if np.any(np.diff(order) < 0):  # of hours of samples a copy is large
        found = found[np.argsort(order)]
    found[time > motion.time[-1] + 1e-9] = np.nan
    found *= np.tile(TO_FORWARD, rows // STATES)[:, None]
    found[time < motion.time[0], STATES:] = 0.0  # the fish waits for its start
    return Rollout.of(motion, states, rates, done), found


def _joint_changes(directions: Sequence[Direction], motion: JointMotion) -> FloatArray:
    """Return rates (n, 3, 3 joints, b) of angles, rates, accelerations, of the directions that have any."""
    moving = [direction.motion for direction in directions if direction.motion is not None]
    changes = np.empty((len(motion.time) - 1, 3, 3, motion.joints, len(moving)))
    for b, rates in enumerate(moving):
        changes[..., b] = rates.transpose(1, 2, 0, 3)
    return changes.reshape(*changes.shape[:2], 3 * motion.joints, len(moving))


def _jumps(changes: FloatArray, joints: int) -> BoolArray:
    """Return (n,) whether the joint rates of any direction jump before each step; `changes` of `_joint_changes`."""
    jumps = np.zeros(len(changes), dtype=bool)
    if changes.shape[3]:
        rates = changes[:, :, joints : 2 * joints]
        bound = _JUMP * np.abs(rates[:, 0]).max(axis=(0, 1))
        jumps[1:] = (np.abs(rates[1:, 0] - rates[:-1, 2]) > bound).any(axis=(1, 2))
    return jumps


def _link_changes(
    directions: Sequence[Direction], records: Any, loads: Sequence[tuple[Load, Sequence[float]]]
) -> LinkChanges:
    """Return what the directions change of the links: one change for each pair of direction and link."""
    changing = [(k, direction.links) for k, direction in enumerate(directions) if direction.links is not None]
    rates = np.array([links for _, links in changing]).reshape(len(changing), len(records), NUMBERS)
    link, pair = np.nonzero(rates.any(axis=2).T)
    rate = rates[pair, link]
    here = records.view(np.float64).reshape(-1, NUMBERS)[link]
    changes = _products(here, rate)
    changes["direction"] = np.array([k for k, _ in changing], dtype=np.int64)[pair]
    changes["link"] = link
    reshaped = rate[:, _TABLES].any(axis=1) | (rate[:, column("length")] != 0.0)
    changes["outline"] = _numbered(reshaped)
    outlines = rate[reshaped].reshape(-1).view(LINK)
    read = np.zeros(NUMBERS, dtype=bool)
    for load, _ in loads:
        read |= load.reads
    seen = rate * read  # what a load sees of the change
    moved = seen.any(axis=1)
    with np.errstate(divide="ignore"):
        step = RELATIVE_STEP * np.min(np.maximum(np.abs(here), 1e-3) / np.abs(seen), axis=1, initial=np.inf)
    changes["step"] = np.where(moved, step, 0.0)
    changes["record"] = _numbered(moved)
    there = here[moved] + changes["step"][moved, None] * seen[moved]
    return LinkChanges(changes, outlines, np.ascontiguousarray(there).reshape(-1).view(LINK))


def _numbered(chosen: Any) -> Any:
    """Return 0, 1, 2, ... where chosen, else -1."""
    return np.where(chosen, np.cumsum(chosen) - 1, -1)


def _products(here: FloatArray, rate: FloatArray) -> Any:
    """Return `LINK_CHANGE` records (p,) with what the wrench of a link is linear in, by the product rule."""
    fields = ("mass", "com", "inertia", "density", "c_m", "c_d", "c_f", "munk", "wetted", "length")
    x = {name: here[:, column(name)] for name in fields}
    d = {name: rate[:, column(name)] for name in fields}
    a0, a1, a2 = d["c_m"] * here[:, _ADDED].T + x["c_m"] * rate[:, _ADDED].T
    changes = np.zeros(len(rate), dtype=LINK_CHANGE)
    first = d["mass"] * x["com"] + x["mass"] * d["com"]
    for name in ("mass", "munk", "length"):
        changes[name] = d[name]
    changes["first"], changes["added_0"], changes["added_1"] = first, a0, a1
    changes["second"] = d["inertia"] + first * x["com"] + x["mass"] * x["com"] * d["com"] + a2
    per_area = d["density"] * x["c_f"] + x["density"] * d["c_f"]
    changes["friction"] = 0.5 * (per_area * x["wetted"] + x["density"] * x["c_f"] * d["wetted"])
    changes["crossflow"] = 0.5 * (d["density"] * x["c_d"] + x["density"] * d["c_d"])
    return changes


def _load_changes(directions: Sequence[Direction], table: LoadTable, row_of: Sequence[int]) -> Any:
    """Return `LOAD_CHANGE` records of what the directions change of the parameters of loads, load by load.

    Args:
        directions: in their order.
        table: of all loads; written: which derivatives are wanted.
        row_of: (k,) row in the table of each load of a direction.
    """
    changes = [
        (k, row_of[int(load)], int(number), direction.loads[load, number])
        for k, direction in enumerate(directions)
        if direction.loads is not None
        for load, number in zip(*np.nonzero(direction.loads), strict=True)
    ]
    for row, moved in {change[1:3] for change in changes}:
        table.rows[row, AT_WANTED] += 1 << moved
    return np.array(sorted(changes, key=lambda change: change[1]), dtype=LOAD_CHANGE)


class Samples(NamedTuple):
    """Where tangents are read.

    Attributes:
        step: (m,) in which step, not decreasing.
        place: (m,) where in the step, 0 to 1.
        values: (m, STATES, k), written as far as the rollout goes; of 2 STATES rows, those of the rates by time, too.
    """

    step: Any
    place: FloatArray
    values: FloatArray


class TangentWorkspace(NamedTuple):
    """Scratch of `integrate_tangents`.

    Attributes:
        state: of the rollout.
        tangents, trial, total, rates: (STATES + memory, k), as of the rollout; `tangents` holds those of the start.
        left, left_rates: (STATES + memory, k) at the start of the step.
        motion: (3 joints, b) of one instant; tail: (TAIL, k).
        scratch: of `mjfish.ode.tangent_rates`.
    """

    state: Workspace
    tangents: FloatArray
    trial: FloatArray
    total: FloatArray
    rates: FloatArray
    left: FloatArray
    left_rates: FloatArray
    motion: FloatArray
    tail: FloatArray
    scratch: TangentScratch


@borrowing
def integrate_tangents(
    system: System, joints: Joints, time: FloatArray, jumps: BoolArray, start: FloatArray, directions: Directions,
    samples: Samples, work: TangentWorkspace, states: FloatArray, rates: FloatArray,
) -> int:  # fmt: skip
    """Integrate a rollout and its tangents; return the number of steps done before divergence.

    Args:
        system, joints, time, start, states, rates: as in `mjfish.ode.rollout.integrate`.
        jumps: (steps,) whether the joint rates jump, those of the motion or of a direction, before a step.
        directions: over the run.
        samples: where tangents are read.
        work: scratch; with the tangents of the start.
    """
    steps = time.shape[0] - 1
    state, trial, k = work.state.state, work.state.trial, work.state.rates
    copy(start, state)
    sample = 0
    for step in range(steps + 1):
        over = step == steps
        jump = step > 0 and (over or jumps[step])
        for phase in range(PHASE_END if jump else 0, PHASE_JUMP if over else 4):
            if phase <= 0:
                copy(state, trial)
                _copy_rows(work.tangents, work.trial)
            now, stage = sample_of(step, phase)
            at = joints_in(joints, now, stage, work.state)
            copy(system.tail, work.state.tail)
            _copy_rows(directions.motion[now, stage], work.motion)
            _copy_rows(directions.tail, work.tail)
            loads, changes = system.loads.addresses.shape[0], directions.loads.changes.shape[0]
            if phase == PHASE_JUMP:
                loads, changes = 0, 0
                rest(trial, work.state.tail)
                strike(joints, step, work.state)
                _jump_tangents(directions.motion[step - 1, 2], work)
            now_system = System(
                system.links, work.state.tail, system.printed,
                LoadTable(system.loads.addresses[:loads], system.loads.rows),
            )  # fmt: skip
            now_directions = Directions(
                work.tail, work.motion, directions.links,
                LoadChanges(
                    directions.loads.changes[:changes], directions.loads.addresses, directions.loads.active
                ),
                directions.length,
            )  # fmt: skip
            derivative(now_system, at, trial, work.state.output, k)
            tangent_rates(now_system, at, trial, k, work.trial, now_directions, work.scratch, work.rates)
            if phase == PHASE_JUMP:
                for row in (0, 1, 2, 7):
                    state[row] += k[row]
                    for i in range(work.tangents.shape[1]):
                        work.tangents[row, i] += work.rates[row, i]
                continue
            if phase == PHASE_END or (phase == 0 and step > 0 and not jump):
                copy(k, rates[step - 1, 1])
                sample = _read(step - 1, sample, time[step] - time[step - 1], samples, work)
            if phase == PHASE_END:
                continue
            if phase == 0:
                copy(state, states[step, 0])
                copy(k, rates[step, 0])
                _copy_rows(work.tangents, work.left)
                _copy_rows(work.rates, work.left_rates)
            h = time[step + 1] - time[step]
            advance(phase, h, k, work.state.total, trial, state)
            for row in range(work.tangents.shape[0]):
                advance(phase, h, work.rates[row], work.total[row], work.trial[row], work.tangents[row])
        if not over:
            copy(state, states[step, 1])
            if not (abs(state[0]) < DIVERGED and abs(state[1]) < DIVERGED and abs(state[2]) < DIVERGED):
                return step
    return int(steps)


@merged
def _copy_rows(source: FloatArray, target: FloatArray) -> None:
    for row in range(target.shape[0]):
        for k in range(target.shape[1]):
            target[row, k] = source[row, k]


@merged
def _jump_tangents(motion_before: FloatArray, work: TangentWorkspace) -> None:
    """Make tangents those of a fish at rest, with a loose tail, on whose joints a jump acts as an acceleration."""
    joints = work.state.joint_rate.shape[0]
    for row in (0, 1, 2, 3, 4, 7):
        work.trial[row] = 0.0
    work.tail[1:] = 0.0
    for j in range(joints):
        for k in range(work.motion.shape[1]):
            work.motion[2 * joints + j, k] = work.motion[joints + j, k] - motion_before[joints + j, k]
            work.motion[joints + j, k] = 0.0


@merged
def _read(step: int, sample: int, h: float, samples: Samples, work: TangentWorkspace) -> int:
    """Read the tangents at the samples within a step, as `Rollout.at` and `rate_at` do; return the first after it."""
    while sample < samples.step.shape[0] and samples.step[sample] == step:
        s = samples.place[sample]
        a = (1.0 + 2.0 * s) * (1.0 - s) ** 2
        b = s * (1.0 - s) ** 2 * h
        c = s**2 * (s - 1.0) * h
        for row in range(STATES):
            out = samples.values[sample, row]
            for k in range(out.shape[0]):
                out[k] = a * work.left[row, k] + b * work.left_rates[row, k]
            for k in range(out.shape[0]):
                out[k] += (1.0 - a) * work.tangents[row, k] + c * work.rates[row, k]
        for row in range(STATES, samples.values.shape[1]):
            rise = 6.0 * s * (1.0 - s) / h
            before, after = (1.0 - s) * (1.0 - 3.0 * s), s * (3.0 * s - 2.0)
            out = samples.values[sample, row]
            of = row - STATES
            for k in range(out.shape[0]):
                out[k] = rise * (work.tangents[of, k] - work.left[of, k])
                out[k] += before * work.left_rates[of, k] + after * work.rates[of, k]
        sample += 1
    return sample
