"""One run of the sealed world: drive and body in, what really happened out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import BSpline, CubicHermiteSpline

from mjfish.errors import InputError
from mjfish.fish import Fish
from mjfish.numerics.arrays import FloatArray
from studies.battery.generator import body as bodies
from studies.battery.generator import classes, momentum, oscillator, servos
from studies.battery.generator.plans import Run
from studies.battery.generator.water import W, numbers


@dataclass(frozen=True)
class Accuracy:
    """How finely a run is computed: step [s] and strips a link."""

    step: float
    strips: int


FINE = Accuracy(0.001, bodies.FINE)
COARSE = Accuracy(0.004, bodies.COARSE)
#: The drive goes on behind the last sample: a clock may be ahead [s].
LEAD = 0.3
#: A hardening tail bends about so far [rad].
_BENT = 0.1


@dataclass(frozen=True, eq=False)
class Disturbance:
    """Force noise on the nose: (m, 3) F_x, F_y [N], M_z [N m] in world axes, every `every` seconds from 0 on."""

    every: float
    push: FloatArray


@dataclass(frozen=True, eq=False)
class Motion:
    """What happened: nodes of every stretch (times after times, the last of one is the first of the next).

    Attributes:
        stretches: (times (n + 1,), columns (n + 1, k)): those of `momentum`, in the forward frame.
    """

    stretches: tuple[tuple[FloatArray, FloatArray], ...]

    def at(self, time: FloatArray) -> FloatArray:
        """Return columns (m, k) at `time`: cubic through four nodes of a stretch; before the start, the start."""
        starts = np.array([times[0] for times, _ in self.stretches])
        which = np.clip(np.searchsorted(starts, time + 1e-9, side="right") - 1, 0, len(starts) - 1)
        found = np.empty((len(time), self.stretches[0][1].shape[1]))
        for number, (times, values) in enumerate(self.stretches):
            here = which == number
            h = times[1] - times[0]
            s = np.clip((time[here] - times[0]) / h, 0.0, len(times) - 1.0)
            left = np.clip(np.floor(s).astype(int) - 1, 0, max(len(times) - 4, 0))
            x = s - left
            weights = (
                -(x - 1.0) * (x - 2.0) * (x - 3.0) / 6.0,
                x * (x - 2.0) * (x - 3.0) / 2.0,
                -x * (x - 1.0) * (x - 3.0) / 2.0,
                x * (x - 1.0) * (x - 2.0) / 6.0,
            )
            found[here] = sum(weight[:, None] * values[left + j] for j, weight in enumerate(weights))
        return found


def swim(
    fish: Fish,
    run: Run,
    theta: Mapping[str, float],
    psi: Mapping[str, float],
    accuracy: Accuracy = FINE,
    disturbance: Disturbance | None = None,
    joints: BSpline | None = None,
) -> Motion:
    """Let the fish swim.

    Args:
        fish: geometry and masses.
        run: what is asked.
        theta: the nine coefficients by name.
        psi: sizes of effects, by the generator's names.
        accuracy: step and strips.
        disturbance: force noise.
        joints: angles of all joints over time; None: those of the CPG and the servos.

    Raises:
        FloatingPointError: the run diverged.
    """
    if fish.cpg is None:
        raise InputError(f"{fish.name} has no CPG, expected a fish that has; take the pike")
    body = bodies.body(fish, theta, psi, accuracy.strips)
    w = numbers(**classes.water(fish, psi))
    step = _step(accuracy.step, body, w)
    got = servos.joints(oscillator.command(fish.cpg, run.drive, run.duration + LEAD, step), run, psi)
    got = got if joints is None else tuple(_recorded(part, joints) for part in got)
    state = np.zeros(momentum.STATES)
    state[:3] = -run.start[0], -run.start[1], run.start[2]
    momentum.rest(body.links, got[0].angle[0, 0], got[0].rate[0, 0], state)
    stretches = []
    for part in got:
        times = part.start + part.step * np.arange(part.steps + 1)
        out = np.empty((part.steps + 1, momentum.OUTPUTS))
        middles = part.start + 0.5 * part.step * np.arange(2 * part.steps + 1)
        push = _push(run, psi, middles, disturbance)
        if not momentum.swim(
            body.links,
            body.r,
            body.across,
            body.side,
            body.height,
            body.ring,
            part.angle,
            part.rate,
            part.start,
            part.step,
            state,
            push,
            w,
            out,
        ):
            raise FloatingPointError(f"run {run.name} diverged with {psi}")
        out[:, [0, 1, 3, 4, 7]] *= -1.0  # half a turn: from nose to tail, to forward
        stretches.append((times, out))
    return Motion(tuple(stretches))


def _recorded(part: oscillator.Stretch, joints: BSpline) -> oscillator.Stretch:
    """Return a stretch whose joints move as a spline says, and stay where it ends."""
    nodes, end = servos.nodes(part), joints.t[-1]
    inside = (nodes <= end)[..., None]
    return replace(part, angle=joints(np.minimum(nodes, end)), rate=inside * joints(np.minimum(nodes, end), 1))


def angles(fish: Fish, run: Run, psi: Mapping[str, float], time: FloatArray) -> FloatArray:
    """Return the joint angles (n, joints) [rad] at some times: those reached, or those asked for where `psi` is empty.

    Raises:
        InputError: the fish has no CPG.
    """
    if fish.cpg is None:
        raise InputError(f"{fish.name} has no CPG, expected a fish that has; take the pike")
    asked = oscillator.command(fish.cpg, run.drive, run.duration + LEAD, FINE.step)
    found = np.empty((len(time), fish.joints))
    for part in servos.joints(asked, run, psi):
        nodes = part.start + part.step * np.arange(part.steps + 1)
        angle, rate = (np.concatenate([of[:, 0], of[-1:, 2]]) for of in (part.angle, part.rate))
        here = time >= part.start
        found[here] = CubicHermiteSpline(nodes, angle, rate)(np.minimum(time[here], nodes[-1]))
    return found


def _push(run: Run, psi: Mapping[str, float], time: FloatArray, disturbance: Disturbance | None) -> FloatArray:
    """Return what pushes the nose (m, 3) besides the water's laws: force noise, and what the run before left behind."""
    push = np.zeros((len(time), 3))
    if disturbance is not None:
        nodes = disturbance.every * np.arange(len(disturbance.push))
        push += np.column_stack([np.interp(time, nodes, column) for column in disturbance.push.T])
    if psi.get("run_order.size"):
        swirl = (-1.0) ** run.number * min(run.number, 1) * np.exp(-time / 2.0)
        push[:, 2] += psi["run_order.size"] * swirl
        push[:, 1] += 20.0 * psi["run_order.size"] * swirl
    return push


def _step(step: float, body: bodies.Body, w: FloatArray) -> float:
    """Halve the step until it resolves the spring of the tail, whose inertia is halved by the recoil of the rest."""
    if w[W["stiffness"]] <= 0.0:
        return step
    _, mass, com, inertia, _, _, added = body.links[-1, :7]
    moving = 0.5 * (inertia + mass * com**2 + added)
    drag = 2.0 * float(np.sum(body.across[-1] * body.r[-1] ** 2))  # at 1 m/s
    harder = 1.0 + 3.0 * w[W["tail_hardening"]] * _BENT**2 + w[W["tail_gain"]]
    rate = np.sqrt(harder * w[W["stiffness"]] / moving) + (w[W["damping"]] + drag) / moving
    return float(step / 2 ** min(max(int(np.ceil(np.log2(step * rate / 1.0))), 0), 6))
