"""Refits: every candidate fitted together with the coefficients, from several sizes of the effect."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mjfish.diagnose.evidence import Evidence
from mjfish.diagnose.progress import Progress, silent
from mjfish.effects.effect import Effect
from mjfish.identify import Fit, Problem, fit
from mjfish.parameter import Parameter

#: Sizes of the one-step estimate, and of an amplitude's scale, that a refit starts from.
_MULTIPLES = (0.3, 1.0, 3.0)
#: A refit of an amplitude that cannot be negative keeps this share of its scale away from zero.
_OFF_NULL = 0.02
#: Relative change of the sum of squares at which a refit stops.
TOLERANCE = 1e-5
#: Evaluations of a coarse refit.
COARSE = 5


@dataclass(frozen=True, eq=False)
class Refit:
    """One candidate fitted together with the coefficients.

    Attributes:
        effect: the candidate.
        problem: of the extended model.
        fit: its result.
        gain: fall of the sum of squares against the baseline fit, LR.
        freedom: number of parameters that the candidate adds.
    """

    effect: Effect
    problem: Problem
    fit: Fit
    gain: float
    freedom: int

    def parameter_values(self) -> dict[str, float]:
        """Return the estimates of the effect's parameters by name."""
        return {p.name: self.fit.values[p.name] for p in self.effect.parameters}


def refits(evidence: Evidence, effects: Sequence[Effect], progress: Progress = silent) -> dict[str, Refit]:
    """Refit every candidate: a few steps each, then to the optimum those that are still in the running.

    In the running is whoever removes at least half of what the best removes.
    """
    coarse = {}
    for done, effect in enumerate(effects):
        progress(f"refitting with {effect.name}", done / (len(effects) + 2))
        coarse[effect.name] = refit(evidence, effect)
    ranked = sorted(coarse.values(), key=lambda one: -one.gain)
    running = [one for one in ranked if one.gain >= 0.5 * ranked[0].gain]
    for done, one in enumerate(running):
        progress(f"refining the fit with {one.effect.name}", (len(effects) + done) / (len(effects) + len(running)))
        coarse[one.effect.name] = refine(evidence, one)
    return coarse


def refine(evidence: Evidence, one: Refit) -> Refit:
    """Follow a refit to its optimum."""
    better = fit(one.problem, one.fit.x, tolerance=TOLERANCE)
    return replace(one, fit=better, gain=evidence.fit.sse - better.sse) if better.sse <= one.fit.sse else one


def refit(evidence: Evidence, effect: Effect, evaluations: int = COARSE) -> Refit:
    """Fit `effect` together with everything the evidence's model has, from the best of several starts.

    The one-step estimate is right for a small effect; a large one may lie outside the reach of its linearisation:
    multiples of it and of the declared scale are tried, and the best is followed.
    """
    base = evidence.problem
    problem = replace(base, model=base.model.extended(effect), declared={**base.declared, **_off_null(effect)})
    starts = [problem.start({**evidence.fit.values, **guess}) for guess in _guesses(evidence, effect)]
    costs = [float(np.sum(problem.residual(start) ** 2)) for start in starts]
    ranked = [starts[i] for i in np.argsort(costs)]
    best = fit(problem, ranked[0], tolerance=TOLERANCE, evaluations=evaluations)
    return Refit(effect, problem, best, evidence.fit.sse - best.sse, len(effect.parameters))


def _guesses(evidence: Evidence, effect: Effect) -> list[dict[str, float]]:
    one_step = evidence.first_guess(effect.name)
    amplitudes = [p for p in effect.parameters if not p.shape]
    guesses = [
        {p.name: p.default + multiple * (one_step[p.name] - p.default) for p in amplitudes} for multiple in _MULTIPLES
    ]
    for multiple in _MULTIPLES:
        signs = {p.name: -1.0 if one_step[p.name] < p.default else 1.0 for p in amplitudes}
        guesses.append({p.name: p.default + multiple * signs[p.name] * p.scale for p in amplitudes})
    return [{p.name: float(np.clip(guess[p.name], p.low, p.high)) for p in amplitudes} for guess in guesses]


def _off_null(effect: Effect) -> dict[str, Parameter]:
    """Keep amplitudes that cannot be negative a little above zero, where they have derivatives on both sides."""
    lifted = {}
    for p in effect.parameters:
        if not p.shape and p.default == p.low:
            floor = p.low + _OFF_NULL * p.scale
            lifted[p.name] = p.rebound(low=floor, start=max(p.start, floor))
    return lifted


def merged(base: Mapping[str, float], refitted: Refit) -> dict[str, float]:
    """Return the values of the extended model: those of the refit over `base`."""
    return {**base, **refitted.fit.values}
