"""Refits: causes fitted together with the coefficients, from several sizes of the effect."""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mjfish.arrays import FloatArray
from mjfish.diagnosis.evidence import Evidence
from mjfish.diagnosis.progress import Progress, silent
from mjfish.diagnosis.resolution import finer
from mjfish.diagnosis.score_test import p_value_of
from mjfish.diagnosis.side_by_side import side_by_side, with_jobs
from mjfish.diagnosis.starts import best_start, off_null, other_valleys
from mjfish.effects.effect import Effect
from mjfish.estimation import Fit, Problem, fit

#: Relative change of the sum of squares at which a refit stops.
TOLERANCE = 1e-5
#: Evaluations of a coarse refit of a cause that is smooth at its null, and of one that is not: its start is a guess.
COARSE = (4, 6)
#: And of one that is taken on under another noise, where it is in the running: it is followed further as those are.
_ON = 2
#: Mean square of the whitened residual above which a refit is tried from afresh.
_MISFIT = 1.1
#: Share of the best gain from which a coarse refit is followed to its optimum; how far it may be behind where the best
#: fits, as a share and at least.
_RUNNING, _DISTANCE, _WEAK = 0.25, 0.3, 100.0
#: How often another valley is looked for, from one to the next.
_LOOKS = 3
#: A fit that is behind the best is followed until a step gains less than this share of its distance.
_BEHIND = 0.01
#: How many candidates are refitted for their score alone.
_BEST = 5
#: A candidate that a refit of the coefficients hides to this share is refitted where its score is within _NEAR.
_HIDDEN, _NEAR = 0.9, 20.0


@dataclass(frozen=True, eq=False)
class Refit:
    """Causes fitted together with the coefficients.

    Attributes:
        effects: the causes, the last one added last.
        problem: of the extended model.
        fit: its result.
        gain: fall of the sum of squares against the fit of the nominal model, LR.
    """

    effects: tuple[Effect, ...]
    problem: Problem
    fit: Fit
    gain: float

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the causes."""
        return tuple(effect.name for effect in self.effects)

    @functools.cached_property
    def degrees_of_freedom(self) -> int:
        """Number of parameters that the causes add; a shape that these data do not feel is none."""
        felt = {p.name for p, slope in zip(self.fit.parameters, self.fit.jacobian.T, strict=True) if np.any(slope)}
        return sum(not p.shape or p.name in felt for effect in self.effects for p in effect.parameters)

    @property
    def adjusted(self) -> float:
        """The gain less two for every parameter beyond the first: what sets of different size compare on."""
        return self.gain - 2.0 * (self.degrees_of_freedom - 1)

    def less(self, out: Effect) -> Refit:
        """Refit without one of several causes, from where the others and the coefficients are."""
        kept = tuple(effect for effect in self.effects if effect.name != out.name)
        problem = replace(self.problem, model=replace(self.problem.model, effects=kept))
        here = fit(problem, problem.start(self.fit.values), tolerance=TOLERANCE)
        return Refit(kept, problem, here, self.gain + self.fit.sse - here.sse)

    def parameter_values(self) -> dict[str, float]:
        """Return the estimates of the causes' parameters by name."""
        return {p.name: self.fit.values[p.name] for effect in self.effects for p in effect.parameters}


def refits(
    evidence: Evidence,
    effects: Sequence[Effect],
    progress: Progress = silent,
    before: Mapping[str, Refit] | None = None,
    made: Mapping[str, Refit] | None = None,
) -> dict[str, Refit]:
    """Refit candidates: a few steps each.

    Args:
        evidence: of the nominal model.
        effects: candidates; those that the scores leave a chance are refitted (see `worth_refitting`).
        progress: told what is being done.
        before: refits under another noise; they are taken on from where they ended.
        made: coarse refits of this evidence that are known already.
    """
    chosen = sorted(worth_refitting(evidence, effects), key=lambda effect: effect.smooth)  # what takes longest first
    earlier, known, jobs = before or {}, made or {}, evidence.problem.jobs
    floor = _floor(earlier) if earlier else 0.0
    alone = with_jobs(evidence, 1)

    def made_of(effect: Effect) -> Refit:
        if effect.name in earlier:
            one = earlier[effect.name]
            return _taken_on(alone, one, _ON if one.gain >= floor else 1)
        return known[effect.name] if effect.name in known else refit(alone, effect)

    results = side_by_side(made_of, chosen, jobs)
    found = {}
    for done, effect in enumerate(chosen):
        progress(f"refitting with {effect.name}", done / len(chosen))
        found[effect.name] = next(results)
    return found


def settled(found: Mapping[str, Refit], progress: Progress = silent) -> dict[str, Refit]:
    """Follow those refits to their optimum that are in the running."""
    floor = _floor(found)
    running = {name: one for name, one in found.items() if one.gain >= floor}
    least, jobs = min(one.fit.sse for one in found.values()), next(iter(found.values())).problem.jobs
    results = side_by_side(lambda one: refined(with_jobs(one, 1), least), [*running.values()], jobs)
    result = dict(found)
    for done, name in enumerate(running):
        progress(f"refining the fit with {name}", done / len(running))
        result[name] = next(results)
    return result


def _floor(found: Mapping[str, Refit]) -> float:
    """Return the gain from which a refit is in the running: a quarter of the best.

    Where the best fits to within noise, there is nothing left for others to find: then who comes near it.
    """
    best = max(found.values(), key=lambda one: one.gain)
    floor = _RUNNING * best.gain
    if best.fit.sse > _MISFIT * len(best.fit.residual):
        return floor
    return max(floor, best.gain - max(_DISTANCE * best.gain, _WEAK))


