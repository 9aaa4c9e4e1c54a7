"""Tables of a diagnosis, from fits and standings to what a reader sees."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from mjfish.data import Trial
from mjfish.diagnosis.evidence import Evidence
from mjfish.diagnosis.heldout import pooled_error
from mjfish.diagnosis.refit import Refit
from mjfish.diagnosis.result import Candidate, Cause, Estimate, FittedModel, Overlay
from mjfish.diagnosis.score_test import p_value_of
from mjfish.diagnosis.verdict import Hearing, Ruling
from mjfish.effects import Effect
from mjfish.estimation import Fit, Problem
from mjfish.estimation.fit import Z95
from mjfish.estimation.held_out import Score
from mjfish.model import Model

#: Said of a refit that was too far behind the best to be followed.
_ROUGH = "Its refit was not followed to its optimum: what it explains is a lower bound, its size is rough."


def causes(best: Refit | None) -> tuple[Cause, ...]:
    """Return the causes of a refit with the estimates of their parameters."""
    if best is None:
        return ()
    return tuple(Cause(effect.name, effect.summary, _own(best, effect)) for effect in best.effects)


def rivals(ruling: Ruling) -> tuple[tuple[str, ...], ...]:
    """Return the names in which the sets that stay differ."""
    if ruling.verdict != "cannot_tell" or len(ruling.sets) < 2:  # data that block a verdict leave none
        return ()
    return (tuple(dict.fromkeys(name for names in ruling.sets for name in names if name not in ruling.certain)),)


def estimates(one: Fit, model: Model) -> dict[str, Estimate]:
    """Return the model's estimates by name, without what belongs to single trials.

    A refit keeps a little off the null where an amplitude cannot be negative; an interval that reaches there reaches 0.
    A shape that these data do not feel has its default.
    """
    result = {}
    declared = {p.name: p for p in model.parameters}
    for p, at_bound, slope in zip(one.parameters, one.at_bound, one.jacobian.T, strict=True):
        if p.name in declared:
            low, high = one.interval(p.name, Z95)
            low = declared[p.name].low if low <= p.low else low
            value = p.default if p.shape and not np.any(slope) else one.values[p.name]
            result[p.name] = Estimate(value, low, high, p.unit, bool(at_bound))
    return result


def fitted_models(evidence: Evidence, refitted: Mapping[str, Refit]) -> tuple[FittedModel, ...]:
    """Return the nominal model and its refits, each at its fit."""
    return (
        _fitted((), evidence.problem, evidence.fit),
        *(_fitted(refit.names, refit.problem, refit.fit) for refit in refitted.values()),
    )


def _fitted(causes: tuple[str, ...], problem: Problem, fit: Fit) -> FittedModel:
    at_bound = tuple(p.name for p, held in zip(fit.parameters, fit.at_bound, strict=True) if held)
    return FittedModel(causes, fit.values, at_bound, fit.sse, problem.model.step, fit.status == "converged")


def _own(one: Refit, effect: Effect) -> dict[str, Estimate]:
    every = estimates(one.fit, one.problem.model)
    return {p.short: every[p.name] for p in effect.parameters}


def candidates(
    effects: Sequence[Effect],
    reasons: Mapping[str, str],
    evidence: Evidence,
    refitted: Mapping[str, Refit],
    single: Hearing,
    held_out_errors: Mapping[str, float],
) -> tuple[Candidate, ...]:
    """Return how every candidate fared, best first."""
    result = []
    for effect in effects:
        name = effect.name
        if reasons[name]:
            result.append(Candidate(name, False, remark=reasons[name]))
            continue
        one, place = refitted.get(name), single.standings.get((name,))
        score = 0.0 if evidence.hidden(name) else evidence.statistic(name)
        statistic = one.gain if one else score
        freedom = one.degrees_of_freedom if one else sum(not p.shape for p in effect.parameters)
        result.append(
            Candidate(
                name=name,
                applicable=True,
                score=score,
                statistic=statistic,
                degrees_of_freedom=freedom,
                p_value=p_value_of(statistic, freedom),
                rival_p=place.rival_p if place else None,
                fit_p=min(place.saturated_p, place.omnibus_p) if place and place.in_set else None,
                held_out_gain=held.gained if (held := single.held_out.get((name,))) is not None else None,
                error=pooled_error(one.problem.raw(one.fit.x), one.problem.trials) if one else None,
                held_out_error=held_out_errors.get(name),
                confounded=evidence.confounded(name),
                minimum_detectable=_visible(evidence, effect),
                parameters=_own(one, effect) if one else None,
                remark=_ROUGH if one and one.fit.status != "converged" else "",
            )
        )
    return tuple(sorted(result, key=lambda candidate: -candidate.statistic))


def _visible(evidence: Evidence, effect: Effect) -> dict[str, float] | None:
    """Return the sizes that would have shown; None where no score says, or the coefficients hide the cause."""
    return evidence.minimum_detectable(effect.name) if effect.smooth and not evidence.hidden(effect.name) else None


def remarks(noise: str, evidence: Evidence, held: Sequence[Trial]) -> tuple[str, ...]:
    """Return what a reader should know of noise, bounds and held-out trials."""
    told = [noise] if noise else []
    for p, at_bound in zip(evidence.fit.parameters, evidence.fit.at_bound, strict=True):
        if at_bound:
            told.append(f"{p.name} of the nominal model rests on its bound {evidence.fit.values[p.name]:g}")
    if not held:
        told.append("no held-out trial: the gain cannot be measured; record or set aside one more trial")
    return tuple(told)


def overlays(
    evidence: Evidence, extended: Problem, final: Fit, held: Sequence[Trial], scores: tuple[Score, Score] | None
) -> tuple[Overlay, ...]:
    """Return every trial as both models predict it; `scores` of the nominal and of the extended model."""
    nominal, after = evidence.problem.predictions(evidence.fit.x), extended.predictions(final.x)
    shown = [Overlay(t, False, a, b) for t, a, b in zip(evidence.problem.trials, nominal, after, strict=True)]
    if scores is not None:
        pairs = zip(held, scores[0].predictions, scores[1].predictions, strict=True)
        shown += [Overlay(t, True, a, b) for t, a, b in pairs]
    return tuple(shown)


def undetectable(candidates: Sequence[Candidate], evidence: Evidence) -> dict[str, str]:
    """Return the causes that these data cannot show, whatever their size, and why."""
    reasons = {one.name: one.remark for one in candidates if not one.applicable}
    for effect in evidence.candidates:
        if evidence.hidden(effect.name):
            reasons[effect.name] = "the free coefficients hide all of it; fix one that was measured apart"
    return reasons
