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
#: Mean square of the whitened residual above which a refit is tried from afresh.
_MISFIT = 1.1


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


def refits(
    evidence: Evidence,
    effects: Sequence[Effect],
    progress: Progress = silent,
    before: Mapping[str, Refit] | None = None,
) -> dict[str, Refit]:
    """Refit every candidate: a few steps each, then to the optimum those that are still in the running.

    In the running is whoever removes at least half of what the best removes.

    Args:
        evidence: of the model that they extend.
        effects: candidates.
        progress: told what is being done.
        before: refits under another noise, to start from as well.
    """
    found = {}
    for done, effect in enumerate(effects):
        progress(f"refitting with {effect.name}", done / (len(effects) + 2))
        found[effect.name] = _refit(evidence, effect, (before or {}).get(effect.name))
    ranked = sorted(found.values(), key=lambda one: -one.gain)
    running = [one for one in ranked if one.gain >= 0.5 * ranked[0].gain]
    for done, one in enumerate(running):
        progress(f"refining the fit with {one.effect.name}", (len(effects) + done) / (len(effects) + len(running)))
        found[one.effect.name] = _refine(evidence, one)
    return found


def _refit(evidence: Evidence, effect: Effect, before: Refit | None) -> Refit:
    """Take a few steps from the best of several starts, the coefficients where the baseline left them.

    The one-step estimate is right for a small effect; a large one may lie outside the reach of its linearisation:
    multiples of it and of the declared scale are tried.
    """
    base = evidence.problem
    problem = replace(base, model=base.model.extended(effect), declared={**base.declared, **_off_null(effect)})
    starts = [problem.start({**evidence.fit.values, **guess}) for guess in _guesses(evidence, effect)]
    if before is not None:
        starts.append(problem.start(before.fit.values))
    costs = [float(np.sum(problem.residual(start) ** 2)) for start in starts]
    best = fit(problem, starts[int(np.argmin(costs))], tolerance=TOLERANCE, evaluations=COARSE)
    return Refit(effect, problem, best, evidence.fit.sse - best.sse, len(effect.parameters))


def _refine(evidence: Evidence, one: Refit) -> Refit:
    """Follow a refit to its optimum; where it still misfits, once more with the coefficients at their declared starts.

    A large effect drags the coefficients of the nominal model far off, and from there an optimum may be out of reach.
    """
    problem, best = one.problem, fit(one.problem, one.fit.x, tolerance=TOLERANCE)
    if best.sse > _MISFIT * len(best.residual):
        afresh = fit(problem, problem.start(one.parameter_values()), tolerance=TOLERANCE)
        best = min(best, afresh, key=lambda result: result.sse)
    return replace(one, fit=best, gain=evidence.fit.sse - best.sse) if best.sse <= one.fit.sse else one


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
