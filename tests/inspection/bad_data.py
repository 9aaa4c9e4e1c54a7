"""A good dataset, and ways to spoil it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
from true_values import TRUTH

from mjfish.data import Dataset, Trial
from mjfish.fish import load_fish
from mjfish.inspection import Finding, Inspection
from mjfish.model import Model
from mjfish.numerics.arrays import FloatArray, readonly
from mjfish.simulation.synthetic import generate

MODES = ("v1", "v3", "v5", "v1-t1", "v3-t2", "v1")
SIGMA = np.array([0.006, 0.006, 0.04])


@cache
def good(modes: tuple[str, ...] = MODES, seed: int = 5, duration: float = 7.2) -> Dataset:
    """Generate swimming of several drives, one of them twice; v3 and v3-t2 are held out where they are there."""
    held = [mode for mode in ("v3", "v3-t2") if mode in modes]
    return generate(
        load_fish("pike"), modes, values=TRUTH, noise=SIGMA, duration=duration, seed=seed, held_out=held, name="good"
    )


def spoiled(change: Callable[[Trial], Trial], *names: str, dataset: Dataset | None = None) -> Dataset:
    """Return the good dataset with some of its trials changed; without names, all."""
    base = good() if dataset is None else dataset
    return replace(base, trials=tuple(change(t) if not names or t.name in names else t for t in base.trials))


def velocity(change: Callable[[FloatArray], FloatArray]) -> Callable[[Trial], Trial]:
    """Return a change of trials from one of their velocities (n, 3)."""
    return lambda trial: replace(trial, velocity=readonly(change(trial.velocity.copy())))


def rows(keep: Callable[[Trial], Any]) -> Callable[[Trial], Trial]:
    """Return a change of trials that keeps some of their rows, with the times they were measured at."""

    def change(trial: Trial) -> Trial:
        kept = keep(trial)
        return replace(trial, time=readonly(trial.time[kept]), velocity=readonly(trial.velocity[kept]))

    return change


def with_pose(dataset: Dataset, noise: tuple[float, float, float] = (0.001, 0.001, 0.003), seed: int = 1) -> Dataset:
    """Return the dataset with the pose of the same swimming, from a camera with noise of its own."""
    rng = np.random.default_rng(seed)
    model = Model(dataset.fish)

    def posed(trial: Trial) -> Trial:
        state = model.predict(trial, model.values(TRUTH)).rollout.at(trial.time)
        return replace(trial, pose=readonly(state[:, 3:6] + rng.standard_normal((len(state), 3)) * noise))

    return replace(dataset, trials=tuple(map(posed, dataset.trials)))


def wrong(found: Inspection) -> list[Finding]:
    """Return what is more than a remark."""
    return [finding for finding in found.findings if finding.severity != "remark"]


def only(found: Inspection, code: str) -> Finding:
    """Return the one finding that is more than a remark, whose code must begin with `code`."""
    one = wrong(found)
    assert [finding.code.startswith(code) for finding in one] == [True], [finding.message for finding in one]
    return one[0]


def remarked(found: Inspection, code: str) -> list[Finding]:
    """Return the remarks whose code begins with `code`."""
    return [finding for finding in found.findings if finding.severity == "remark" and finding.code.startswith(code)]
