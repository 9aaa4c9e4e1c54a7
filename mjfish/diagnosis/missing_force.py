"""The missing force: the generalised force over time that the nominal model lacks, with its band.

This is a picture for the reader; no verdict rests on it.

[Rauch1965] H. Rauch, F. Tung, C. Striebel, Maximum likelihood estimates of linear dynamic systems, AIAA Journal 3.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mjfish.data.trial import for_looking
from mjfish.estimation import Noise, Problem
from mjfish.estimation.noise_of_fit import noise_sample, state_jacobians
from mjfish.files.plain_data import fields_of
from mjfish.fish import Fish, frames
from mjfish.fish.frames import CHANNELS
from mjfish.fish.outline import outlines
from mjfish.noise.autoregressive import grid
from mjfish.noise.selection import by_step
from mjfish.noise.spectral import ProcessNoise, process_noise
from mjfish.numerics.arrays import BoolArray, FloatArray, checked, readonly


@dataclass(frozen=True, eq=False)
class MissingForce:
    """What the nominal model lacks in one trial.

    Attributes:
        trial: its name.
        time: (n,) [s].
        force: (n, 3) along, across [N] and moment [N m] at the nose, in the head's forward frame.
        band: (n, 3) its standard deviation.
        driving: (3,) root mean square of what moves the simulated fish and its water, M v', in the same units.
    """

    trial: str
    time: FloatArray
    force: FloatArray
    band: FloatArray
    driving: FloatArray

    @property
    def share(self) -> FloatArray:
        """Root mean square of the missing force over that of the driving one (3,): how much it matters."""
        return np.asarray(np.sqrt(np.mean(self.force**2, axis=0)) / np.maximum(self.driving, 1e-300))

    def to_dict(self) -> dict[str, Any]:
        """Return it as ``diagnosis.json`` has it: with root mean squares of force and band, and the share."""
        rms, band_rms = (np.sqrt(np.mean(series**2, axis=0)) for series in (self.force, self.band))
        return {**fields_of(self), "units": ["N", "N", "N m"], "rms": rms, "band_rms": band_rms, "share": self.share}


def missing_force(problem: Problem, values: Mapping[str, float]) -> tuple[MissingForce, ...]:
    """Return the missing generalised force of every trial of a problem that was fitted, at its estimates by name.

    Random accelerations (`mjfish.noise.spectral`) are assumed behind the residual of the nominal model; a
    Kalman smoother [Rauch1965] estimates them from all samples of a run. Times the inertia of the stretched fish they
    are the force and the moment at the nose. The estimate is shrunk towards zero and its samples are correlated: it
    serves for pictures, never as data of a test.
    """
    left, jacobians = noise_sample(problem, problem.raw(problem.start(values))), state_jacobians(problem, values)
    found: dict[int, MissingForce] = {}
    for index in by_step(problem.trials).values():
        noise = process_noise(left.of_trials(index), jacobians)
        found.update({i: _of_trial(problem, i, values, noise, left.residuals[i]) for i in index})
    return tuple(found[i] for i in range(len(problem.trials)))


def with_velocities(problem: Problem, values: Mapping[str, float]) -> Problem | None:
    """Return a fitted problem for pictures: of places and headings, with the velocities of the smoothed path.

    Its channels weigh by what the fit leaves of them. None where a trial has no path.

    Args:
        problem: that was fitted; returned as it is where velocities were measured.
        values: estimates by name.
    """
    if problem.samples:
        return problem
    trials = tuple(for_looking(trial) for trial in problem.trials)
    if not all(trial.measured.all() for trial in trials):
        return None
    seen = replace(
        problem,
        trials=tuple(replace(trial, sensors=()) for trial in trials),
        noise=Noise.white(np.ones(len(CHANNELS))),
        joint_errors=None,
    )
    squares = np.square(np.concatenate(seen.raw(seen.start(values))))
    return replace(seen, noise=Noise.white(np.sqrt(squares.mean(axis=0))))


def _of_trial(
    problem: Problem, index: int, values: Mapping[str, float], noise: ProcessNoise, residual: FloatArray
) -> MissingForce:
    inertia = stretched(problem.model.fish, values)
    trial, mask = problem.trials[index], problem.mask(index)
    seen = grid(trial.time, mask)
    step = trial.step
    mean, covariance = _smoothed(noise, noise.jacobians[trial.name], step, seen, residual)
    variance = np.einsum("ij,njk,ik->ni", inertia, covariance, inertia)
    band = np.sqrt(np.maximum(variance, 0.0))  # next to nothing is left below 0 by rounding
    swum = problem.prediction(trial, values).rollout.rate_at(trial.time[mask])[:, :3] @ inertia.T
    return MissingForce(
        trial=trial.name,
        time=readonly(np.round(trial.time[0] + step * np.arange(len(seen)), 9)),
        force=readonly(np.round(mean @ inertia.T, 9)),
        band=readonly(np.round(band, 9)),
        driving=readonly(np.sqrt(np.mean(swum**2, axis=0))),
    )


def stretched(fish: Fish, values: Mapping[str, float]) -> FloatArray:
    """Return the inertia (3, 3) of the stretched fish with its added mass about the nose, in the forward frame.

    M = sum_i T_i' (M_i + M_ad,i) T_i, [Yu2016] eqs. (16)-(18) with all joints straight.
    """
    total, x = np.zeros((3, 3)), 0.0
    for link, outline in zip(fish.links, outlines(fish), strict=True):
        a0, a1, a2 = values[f"c_m.{link.group}"] * np.asarray(outline.added)
        across, first = link.mass + a0, link.mass * link.com + a1
        about = link.inertia + link.mass * link.com**2 + a2
        total += np.array(
            [
                [link.mass, 0.0, 0.0],
                [0.0, across, first + x * across],
                [0.0, first + x * across, about + 2.0 * x * first + x * x * across],
            ]
        )
        x += link.length
    signs = frames.flip(np.ones(3))
    return np.asarray(signs[:, None] * total * signs)


def _smoothed(
    noise: ProcessNoise, growing: FloatArray, step: float, seen: BoolArray, residual: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return mean (n, 3) and covariance (n, 3, 3) of the accelerations, given all samples."""
    n = len(seen)
    ahead, drive, p = noise.matrices(growing[:n], step)
    spread = np.diag(noise.sigma**2)
    mean, covariance = np.zeros((n, 6)), np.zeros((n, 6, 6))
    m = np.zeros(6)
    rows = np.cumsum(seen) - 1
    for t in range(n):
        if t > 0:
            m, p = ahead[t - 1] @ m, ahead[t - 1] @ p @ ahead[t - 1].T + drive
        if seen[t]:
            gain = np.linalg.solve(p[:3, :3] + spread, p[:3]).T
            m, p = m + gain @ (residual[rows[t]] - m[:3]), p - gain @ p[:3]
        mean[t], covariance[t] = m, p
    for t in range(n - 2, -1, -1):
        predicted = ahead[t] @ covariance[t] @ ahead[t].T + drive
        back = checked(np.linalg.lstsq(predicted, ahead[t] @ covariance[t])[0]).T
        mean[t] += back @ (mean[t + 1] - ahead[t] @ mean[t])
        covariance[t] += back @ (covariance[t + 1] - predicted) @ back.T
    return mean[:, 3:], covariance[:, 3:, 3:]
