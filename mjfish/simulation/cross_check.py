"""Cross-checks of the two engines.

`check` feeds the ODE the joint motion that MuJoCo realised: it must swim as MuJoCo did. The engines share the force on
a strip and nothing else: MuJoCo has its own rigid-body dynamics and moves its joints by servos. Where both are right,
their velocities differ by the error of their steps, which falls as the step is halved; a missing or wrong term stays.

`check_all` gives every engine the same prescribed joint motion: the ODE, and MuJoCo by every coupling and integrator.
The yardstick is the ODE at a fine step; where a folder of reference trajectories is given (CSV files of another
formulation, one a case), every run is compared with these too. An engine is right where its error falls as its order
says, and nothing is left when the order is used to extrapolate to a vanishing step.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Literal

import numpy as np

from mjfish import ode
from mjfish.data import Trial, columns, read_table
from mjfish.data.cells import check_increasing
from mjfish.drive import cpg, modes
from mjfish.drive.motion import JointMotion
from mjfish.errors import InputError
from mjfish.files.result import Result
from mjfish.fish import Cpg, Fish, load_fish
from mjfish.fish.frames import CHANNELS
from mjfish.model.extended import Extended, load
from mjfish.model.model import LoadsOfRun
from mjfish.mujoco import prescribed, simulate
from mjfish.mujoco.coupling_choice import Coupling
from mjfish.mujoco.mjcf import Integrator
from mjfish.numerics.arrays import FloatArray, readonly
from mjfish.ode.rollout import Coriolis
from mjfish.simulation.run import check_can_act, sample_times

#: Largest difference at the first step, relative to the range of the channel.
BOUND = 1e-3
#: Smallest order at which the difference must fall; engines of second order show it within rounding.
ORDER = 1.9
#: A difference this small is rounding, and has no order.
_ROUNDING = 1e-10
#: Most halvings of the step.
_HALVINGS = 10


@dataclass(frozen=True)
class Level:
    """Differences at one step.

    Attributes:
        step: [s].
        difference: largest difference of each channel over the run, by name, in its unit.
        ratio: the same relative to the channel's range in MuJoCo.
    """

    step: float
    difference: dict[str, float]
    ratio: dict[str, float]

    @property
    def worst(self) -> float:
        """The largest ratio."""
        return max(self.ratio.values())


@dataclass(frozen=True)
class CrossCheck(Result):
    """What the cross-check found.

    Attributes:
        fish: its name.
        drive: name of the mode.
        coriolis: form of the gyroscopic terms in the ODE.
        range: of each channel in MuJoCo over the run, by name.
        levels: one a step, longest first.
        orders: observed order of the worst ratio from each level to the next.
        bound: that the worst ratio of the first level must not reach.
        status: ``agrees``, ``disagrees``, or ``diverged`` where a run did.
        message: one sentence.
    """

    fish: str
    drive: str
    coriolis: Coriolis
    range: dict[str, float]
    levels: tuple[Level, ...]
    orders: tuple[float, ...]
    bound: float
    status: Literal["agrees", "disagrees", "diverged"]
    message: str

    @property
    def passed(self) -> bool:
        """Whether the engines agree."""
        return self.status == "agrees"

    def summary(self) -> str:
        """Return whether the engines agree, and how far they differ at each step."""
        lines = [f"  step {1e3 * level.step:g} ms: {level.worst:.1e} of the range" for level in self.levels]
        return "\n".join([f"{self.fish}, {self.drive}: {self.status}, {self.message}", *lines[:9]])


def check(
    fish: Fish | str | Path | Extended,
    mode: str = "v1",
    *,
    values: Mapping[str, float] | None = None,
    coriolis: Coriolis = "corrected",
    duration: float = modes.DURATION,
    step: float = 0.001,
    halvings: int = 2,
    bound: float = BOUND,
) -> CrossCheck:
    """Run both engines on the same joint motion and compare the velocities of the nose.

    Args:
        fish: the fish, the name of a shipped one, a fish TOML, or a fish with effects; it needs a CPG.
        mode: of Table IV.
        values: coefficients by name that replace the fish's.
        coriolis: ``printed`` shows that the paper's printed form disagrees with MuJoCo.
        duration: [s].
        step: longest step [s].
        halvings: how often the step is halved to observe the order.
        bound: on the largest difference relative to the channel's range, at the longest step.

    Returns:
        Largest differences per channel [m/s, rad/s] at each step, their order, and whether the engines agree.

    Raises:
        UnknownNameError: no such fish, mode or coefficient; the known ones are listed.
        InputError: the fish has no CPG, or an effect that such a run cannot have.

    Example:
        >>> import mjfish
        >>> found = mjfish.check("pike", "v1", duration=0.5, halvings=1)
        >>> found.passed
        True
        >>> print(found)
        pike, v1: agrees, ...
          step 1 ms: ... of the range
          step 0.5 ms: ... of the range
    """
    if not (0.0 < step < math.inf and 0 <= halvings <= _HALVINGS and bound > 0.0):
        raise InputError(
            f"step {step:g} s, {halvings} halvings, bound {bound:g}: expected a step and a bound above 0 and at most "
            f"{_HALVINGS} halvings; correct them"
        )
    sample_times(duration, 2**halvings / step)  # refuses what does not end
    extended = fish if isinstance(fish, Extended) else load(fish)
    body, law, segments = extended.fish, cpg_of(extended.fish), modes.drive(mode, extended.fish.joints)
    loads = _loads(extended, mode, duration)
    levels: list[Level] = []
    span = dict.fromkeys(CHANNELS, math.nan)
    message = ""
    for halving in range(halvings + 1):
        command = cpg.joint_motion(law, segments, duration, step / 2**halving)
        run = simulate(body, extended.drive(command), values=values, loads=loads)
        same = ode.simulate(body, run.motion(), values=values, coriolis=coriolis, loads=loads)
        message = run.message or same.message
        if message:
            break
        at_ends = np.concatenate([same.state[:, 0], same.state[-1:, 1]])[:, : len(CHANNELS)]
        difference = np.abs(at_ends - run.velocity).max(axis=0)
        reach = np.ptp(run.velocity, axis=0)
        span = _by_channel(reach)
        levels.append(Level(step / 2**halving, _by_channel(difference), _by_channel(difference / reach)))
    worst = [level.worst for level in levels]
    orders = tuple(math.log2(a / b) if b > _ROUNDING else math.inf for a, b in pairwise(worst))
    agree = not message and levels[0].worst < bound and all(order > ORDER for order in orders)
    return CrossCheck(
        fish=body.name,
        drive=mode,
        coriolis=coriolis,
        range=span,
        levels=tuple(levels),
        orders=orders,
        bound=bound,
        status="diverged" if message else "agrees" if agree else "disagrees",
        message=message or _message(levels, orders, bound),
    )


def _loads(extended: Extended, mode: str, duration: float) -> LoadsOfRun:
    """Return the loads of the run of a mode, a trial without measurements."""
    segments = modes.drive(mode, extended.fish.joints)
    trial = Trial(mode, None, readonly([0.0, duration]), readonly(np.zeros((2, 3))), segments)
    check_can_act(extended.model.effects, trial)
    return extended.loads(trial)


def _by_channel(numbers: FloatArray) -> dict[str, float]:
    return dict(zip(CHANNELS, numbers.tolist(), strict=True))


def _message(levels: list[Level], orders: tuple[float, ...], bound: float) -> str:
    worst = max(levels[0].ratio, key=lambda channel: levels[0].ratio[channel])
    verb = "falls" if all(order > ORDER for order in orders) else "does not fall as it must,"
    shrinks = f"; as the step is halved it {verb} at order {min(orders):.1f}" if orders else ""
    return (
        f"largest difference {levels[0].worst:.1e} of the range, in {worst} "
        f"({levels[0].worst / bound:.2g} of the bound {bound:g}){shrinks}"
    )


def cpg_of(fish: Fish) -> Cpg:
    """Return the CPG of a fish, or raise `InputError` where it has none."""
    if fish.cpg is None:
        raise InputError(f"fish '{fish.name}' has no CPG to drive it; add [cpg] to its TOML")
    return fish.cpg


#: Longer step of an engine by its order [s]; the shorter is half of it.
STEPS = {4: 0.002, 1: 0.001}
#: Step of the yardstick [s].
FINE = 0.00025
#: Largest difference that extrapolation may leave, relative to a channel's range.
LEFT = 1e-3
#: How far the observed order may lie below the claimed one: drag is only once differentiable where a strip stops.
SLACK = 0.5
#: An rms difference this small, relative to the range, is the yardstick's own, and has no order.
_FLOOR = 1e-9


@dataclass(frozen=True)
class Case:
    """A run of the pike to compare on.

    Attributes:
        name: also of its reference trajectory, NAME.csv.
        mode: of Table IV.
        coefficients: in the order of those of the pike.
        munk: share of the Munk moment.
    """

    name: str
    mode: str
    coefficients: tuple[float, ...]
    munk: float

    @property
    def values(self) -> dict[str, float]:
        """The coefficients by name."""
        return dict(zip(load_fish("pike").coefficient_names, self.coefficients, strict=True))


_PUBLISHED = (0.01, 0.07, 0.06, 4.0, 1.5, 2.5, 0.02, 0.02, 0.02)
#: Table III's lambda* straight and slowing down, another optimum in a turn, all coefficients one with the Munk moment.
CASES = (
    Case("v1_published", "v1", _PUBLISHED, 0.0),
    Case("v5-v1_published", "v5-v1", _PUBLISHED, 0.0),
    Case("v3-t2_alternative", "v3-t2", (3.0, 0.01, 0.40, 4.0, 0.1, 0.18, 0.02, 0.010, 0.009), 0.0),
    Case("v1-t1_unit_munk", "v1-t1", (1.0,) * 6 + (0.01,) * 3, 1.0),
)


@dataclass(frozen=True)
class Row(Result):
    """One engine on one case.

    Attributes:
        engine: ``ODE`` or ``MuJoCo``.
        coupling, integrator: of the engine.
        case, mode: of the run.
        step: the shorter of its two steps [s].
        to_ode: largest difference to the ODE at that step, relative to the channel's range.
        to_reference: largest difference to the reference trajectory [m/s, rad/s]; NaN where there is none.
        order: of the rms difference, observed from twice the step to the step; infinite where it is rounding.
        claimed: order of the integrator.
        left: largest difference after extrapolation, relative to the channel's range.
        status: ``agrees``, ``disagrees`` or ``diverged``.
    """

    engine: Literal["ODE", "MuJoCo"]
    coupling: str
    integrator: str
    case: str
    mode: str
    step: float
    to_ode: float
    to_reference: float
    order: float
    claimed: int
    left: float
    status: Literal["agrees", "disagrees", "diverged"]

    @property
    def passed(self) -> bool:
        """Whether the engine agrees."""
        return self.status == "agrees"

    def summary(self) -> str:
        """Return the engine, its case, and how far it is from the ODE."""
        engine = " ".join(word for word in (self.engine, self.coupling, self.integrator) if word != "-")
        return (
            f"{engine}, {self.case}: {self.status}, {self.to_ode:.1e} of the range from the ODE, order {self.order:.1f}"
        )


Engine = tuple[Literal["ODE", "MuJoCo"], Coupling | None, Integrator, int]
#: Engine, coupling, integrator and its order. ``xfrc`` is refused under the implicit integrators.
ENGINES: tuple[Engine, ...] = (
    ("ODE", None, "RK4", 4),
    ("MuJoCo", "inertia", "RK4", 4),
    ("MuJoCo", "xfrc", "RK4", 4),
    ("MuJoCo", "inertia", "Euler", 1),
    ("MuJoCo", "xfrc", "Euler", 1),
    ("MuJoCo", "inertia", "implicitfast", 1),
    ("MuJoCo", "inertia", "implicit", 1),
    ("MuJoCo", "inertia", "discrete", 1),
)


def check_all(
    fish: Fish | Extended,
    *,
    cases: tuple[Case, ...] = CASES,
    reference: Path | None = None,
    duration: float = modes.DURATION,
    tell: Callable[[str, float], None] | None = None,
) -> Iterator[Row]:
    """Compare every engine on every case, one row each.

    Args:
        fish: with a CPG, and effects or none; the cases add to its share of the Munk moment. Reference trajectories
            are the pike's.
        cases: runs.
        reference: folder of the reference trajectories; None: not compared.
        duration: [s].
        tell: called with what comes next and the share that is done.

    Raises:
        InputError: the fish has no CPG, or a reference trajectory is missing.
    """
    extended = fish if isinstance(fish, Extended) else load(fish)
    fish = extended.fish
    cpg_of(fish)
    expected = {case.name: _read(reference, case) for case in cases}
    for done, case in enumerate(cases):
        body = fish.model_copy(update={"munk_moment": fish.munk_moment + case.munk})
        asked = functools.partial(_motion, extended, modes.drive(case.mode, fish.joints), duration)
        loads = _loads(extended, case.mode, duration)
        truth = ode.simulate(body, asked(FINE), values=case.values, loads=loads)
        for index, engine in enumerate(ENGINES):
            if tell is not None:
                tell(f"{case.mode}: {engine[0]} {engine[2]}", (done + index / len(ENGINES)) / len(cases))
            steps = (STEPS[engine[3]], STEPS[engine[3]] / 2)
            yield _row(engine, body, case, [asked(step) for step in steps], truth, expected[case.name], loads)


def _motion(extended: Extended, segments: tuple[cpg.DriveSegment, ...], duration: float, step: float) -> JointMotion:
    return extended.drive(cpg.joint_motion(cpg_of(extended.fish), segments, duration, step))


def _row(
    engine: Engine,
    fish: Fish,
    case: Case,
    motions: list[JointMotion],
    truth: ode.Rollout,
    expected: FloatArray | None,
    loads: LoadsOfRun,
) -> Row:
    name, coupling, integrator, claimed = engine
    runs = [_run(engine, fish, case, motion, loads) for motion in motions]
    reach = np.ptp(truth.at(motions[1].time)[:, : len(CHANNELS)], axis=0)
    order = left = to_ode = to_reference = math.nan
    status: Literal["agrees", "disagrees", "diverged"] = "diverged"
    if all(len(run) == len(motion.time) for run, motion in zip(runs, motions, strict=True)):
        coarse, fine = (
            (run - truth.at(motion.time)[:, : len(CHANNELS)]) / reach for run, motion in zip(runs, motions, strict=True)
        )
        shared = np.searchsorted(motions[1].time, motions[0].time - 1e-9)
        to_ode = float(np.abs(fine).max())
        left = float(np.abs((2**claimed * fine[shared] - coarse) / (2**claimed - 1)).max())
        order = math.log2(_rms(coarse) / _rms(fine)) if _rms(fine) > _FLOOR else math.inf
        status = "agrees" if order > claimed - SLACK and left < LEFT else "disagrees"
        if expected is not None:
            at = np.searchsorted(motions[1].time, expected[:, 0] - 1e-9)
            inside = at < len(motions[1].time)
            if inside.any():
                to_reference = float(np.abs(runs[1][at[inside]] - expected[inside, 1:]).max())
    return Row(
        engine=name, coupling=coupling or "-", integrator=integrator, case=case.name, mode=case.mode,
        step=float(np.diff(motions[1].time).max()), to_ode=to_ode, to_reference=to_reference, order=order,
        claimed=claimed, left=left, status=status,
    )  # fmt: skip


def _rms(difference: FloatArray) -> float:
    """Return the rms over the run of the worst channel; a largest difference has no clean order at kinks of drag."""
    return float(np.sqrt(np.mean(difference**2, axis=0)).max())


def _run(engine: Engine, fish: Fish, case: Case, motion: JointMotion, loads: LoadsOfRun) -> FloatArray:
    """Return the velocity (n, 3) at the boundaries of the steps; shorter where the run diverged."""
    name, coupling, integrator, _ = engine
    if name == "ODE":
        rollout = ode.simulate(fish, motion, values=case.values, loads=loads)
        return rollout.at(rollout.time)[:, : len(CHANNELS)] if rollout.status == "ok" else np.empty((0, len(CHANNELS)))
    run = prescribed.simulate(fish, motion, values=case.values, integrator=integrator, coupling=coupling, loads=loads)
    return run.velocity if run.status == "ok" else np.empty((0, len(CHANNELS)))


def _read(folder: Path | None, case: Case) -> FloatArray | None:
    """Return time, surge, sway and yaw rate (n, 4) of a case's reference trajectory."""
    if folder is None:
        return None
    path = folder / f"{case.name}.csv"
    table = read_table(path)
    for name in ("time", *CHANNELS):
        if name not in table:
            raise InputError(f"{path}: column '{columns.header(name)}' is missing; add it")
    check_increasing(table["time"], path)
    return np.stack([table[name] for name in ("time", *CHANNELS)], axis=1)
