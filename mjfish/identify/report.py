"""``identify`` as one call: dataset in, fitted coefficients with what the data say about them out."""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mjfish.arrays import FloatArray
from mjfish.identify.fit import Fit, fit
from mjfish.identify.noise import Noise, floor
from mjfish.identify.problem import Problem
from mjfish.identify.score import predict_held_out
from mjfish.model import Model
from mjfish.trial import Dataset, Trial


@dataclass(frozen=True)
class TrialScore:
    """nRMSE of one trial, (surge, sway, yaw_rate)."""

    trial: str
    role: str
    nrmse: tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class Identification:
    """Fitted coefficients.

    Attributes:
        dataset: that was fitted.
        fit: estimates, standard errors, bounds, status.
        noise: sigma (3,) of the measured velocities that the weights are made of.
        scores: of every trial; held-out ones without what their own nuisance parameters were fitted on.
        remarks: what a reader should know.
    """

    dataset: Dataset
    fit: Fit
    noise: FloatArray
    scores: tuple[TrialScore, ...]
    remarks: tuple[str, ...]

    def strong_correlations(self, limit: float) -> list[tuple[str, str, float]]:
        """Return pairs of estimates that are correlated beyond `limit`, strongest first."""
        names, matrix = [p.name for p in self.fit.parameters], self.fit.correlation
        pairs = [(names[i], names[j], float(matrix[i, j])) for i in range(len(names)) for j in range(i)]
        return sorted((pair for pair in pairs if abs(pair[2]) > limit), key=lambda pair: -abs(pair[2]))

    def to_dict(self) -> dict[str, Any]:
        """Return the identification as plain data."""
        one = self.fit
        return {
            "schema": 1,
            "dataset": self.dataset.name,
            "status": one.status,
            "message": one.message,
            "evaluations": one.evaluations,
            "cost": one.sse,
            "samples": len(one.residual),
            "noise": self.noise.tolist(),
            "parameters": {
                p.name: {
                    "estimate": one.values[p.name],
                    "standard_error": one.sigma[p.name],
                    "low": one.interval(p.name)[0],
                    "high": one.interval(p.name)[1],
                    "unit": p.unit,
                    "at_bound": bool(at_bound),
                }
                for p, at_bound in zip(one.parameters, one.at_bound, strict=True)
            },
            "correlation": {"names": [p.name for p in one.parameters], "matrix": one.correlation.tolist()},
            "scores": [vars(score) for score in self.scores],  # NaN after a divergence
            "remarks": list(self.remarks),
        }


def identify(dataset: Dataset, *, jobs: int | None = None) -> Identification:
    """Fit the nine coefficients to all fit trials at once ([Yu2016] eq. (21)).

    Weights come from the noise: the stated one, or else the RMS of the residual, fitted again until they agree.
    """
    fitted, held = dataset.split()
    stated = dataset.noise
    problem = Problem(
        Model(dataset.fish),
        fitted,
        Noise.white(stated if stated is not None else first_sigma(fitted)),
        free_clock=dataset.clock == "free",
        jobs=jobs or os.cpu_count() or 1,
    )
    one = fit(problem)
    remarks: tuple[str, ...] = ()
    for _ in range(2 if stated is None else 0):
        if one.status == "diverged":
            break
        residual = np.concatenate(problem.raw(one.x))
        problem = replace(problem, noise=Noise.white(np.maximum(np.sqrt(np.mean(residual**2, axis=0)), floor(fitted))))
        one = fit(problem, one.x)
        remarks = ("noise: none stated; the weights are the RMS of the residual",)
    scores = [_score(t, "fit", r) for t, r in zip(fitted, problem.raw(one.x), strict=True)]
    if held:
        parts = predict_held_out(problem, one.values, held)
        scores += [_score(t, "held_out", r) for t, r in zip(held, parts.residuals, strict=True)]
    return Identification(dataset, one, np.asarray(problem.noise.sigma), tuple(scores), remarks)


def first_sigma(trials: tuple[Trial, ...]) -> FloatArray:
    """Return a first sigma (3,) where none is stated: of the third differences of the measurements.

    For white noise their variance is 20 sigma^2; what is left of a smooth motion in them only makes sigma larger.
    """
    differences = np.concatenate([np.diff(trial.velocity, n=3, axis=0) for trial in trials])
    return np.asarray(np.maximum(np.sqrt(np.mean(differences**2, axis=0) / 20.0), floor(trials)))


def _score(trial: Trial, role: str, residual: FloatArray) -> TrialScore:
    nrmse = np.sqrt(np.mean(residual**2, axis=0)) / np.maximum(np.ptp(trial.velocity, axis=0), 1e-12)
    return TrialScore(trial.name, role, (float(nrmse[0]), float(nrmse[1]), float(nrmse[2])))