def abrupt(evidence: Evidence, effects: Sequence[Effect]) -> tuple[float, dict[str, Refit]]:
    """Refit causes that are not smooth at their null; return the p value of the best by Bonferroni, and them.

    A score says little or nothing of them. The size is a nuisance under the null: one more degree of freedom stands for
    what choosing it is worth [Davies1977].

    [Davies1977] R. Davies, Biometrika 64.
    """
    jobs, tried = evidence.problem.jobs, [effect for effect in effects if not effect.smooth]
    alone = with_jobs(evidence, 1)
    results = side_by_side(lambda effect: refit(alone, effect), tried, jobs)
    found = dict(zip((effect.name for effect in tried), results, strict=True))
    chances = [p_value_of(one.gain, one.degrees_of_freedom + 1) for one in found.values()]
    return min([1.0, *(len(found) * p for p in chances)]), found


def worth_refitting(evidence: Evidence, effects: Sequence[Effect]) -> list[Effect]:
    """Return the candidates of the best scores, those whose score says little, and those nearly hidden but close.

    A score says little of a cause that is not smooth at its null; of one that the coefficients absorb nearly, it is the
    difference of large numbers.
    """
    scores = {effect.name: evidence.statistic(effect.name) for effect in effects if not evidence.hidden(effect.name)}
    ranked = sorted((effect for effect in effects if effect.name in scores), key=lambda effect: -scores[effect.name])
    if not ranked:
        return []
    close = scores[ranked[0].name] - _NEAR
    return [
        effect
        for place, effect in enumerate(ranked)
        if place < _BEST
        or not effect.smooth
        or (scores[effect.name] > close and evidence.confounded(effect.name) > _HIDDEN)
    ]


def refit(evidence: Evidence, effect: Effect, *, gained: float = 0.0) -> Refit:
    """Add a cause to a fitted model: take a few steps from the best of several starts.

    Args:
        evidence: of the model that it extends.
        effect: the cause.
        gained: what that model gained already against the nominal one.
    """
    base = evidence.problem
    visible = evidence.minimum_detectable(effect.name) if effect.smooth else None
    problem = replace(base, model=base.model.extended(effect), declared={**base.declared, **off_null(effect, visible)})
    start = best_start(evidence, problem, effect)
    best = fit(problem, start, tolerance=TOLERANCE, evaluations=COARSE[not effect.smooth])
    added = problem.model.effects
    return Refit(added, problem, best, gained + evidence.fit.sse - best.sse)


def _taken_on(evidence: Evidence, one: Refit, evaluations: int) -> Refit:
    """Return a refit under the noise of the evidence, some evaluations later.

    From where it ended, or from next to nothing of the cause where that is better under this noise.
    """
    problem = replace(one.problem, noise=evidence.problem.noise, jobs=1)
    idle = {p.name: p.low for p in problem.declared.values()}
    nothing = problem.start({**idle, **evidence.fit.values})
    start = min((one.fit.x, nothing), key=lambda x: float(np.sum(problem.rough.residual(x) ** 2)))
    here = fit(problem, start, tolerance=TOLERANCE, evaluations=evaluations)
    return replace(one, problem=problem, fit=here, gain=evidence.fit.sse - here.sse)


def refined(one: Refit, best: float) -> Refit:
    """Follow a refit to its optimum; while nothing fits, once more with the coefficients at their declared starts.

    A large effect drags the coefficients of the nominal model far off, and from there an optimum may be out of reach.
    What is not smooth may lie in another valley: sizes from half to twice of it are tried.

    Args:
        one: a coarse refit.
        best: least sum of squares of all refits: who stays far behind it need not be followed to the last digit.
    """
    there = one.fit.status == "converged"
    result = one.fit if there else _followed(one.problem, one.fit.x, one.fit.sse, best)
    fits = min(best, result.sse) <= _MISFIT * len(result.residual)
    if not fits:
        start = one.problem.start(one.parameter_values())
        result = min(result, _followed(one.problem, start, result.sse, best), key=lambda each: each.sse)
    for _ in range(_LOOKS):
        starts = other_valleys(result, one.problem, fits=fits)
        others = [_followed(one.problem, start, result.sse, best) for start in starts]
        lower = min([result, *others], key=lambda each: each.sse)
        if lower is result:
            break
        result = lower
    if result.sse <= one.fit.sse:
        one = replace(one, fit=result, gain=one.gain + one.fit.sse - result.sse)
    return _resolved(one)


def _resolved(one: Refit) -> Refit:
    """Shorten the integration step where its error would show with the cause in the model, and fit once more."""
    problem = finer(one.problem, one.fit.x, TOLERANCE)
    if problem is one.problem:
        return one
    result = fit(problem, one.fit.x, tolerance=TOLERANCE)
    return replace(one, problem=problem, fit=result, gain=one.gain + one.fit.sse - result.sse)


def _followed(problem: Problem, x: FloatArray, sse: float, best: float) -> Fit:
    """Fit from x, ever finer as long as the result comes near the best."""
    while True:
        tolerance = max(TOLERANCE, _BEHIND * (sse - best) / sse)
        result = fit(problem, x, tolerance=tolerance)
        if tolerance == TOLERANCE or _BEHIND * (result.sse - best) > 0.5 * tolerance * result.sse:
            return result
        x, sse = result.x, result.sse
