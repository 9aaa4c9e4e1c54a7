"""Every rival fitted together with the coefficients: where the plan starts from."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mjfish.data import Dataset
from mjfish.diagnosis.evidence import gather
from mjfish.diagnosis.progress import Progress, silent
from mjfish.diagnosis.starts import guesses, off_null
from mjfish.effects.effect import Effect
from mjfish.estimation import Fit, Noise, Problem, fit
from mjfish.estimation.noise import estimate
from mjfish.estimation.report import first_sigma
from mjfish.model import Model
from mjfish.parameter import Parameter

_TOLERANCE = 1e-6


@dataclass(frozen=True, eq=False)
class Fitted:
    """A rival at its own fit.

    Attributes:
        effect: the rival.
        problem: of the model extended by it.
        fit: its result.
    """

    effect: Effect
    problem: Problem
    fit: Fit

    @property
    def free(self) -> tuple[Parameter, ...]:
        """Parameters off their bounds: those that a refit can move."""
        return tuple(p for p, held in zip(self.fit.parameters, self.fit.at_bound, strict=True) if not held)


def baseline(dataset: Dataset, jobs: int | None = None) -> Problem:
    """Return the problem of the nominal model on all trials, the noise as stated or from third differences.

    Held-out ones tell rivals apart as well as the others (docs/notes/018).
    """
    sigma = first_sigma(dataset.trials) if dataset.noise is None else np.asarray(dataset.noise)
    return Problem(
        Model(dataset.fish),
        dataset.trials,
        Noise.white(sigma),
        free_clock=dataset.clock == "free",
        jobs=jobs or os.cpu_count() or 1,
    )


def extended(problem: Problem, rival: Effect) -> Problem:
    """Return the problem of the model with a rival."""
    declared = {**problem.declared, **off_null(rival)}
    return replace(problem, model=problem.model.extended(rival), declared=declared)


def fit_rivals(
    problem: Problem, rivals: Sequence[Effect], starts: Mapping[str, float], progress: Progress = silent
) -> tuple[Fitted, ...]:
    """Fit the nominal model, then it with every rival, from the best of several sizes.

    Args:
        problem: of the nominal model.
        rivals: effects.
        starts: their sizes by full name, where a diagnosis estimated them.
        progress: told what is being done.
    """
    progress("fitting the nominal model", 0.05)
    nominal = fit(problem, tolerance=_TOLERANCE)
    evidence = gather(problem, nominal, rivals)
    found = []
    for done, rival in enumerate(rivals):
        progress(f"fitting with {rival.name}", 0.1 + 0.3 * done / len(rivals))
        found.append(
            _fit(problem, nominal, rival, [_given(rival, starts), *guesses(rival, evidence.first_guess(rival.name))])
        )
    return tuple(found)


def with_noise_of_the_best(fitted: Sequence[Fitted]) -> tuple[Fitted, ...]:
    """Estimate the noise from what the best rival leaves, and fit all again with it."""
    best = min(fitted, key=lambda one: one.fit.sse)
    noise = estimate(best.problem.raw(best.fit.x), lost=len(best.free) / 3.0)
    again = []
    for one in fitted:
        problem = replace(one.problem, noise=noise)
        again.append(replace(one, problem=problem, fit=fit(problem, one.fit.x, tolerance=_TOLERANCE)))
    return tuple(again)


def _fit(problem: Problem, nominal: Fit, rival: Effect, tried: Sequence[Mapping[str, float]]) -> Fitted:
    wider = extended(problem, rival)
    starts = [wider.start({**nominal.values, **guess}) for guess in tried if guess]
    costs = [float(np.sum(wider.residual(start) ** 2)) for start in starts]
    return Fitted(rival, wider, fit(wider, starts[int(np.argmin(costs))], tolerance=_TOLERANCE))


def _given(rival: Effect, starts: Mapping[str, float]) -> dict[str, float]:
    return {p.name: float(np.clip(starts[p.name], p.low, p.high)) for p in rival.parameters if p.name in starts}
