"""Small synthetic datasets for fits: coefficients inside their bounds, straight modes, a few seconds each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from pike_coefficients import COEFFICIENTS

from mjfish.data import Dataset, Trial
from mjfish.estimation import Noise, Problem
from mjfish.fish import Fish
from mjfish.model import Model
from mjfish.numerics.arrays import FloatArray, readonly
from mjfish.simulation.synthetic import generate

SIGMA = np.array([0.01, 0.01, 0.05])
TRUTH = dict(zip(COEFFICIENTS, (0.5, 0.6, 0.4, 1.5, 1.2, 1.6, 0.01, 0.008, 0.012), strict=True))


def swimming(fish: Fish, modes: Sequence[str] = ("v1", "v3", "v5"), **changes: Any) -> Dataset:
    """Simulate short trials with `TRUTH`."""
    arguments: dict[str, Any] = {"values": TRUTH, "noise": SIGMA, "duration": 3.0, "seed": 3, **changes}
    return generate(fish, modes, **arguments)


def problem(dataset: Dataset, **changes: Any) -> Problem:
    """Pose the nominal fit of all trials that are not held out."""
    arguments: dict[str, Any] = {"free_clock": dataset.clock == "free", **changes}
    noise = arguments.pop("noise", Noise.white(readonly(SIGMA)))
    trials = tuple(trial for trial in dataset.trials if trial.role != "held_out")
    return Problem(arguments.pop("model", Model(dataset.fish)), trials, noise, **arguments)


def as_measured(trial: Trial, fish: Fish, *, start: float = 1.0, noise: float = 0.0, seed: int = 0) -> Trial:
    """Return `trial` from `start` on as if its joints had been measured; what the CPG did is forgotten.

    Args:
        trial: driven by the CPG.
        fish: whose CPG it is.
        start: time of the first sample [s].
        noise: sigma of the joint angles [rad].
        seed: of that noise.
    """
    late = trial.time >= start
    angle = Model(fish, step=0.001).predict(trial, fish.values).rollout.motion.angle_at(trial.time[late])
    noisy = angle + noise * np.random.default_rng(seed).standard_normal(angle.shape)
    return replace(
        trial,
        time=readonly(trial.time[late]),
        velocity=readonly(trial.velocity[late]),
        drive=(),
        joint_angle=readonly(noisy),
    )


def shifted(trial: Trial, samples: int) -> Trial:
    """Return `trial` with a velocity clock that is late: what is recorded at t happened `samples` steps after t."""
    kept = len(trial.time) - samples
    return replace(trial, time=trial.time[:kept], velocity=readonly(trial.velocity[samples:]))


def off_truth(estimates: dict[str, float], errors: dict[str, float]) -> FloatArray:
    """Return how many standard errors each coefficient is off."""
    return np.array([(estimates[name] - TRUTH[name]) / errors[name] for name in COEFFICIENTS])
