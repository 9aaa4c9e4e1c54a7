"""Refits: causes fitted together with the coefficients, from several sizes of the effect."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import stats

from mjfish.arrays import FloatArray
from mjfish.diagnose.evidence import Evidence
from mjfish.diagnose.progress import Progress, silent
from mjfish.effects.effect import Effect
from mjfish.identify import Fit, Problem, fit
from mjfish.parameter import Parameter, bounds

#: Sizes of the one-step estimate, and of an amplitude's scale, that a refit starts from.
_MULTIPLES = (0.3, 1.0, 3.0)
#: And of the scale of a cause that is not smooth at its null.
_GRID = (0.1, 0.2, 0.6, 1.25, 1.5, 1.75, 2.0, 2.5)
#: How many of the most promising starts are looked at once more, with the coefficients moved.
_TRIED = 3
#: A refit of an amplitude that cannot be negative keeps this share of its scale away from zero; or of its one-step
#: estimate, where that is smaller and its score is at least so large.
_OFF_NULL, _OFF_ESTIMATE, _SHOWN = 0.02, 0.1, 10.0
#: Relative change of the sum of squares at which a refit stops.
TOLERANCE = 1e-5
#: Evaluations of a coarse refit of a cause that is smooth at its null, and of one that is not: its start is a guess.
COARSE = (4, 6)
#: Mean square of the whitened residual above which a refit is tried from afresh.
_MISFIT = 1.1
#: Share of the best gain from which a coarse refit is followed to its optimum.
_RUNNING = 0.25
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
        freedom: number of parameters that the causes add.
    """

    effects: tuple[Effect, ...]
    problem: Problem
    fit: Fit
    gain: float
    freedom: int

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the causes."""
        return tuple(effect.name for effect in self.effects)

    @property
    def adjusted(self) -> float:
        """The gain less two for every parameter beyond the first: what sets of different size compare on."""
        return self.gain - 2.0 * (self.freedom - 1)

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
    """Refit candidates: a few steps each, then to the optimum those that are still in the running.

    In the running is whoever removes at least a quarter of what the best removes.

    Args:
        evidence: of the nominal model.
        effects: candidates; those that the scores leave a chance are refitted (see `worth_refitting`).
        progress: told what is being done.
        before: refits under another noise, to start from as well.
        made: coarse refits of this evidence that are known already.
    """
    chosen = worth_refitting(evidence, effects)
    earlier, known = before or {}, made or {}
    floor = _RUNNING * max((one.gain for one in earlier.values()), default=0.0)
    found: dict[str, Refit] = {}
    for done, effect in enumerate(chosen):
        name = effect.name
        progress(f"refitting with {name}", done / (len(chosen) + 2))
        if name in earlier and earlier[name].gain < floor:
            found[name] = _kept(evidence, earlier[name])
        elif name in known and name not in earlier:
            found[name] = known[name]
        else:
            found[name] = refit(evidence, effect, before=earlier.get(name))
    ranked = sorted(found.values(), key=lambda one: -one.gain)
    running = [one for one in ranked if one.gain >= _RUNNING * ranked[0].gain]
    for done, one in enumerate(running):
        name = one.effects[-1].name
        progress(f"refining the fit with {name}", (len(chosen) + done) / (len(chosen) + len(running)))
        found[name] = refined(one, min(other.fit.sse for other in found.values()))
    return found


def abrupt(evidence: Evidence, effects: Sequence[Effect]) -> tuple[float, dict[str, Refit]]:
    """Refit causes that are not smooth at their null; return the p value of the best by Bonferroni, and them.

    A score says little or nothing of them. The size is a nuisance under the null: one more degree of freedom stands for
    what choosing it is worth [Davies1977].

    [Davies1977] R. Davies, Biometrika 64.
    """
    found = {effect.name: refit(evidence, effect) for effect in effects if not effect.smooth}
    chances = [float(stats.chi2.sf(max(one.gain, 0.0), one.freedom + 1)) for one in found.values()]
    return min([1.0, *(2.0 * len(found) * p for p in chances)]), found


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
        or (scores[effect.name] > close and evidence.absorbed(effect.name) > _HIDDEN)
    ]


def refit(evidence: Evidence, effect: Effect, *, gained: float = 0.0, before: Refit | None = None) -> Refit:
    """Add a cause to a fitted model: take a few steps from the best of several starts.

    The one-step estimate is right for a small effect; a large one may lie outside the reach of its linearisation:
    multiples of it and of the declared scale are tried, with the coefficients where they were.

    Args:
        evidence: of the model that it extends.
        effect: the cause.
        gained: what that model gained already against the nominal one.
        before: a refit of the same cause to start from as well.
    """
    base = evidence.problem
    one_step = evidence.first_guess(effect.name)
    small = one_step if evidence.statistic(effect.name) > _SHOWN else {}
    problem = replace(base, model=base.model.extended(effect), declared={**base.declared, **off_null(effect, small)})
    starts = [problem.start({**evidence.fit.values, **guess}) for guess in guesses(effect, one_step)]
    starts.append(problem.start({**evidence.refitted(effect.name, one_step), **_inside(effect, one_step)}))
    starts.append(problem.start(evidence.fit.values))  # next to nothing of it: no refit need be worse than none
    if before is not None:
        starts.append(problem.start(before.fit.values))
    best = fit(problem, _best(evidence, problem, starts), tolerance=TOLERANCE, evaluations=COARSE[not effect.smooth])
    added = problem.model.effects
    freedom = sum(len(one.parameters) for one in added)
    return Refit(added, problem, best, gained + evidence.fit.sse - best.sse, freedom)


def _best(evidence: Evidence, problem: Problem, starts: Sequence[FloatArray]) -> FloatArray:
    """Return the best of several starts, the free parameters of the evidence's model moved to where they belong there.

    They move by (J'J)^-1 J' e, and what is left of e beyond the span of J is what a start is judged by: variable
    projection [GolubPereyra1973] with J at the evidence's fit.

    [GolubPereyra1973] G. Golub and V. Pereyra, SIAM Journal on Numerical Analysis 10.
    """
    free = [p.name for p, held in zip(evidence.fit.parameters, evidence.fit.at_bound, strict=True) if not held]
    columns = np.array([[p.name for p in problem.parameters].index(name) for name in free], dtype=np.int64)
    jacobian = evidence.fit.jacobian[:, ~evidence.fit.at_bound]
    low, high = bounds(problem.parameters)
    residuals = np.stack([problem.residual(start) for start in starts], axis=1)
    steps = np.linalg.lstsq(jacobian, residuals, rcond=1e-8)[0]
    moved = np.stack(starts)
    moved[:, columns] += steps.T
    promised = np.sum((residuals - jacobian @ steps) ** 2, axis=0)
    left = [*zip(promised, np.clip(moved, low, high), strict=True)]
    left += zip(np.sum(residuals**2, axis=0), starts, strict=True)
    ranked = sorted(left, key=lambda one: float(one[0]))[:_TRIED]
    return min((x for _, x in ranked), key=lambda x: float(np.sum(problem.residual(x) ** 2)))


def _kept(evidence: Evidence, one: Refit) -> Refit:
    """Return a refit as it is, under the noise of the evidence."""
    problem = replace(one.problem, noise=evidence.problem.noise)
    here = fit(problem, one.fit.x, evaluations=1)
    return replace(one, problem=problem, fit=here, gain=evidence.fit.sse - here.sse)


def refined(one: Refit, best: float) -> Refit:
    """Follow a refit to its optimum; while nothing fits, once more with the coefficients at their declared starts.

    A large effect drags the coefficients of the nominal model far off, and from there an optimum may be out of reach.

    Args:
        one: a coarse refit.
        best: least sum of squares of all refits: who stays far behind it need not be followed to the last digit.
    """
    result = _followed(one.problem, one.fit.x, one.fit.sse, best)
    if min(best, result.sse) > _MISFIT * len(result.residual):
        start = one.problem.start(one.parameter_values())
        result = min(result, _followed(one.problem, start, result.sse, best), key=lambda each: each.sse)
    return replace(one, fit=result, gain=one.gain + one.fit.sse - result.sse) if result.sse <= one.fit.sse else one


def _followed(problem: Problem, x: FloatArray, sse: float, best: float) -> Fit:
    """Fit from x, ever finer as long as the result comes near the best."""
    while True:
        tolerance = max(TOLERANCE, _BEHIND * (sse - best) / sse)
        result = fit(problem, x, tolerance=tolerance)
        if tolerance == TOLERANCE or _BEHIND * (result.sse - best) > 0.5 * tolerance * result.sse:
            return result
        x, sse = result.x, result.sse


def guesses(effect: Effect, one_step: Mapping[str, float]) -> list[dict[str, float]]:
    """Return amplitudes that a fit may start from: multiples of the one-step estimate and of the declared scale."""
    amplitudes = [p for p in effect.parameters if not p.shape]
    found = [
        {p.name: p.default + multiple * (one_step[p.name] - p.default) for p in amplitudes} for multiple in _MULTIPLES
    ]
    for multiple in _MULTIPLES:
        signs = {p.name: -1.0 if one_step[p.name] < p.default else 1.0 for p in amplitudes}
        found.append({p.name: p.default + multiple * signs[p.name] * p.scale for p in amplitudes})
    if not effect.smooth and len(amplitudes) == 1:  # an optimum in another valley is out of a fit's reach
        found += [{p.name: p.default + share * p.scale for p in amplitudes} for share in _GRID]
    if any(p.start != p.default for p in amplitudes):  # declared where there is no gradient at the null
        found += [{p.name: p.default + share * (p.start - p.default) for p in amplitudes} for share in (1.0, 2.0)]
    return [_inside(effect, guess) for guess in found]


def _inside(effect: Effect, guess: Mapping[str, float]) -> dict[str, float]:
    return {p.name: float(np.clip(guess[p.name], p.low, p.high)) for p in effect.parameters if not p.shape}


def off_null(effect: Effect, estimates: Mapping[str, float] | None = None) -> dict[str, Parameter]:
    """Keep amplitudes that cannot be negative a little above zero, where they have derivatives on both sides.

    Args:
        effect: whose amplitudes.
        estimates: rough ones that may be smaller than that.
    """
    lifted = {}
    for p in effect.parameters:
        if not p.shape and p.default == p.low:
            small = (estimates or {}).get(p.name, 0.0) - p.low
            off = min(_OFF_NULL * p.scale, _OFF_ESTIMATE * small) if small > 0.0 else _OFF_NULL * p.scale
            lifted[p.name] = p.rebound(low=p.low + off, start=max(p.start, p.low + off))
    return lifted
