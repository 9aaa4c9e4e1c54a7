"""One case before it is measured: fish, coefficients, plan, noise; and how its noise-free runs are computed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BSpline

from mjfish import new_fish
from mjfish.errors import InputError
from mjfish.fish import Fish, load_fish
from mjfish.numerics.arrays import FloatArray
from studies.battery.generator import camera, noise, plans, world
from studies.battery.generator.world import COARSE, Accuracy, Disturbance

#: Seeds of the splits: what tunes a threshold never sees a seed of the test.
SPLITS = {"open": 0, "calibration": 1_000_000, "test": 2_000_000}

#: Joints of the pike.
PIKE = 4


@dataclass(frozen=True, eq=False)
class Draft:
    """A case without its effect.

    Attributes:
        seed, split: drawn from; `rng`: goes on where the draft ended.
        fish: nominal.
        theta: true coefficients by name.
        plan: runs.
        noise: of the camera.
        kept: by run, which frames (n,) are there.
    """

    seed: int
    split: str
    rng: np.random.Generator
    fish: Fish
    theta: dict[str, float]
    plan: plans.Plan
    noise: noise.Noise
    kept: tuple[np.ndarray, ...]

    def time(self, number: int) -> FloatArray:
        """Return the times of all frames of a run, lost ones too [s]."""
        return np.arange(round(self.plan.runs[number].duration * self.noise.rate) + 1) / self.noise.rate

    def motion(
        self,
        number: int,
        psi: Mapping[str, float],
        accuracy: Accuracy = COARSE,
        theta: Mapping[str, float] | None = None,
        disturbance: Disturbance | None = None,
        joints: BSpline | None = None,
    ) -> world.Motion:
        """Let run `number` swim."""
        run, coefficients = self.plan.runs[number], self.theta if theta is None else theta
        return world.swim(self.fish, run, coefficients, psi, accuracy, disturbance, joints)

    def clean(
        self,
        number: int,
        psi: Mapping[str, float],
        accuracy: Accuracy = COARSE,
        theta: Mapping[str, float] | None = None,
        disturbance: Disturbance | None = None,
        joints: BSpline | None = None,
    ) -> FloatArray:
        """Return what is measured in a run without noise (n, 3), at the frames that are there."""
        moved = self.motion(number, psi, accuracy, theta, disturbance, joints)
        return self.seen(number, moved, psi)

    def seen(self, number: int, moved: world.Motion, psi: Mapping[str, float]) -> FloatArray:
        """Return what is measured of a motion without noise: read, or differentiated from the path; poses as such."""
        run, time = self.plan.runs[number], self.time(number)
        if self.noise.kind == "poses":
            return camera.places(moved, run, psi, time)
        if self.noise.kind == "differentiated_path":
            return measured_by_path(self.noise, camera.pose(moved, run, psi, time))
        return camera.velocity(moved, run, psi, time)[self.kept[number]]


def swimmer(joints: int) -> Fish:
    """Return the pike, or a fish of another number of joints, made from its measurements as a user would."""
    if joints == PIKE:
        return load_fish("pike")
    return new_fish(f"{joints} joints", length=0.5, mass=1.2, joints=joints, height=0.08)


def measured_by_path(how: noise.Noise, path: FloatArray) -> FloatArray:
    """Return the velocities (n, 3) of a path of all frames (m, 3): differentiated, turned by the smoothed heading."""
    samples = (len(path) - 1) // camera.FINER + 1
    rate = noise.differentiator(samples, how.window, how.order, how.finer) @ path
    yaw = noise.smoother(samples, how.window, how.order, how.finer) @ path[:, 2]
    c, s = np.cos(yaw), np.sin(yaw)
    return np.column_stack([c * rate[:, 0] + s * rate[:, 1], c * rate[:, 1] - s * rate[:, 0], rate[:, 2]])


def draft(
    seed: int,
    split: str = "open",
    *,
    noise_kind: noise.Kind | None = None,
    level: float | None = None,
    pose: bool | None = None,
    roll: bool | None = None,
    runs: int | None = None,
    bound: bool = False,
    joints: int = PIKE,
) -> Draft:
    """Draw a case without its effect; see `studies.battery.generator.case.scaled_case` for the arguments."""
    if not 0 <= seed < 1_000_000:
        raise InputError(f"seed is {seed}, expected 0 to 999999: the splits are a million apart")
    rng = np.random.default_rng(SPLITS[split] + seed)
    fish = swimmer(joints)
    theta = {}
    for parameter in fish.parameters:
        low, high = 1.02 * parameter.low, 0.98 * parameter.high
        theta[parameter.name] = float(np.clip(parameter.start * rng.uniform(0.8, 1.2), low, high))
    if bound:
        parameter = fish.parameters[int(rng.integers(len(fish.parameters)))]
        theta[parameter.name] = parameter.high if rng.random() < 0.5 else parameter.low
    plan = plans.draw(rng, pose=pose, roll=roll, runs=runs, joints=joints)
    how = noise.draw(rng, noise_kind, level)
    kept = tuple(noise.kept(how, round(run.duration * how.rate) + 1, rng) for run in plan.runs)
    return Draft(seed, split, rng, fish, theta, plan, how, kept)
