"""Cross-check of the two engines.

`check` feeds the ODE the joint motion that MuJoCo realised: it must swim as MuJoCo did. The engines share the force on
a strip and nothing else: MuJoCo has its own rigid-body dynamics and moves its joints by servos. Where both are right,
their velocities differ by the error of their steps, which falls as the step is halved; a missing or wrong term stays.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Literal

import numpy as np

from mjfish import ode
from mjfish.data import Trial
from mjfish.drive import cpg, modes
from mjfish.errors import InputError
from mjfish.files.result import Result
from mjfish.fish import Cpg, Fish
from mjfish.fish.frames import CHANNELS
from mjfish.model.extended import Extended, load
from mjfish.model.model import LoadsOfRun
from mjfish.mujoco import simulate
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
    loads = loads_of_mode(extended, mode, duration)
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
        difference = np.abs(same.at_steps()[:, : len(CHANNELS)] - run.velocity).max(axis=0)
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


def loads_of_mode(extended: Extended, mode: str, duration: float) -> LoadsOfRun:
    """Return the loads of the run of a mode over a duration [s], a trial without measurements.

    Raises:
        UnknownNameError: no such mode; the known ones are listed.
        InputError: the run cannot have an effect.
    """
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
