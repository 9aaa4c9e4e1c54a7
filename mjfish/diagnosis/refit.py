"""Refits: causes fitted together with the coefficients, from several sizes of the effect.

The integration step is as long as its error is one that the data cannot see. A refit begins where the score of the
cause is largest among its shapes: one that begins elsewhere may end in another minimum.

At the null a shape does nothing, and no data say what it is. The score statistic T(s) of the amplitudes at shapes s
says at which of them the cause would explain most, to first order ([Davies1977]); a sweep over a grid, one shape at a
time, finds it.

[Davies1977] R. Davies, Biometrika 64: hypothesis testing when a parameter is present only under the alternative.
"""

from __future__ import annotations

import copy
import functools
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from operator import attrgetter

import numpy as np

from mjfish.diagnosis.evidence import Evidence, p_value_of, signature_rows
from mjfish.diagnosis.failures import NOMINAL, Failure, attempted, failed, note, sound
from mjfish.diagnosis.refit_result import TOLERANCE, Refit, extended, followed
from mjfish.effects.effect import Effect
from mjfish.estimation import Fit, Problem, fit
from mjfish.estimation.fit import fit_or_raise
from mjfish.estimation.marginal_likelihood import smoothed
from mjfish.estimation.sensor_noise import having_noise_of
from mjfish.execution import mapped
from mjfish.numerics.arrays import FloatArray
from mjfish.numerics.sized_cache import always
from mjfish.parameters import Parameter, bounds

#: Values of a shape that are tried: so many, or where its bounds are wide, a factor apart. A resonance is narrow.
_VALUES, _FACTOR = 3, 1.45
#: Sweeps over all shapes, where there are several.
_SWEEPS = 2


def at_best_shapes(
    evidence: Evidence, effect: Effect, *, first_alone: bool = False
) -> tuple[Evidence, dict[str, float]]:
    """Return the evidence of one candidate at the shapes of its largest score, and these shapes by full name.

    The defaults are among the values tried.

    Args:
        evidence: of the model without the candidate.
        effect: the candidate.
        first_alone: leave all shapes but the first at their defaults.
    """
    shapes = {p.name: p.default for p in effect.parameters if p.shape}
    (best,) = _scored(evidence, effect, [shapes])
    declared = [p for p in effect.parameters if p.shape][: 1 if first_alone else None]
    for _ in range(_SWEEPS if len(declared) > 1 else 1):
        before = dict(shapes)
        for p in declared:
            tried = [{**shapes, p.name: float(value)} for value in _grid(p)]
            for there, at in zip(_scored(evidence, effect, tried), tried, strict=True):
                if there.statistic(effect.name) > best.statistic(effect.name):
                    best, shapes = there, at
        if shapes == before:
            break
    return best, shapes


def _scored(evidence: Evidence, effect: Effect, tried: Sequence[dict[str, float]]) -> Iterator[Evidence]:
    """Yield the evidence of one candidate at each of these shapes, from one rollout that has them all.

    Args:
        evidence: of the model without the candidate.
        effect: the candidate.
        tried: shapes by full name.
    """
    problem, width = evidence.problem, len(effect.amplitudes())
    twins = [_renamed(effect, f"{effect.name}_{k}") for k in range(len(tried))]
    shapes = {
        f"{twin.name}.{name.partition('.')[2]}": value
        for twin, own in zip(twins, tried, strict=True)
        for name, value in own.items()
    }
    stacked = signature_rows(problem, evidence.fit.values, twins, shapes)
    for k in range(len(tried)):
        raw = stacked[:, k * width : (k + 1) * width]
        projected = evidence.coefficients.off(raw)
        yield replace(
            evidence,
            candidates=(effect,),
            amplitudes=(effect.amplitudes(),),
            score=projected.T @ evidence.cleared,
            information=projected.T @ projected,
            raws=always(raw),
        )


@functools.lru_cache(maxsize=512)
def _renamed(effect: Effect, name: str) -> Effect:
    """Return a candidate under another name, so that a model may have it several times; it is of its fish already."""
    parameters = tuple(replace(p, name=f"{name}.{p.short}") for p in effect.parameters)
    own = {"name": name, "parameters": parameters, "for_fish": classmethod(lambda _cls, _fish: None)}
    twin = copy.copy(effect)
    twin.__class__ = type(name, (type(effect),), own)
    return twin


def _grid(p: Parameter) -> FloatArray:
    """Return the values of a shape that are tried, over its bounds."""
    if p.wide:
        return np.geomspace(p.low, p.high, 1 + int(np.ceil(np.log(p.high / p.low) / np.log(_FACTOR))))
    return np.linspace(p.low, p.high, _VALUES)


#: Longest and shortest integration step [s], and what its error may add to a sum of squares in units of the noise.
_LONGEST, _SHORTEST = 0.005, 0.00125
_UNSEEN = 0.1
#: Power of the step by which that falls, a little less than the eight of a method of fourth order.
_POWER = 7.0
#: Step of the derivatives in steps of the rollouts. Where joints jerk (`Effect.jerks`), it is one: the derivative by
#: the width of a gap would be off by more than itself; that by a lag is off by 2 %.
_SLOPES = 3.0


def resolved(problem: Problem) -> tuple[Problem, FloatArray]:
    """Return the problem with the longest step whose error the data cannot see, and the fit there as a start.

    The error is the change of the whitened prediction on halving the step; its sum of squares is what the step adds to
    any statistic.
    """
    rough = _stepped(problem, _LONGEST)
    x = sound(NOMINAL, fit(rough, tolerance=1e-4)).x
    error = float(np.sum((rough.residual(x) - _stepped(problem, 0.5 * _LONGEST).residual(x)) ** 2))
    return _stepped(problem, max(_LONGEST * min(_UNSEEN / max(error, 1e-300), 1.0) ** (1.0 / _POWER), _SHORTEST)), x


def finer(problem: Problem, x: FloatArray, share: float) -> Problem:
    """Return the problem with its step halved as often as its error at x is seen: a cause may ask for more.

    Where the tail is nearly stiff, or servos jerk, the error falls by no power that is known beforehand.

    Args:
        problem: of an extended model.
        x: where it has been fitted.
        share: of the sum of squares at x that an error may be as well: less than the fit is followed to.
    """
    here = problem.residual(x)
    unseen = max(_UNSEEN, share * float(here @ here))
    while (step := 0.5 * problem.model.step) >= _SHORTEST:
        half = _stepped(problem, step)
        there = half.residual(x)
        if np.sum((there - here) ** 2) < unseen:
            break
        problem, here = half, there
    return problem


def _stepped(problem: Problem, step: float) -> Problem:
    slopes = None if any(map(_jerks, problem.causes)) else _SLOPES * step
    return replace(problem, model=replace(problem.model, step=step), slope_step=slopes)


def _jerks(effect: Effect) -> bool:
    """Return whether derivatives need the step of the rollout with this cause in the model."""
    return effect.jerks and effect.overrides("drive")


#: Evaluations of a coarse refit of a cause that is smooth at its null, and of one that is not: its start is a guess.
COARSE = (4, 6)
#: Mean square of the whitened residual above which a refit leaves more than noise, and is repeated.
_MISFIT = 1.1
#: Share of the best gain above which a coarse refit is followed to its optimum. Where the best fits to within noise:
#: how far it may be behind, as a share of the best gain, and at least.
_RUNNING, _DISTANCE, _WEAK = 0.25, 0.3, 100.0
#: A fit that is behind the best is followed until a step gains less than this share of its distance.
_BEHIND = 0.01
#: Most evaluations of a refit at one tolerance: where the form is wrong, there may be no end to it.
_MOST = 40
#: Mean square of a residual above which a fit is far off.
_FAR = 10.0
#: Shares of every run that a fit goes by, one after the other, to leave a wrong minimum, and the tolerance there.
_STRETCHES, _ROUGH = (1.0 / 16.0, 1.0 / 8.0, 1.0 / 4.0), 1e-4
#: Sum of squares that the best start of a cause which is not smooth must take, or its fit is not followed.
_HOPELESS = 3.0
#: Score below which shapes are looked for before candidates are chosen.
_SMALL = 400.0
#: How many candidates are refitted for their score alone.
_BEST = 5
#: A candidate that a refit of the coefficients hides to this share is refitted where its score is within _NEAR.
_HIDDEN, _NEAR = 0.9, 20.0


def refits(
    evidence: Evidence,
    effects: Sequence[Effect],
    before: Mapping[str, Refit] | None = None,
    coarse: Mapping[str, Refit] | None = None,
) -> dict[str, Refit]:
    """Refit candidates: a few steps each.

    Args:
        evidence: of the nominal model.
        effects: candidates; those of `worth_refitting` are refitted.
        before: refits under another noise; they are continued from where they ended.
        coarse: coarse refits of this evidence that are known already.
    """
    earlier, known = before or {}, coarse or {}
    floor = _floor(earlier) if earlier else 0.0
    ahead = {name for name, refit in earlier.items() if refit.gain >= floor}
    worth = worth_refitting(evidence, effects)
    worth += [effect for effect in effects if effect.name in ahead and effect not in worth]
    chosen = sorted(worth, key=lambda effect: effect.smooth)  # what takes longest first
    found: dict[str, Refit] = {}
    for general in (False, True):
        round_of = [effect for effect in chosen if bool(effect.limits) == general and _may_explain(effect, found)]
        new = [effect for effect in round_of if effect.name in earlier or effect.name not in known]
        given = [(earlier.get(effect.name), [found[name] for name in effect.limits if name in found]) for effect in new]
        made = {effect.name: known[effect.name] for effect in round_of if effect not in new}
        made |= {refit.names[-1]: refit for refit in extended(_made_of, new, evidence, given)}
        found.update({effect.name: made[effect.name] for effect in round_of if effect.name in made})
    return found


def _made_of(evidence: Evidence, effect: Effect, given: tuple[Refit | None, Sequence[Refit]]) -> Refit:
    """Refit with a cause, from its earlier refit if it has one."""
    earlier, formulas = given
    if earlier is None:
        return refit_with(evidence, effect, formulas)
    return _taken_on(evidence, earlier)


def other_refits(evidence: Evidence, effects: Sequence[Effect]) -> dict[str, Refit]:
    """Refit with every formula that can be identified, whatever its score: a few steps each."""
    chosen = [effect for effect in effects if not effect.learned and not evidence.unidentifiable(effect.name)]
    return {refit.names[-1]: refit for refit in extended(refit_with, chosen, evidence)}


def _may_explain(effect: Effect, found: Mapping[str, Refit]) -> bool:
    """Return whether a candidate is worth a refit: none of its limits was refitted, or one of them is a contender.

    Where all refits are far off, the gains of limits say little.
    """
    limits = [found[name].gain for name in effect.limits if name in found]
    return not limits or max(limits) >= _floor(found) or (not effect.learned and far_off(leader(found).fit))


def far_off(found: Fit) -> bool:
    """Return whether a fit leaves far more than noise."""
    return found.sse > _FAR * found.count


def converged_contenders(found: Mapping[str, Refit]) -> dict[str, Refit]:
    """Follow the contenders to their optimum.

    A formula that is a limit of a contender is followed, too: it is simpler, and may explain as much.
    """
    floor = _floor(found)
    limits = {name for refit in found.values() if refit.gain >= floor for name in refit.effects[-1].limits}
    running = [refit for name, refit in found.items() if refit.gain >= floor or name in limits]
    made = followed(functools.partial(converged_formula, best=leader(found).fit.sse), running)
    return {**found, **{refit.names[-1]: refit for refit in made}}


def leader(found: Mapping[str, Refit]) -> Refit:
    """Return the refit that explains most."""
    return max(found.values(), key=lambda refit: refit.gain)


def _floor(found: Mapping[str, Refit]) -> float:
    """Return the gain above which a refit is a contender: a quarter of the best.

    Where the best fits to within noise, only refits near it are contenders.
    """
    best = leader(found)
    floor = _RUNNING * best.gain
    if best.fit.sse > _MISFIT * best.fit.count:
        return floor
    return max(floor, best.gain - max(_DISTANCE * best.gain, _WEAK))


def refit_nonsmooth(evidence: Evidence, effects: Sequence[Effect]) -> tuple[float, dict[str, Refit]]:
    """Refit with the effects that are not smooth at zero; return the Bonferroni p value of the best, and the refits.

    Their scores say little or nothing. The size is a nuisance under the null: one more degree of freedom stands for
    what choosing it is worth [Davies1977].

    [Davies1977] R. Davies, Biometrika 64.
    """
    tried = [effect for effect in effects if not effect.smooth]
    found = {refit.names[-1]: refit for refit in extended(refit_with, tried, evidence)}
    chances = [p_value_of(refit.gain, refit.degrees_of_freedom + 1) for refit in found.values()]
    return min([1.0, *(len(found) * p for p in chances)]), found


def worth_refitting(evidence: Evidence, effects: Sequence[Effect]) -> list[Effect]:
    """Return the candidates of the best scores, the non-smooth ones, and those that are nearly confounded but close.

    The score of a non-smooth effect says little; that of a nearly confounded one is a difference of large numbers.
    Where all scores are small, those of causes with shapes are taken at the best values of the first one: elsewhere
    they may be next to none.
    """
    scores = {
        effect.name: evidence.statistic(effect.name)
        for effect in effects
        if not (failed([effect.name]) or evidence.unidentifiable(effect.name))
    }
    if max(scores.values(), default=0.0) < _SMALL:
        shaped = [e for e in effects if e.name in scores and e.smooth and any(p.shape for p in e.parameters)]
        for effect, worth in zip(
            shaped, mapped(functools.partial(_best_worth, evidence), shaped, sent=True), strict=True
        ):
            if isinstance(worth, Failure):
                note(worth)
            else:
                scores[effect.name] = max(scores[effect.name], worth)
    ranked = sorted((effect for effect in effects if effect.name in scores), key=lambda effect: -scores[effect.name])
    if not ranked:
        return []
    return [
        effect
        for place, effect in enumerate(ranked)
        if place < _BEST
        or not effect.smooth
        or (scores[effect.name] > scores[ranked[0].name] - _NEAR and evidence.confounded(effect.name) > _HIDDEN)
    ]


def _best_worth(evidence: Evidence, effect: Effect) -> float | Failure:
    """Return what a candidate is worth at the best values of its first shape."""
    return attempted([effect.name], lambda: at_best_shapes(evidence, effect, first_alone=True)[0].worth(effect.name))


def refit_with(evidence: Evidence, effect: Effect, formulas: Sequence[Refit] = (), *, gained: float = 0.0) -> Refit:
    """Add a cause to a fitted model: take a few steps from the best of several starts.

    Args:
        evidence: of the model that it extends.
        effect: the cause.
        gained: what that model gained already against the nominal one.
        formulas: refits of that model with formulas of the cause's mechanism that it has as limits, or nearly.
    """
    base = evidence.problem
    visible = evidence.minimum_detectable(effect.name) if effect.smooth else None
    problem = replace(
        base,
        model=base.model.extended(effect),
        declared={**base.declared, **off_null(effect, visible)},
        slope_step=None if _jerks(effect) else base.slope_step,
    )
    start, least = best_start(evidence, problem, effect, formulas)
    hopeless = not effect.smooth and least > evidence.fit.sse - _HOPELESS  # no size on the grid explains anything
    begun = functools.partial(
        fit_or_raise, problem, tolerance=TOLERANCE, evaluations=1 if hopeless else COARSE[not effect.smooth]
    )
    best = begun(start)
    if best.lost:  # with the cause, the motion may run away at coefficients that a large misfit has bent
        best = begun(problem.start({p.name: problem.named(start)[p.name] for p in effect.parameters}))
    if best.sse > _MISFIT * best.count:  # there may be a lower minimum
        starts = _other_starts(evidence, problem, effect, formulas)
        tried = [fit_or_raise(problem, x, tolerance=TOLERANCE, evaluations=COARSE[True]) for x in starts]
        best = min([best, *tried], key=lambda each: each.objective)
    return Refit(problem.causes, problem, best, gained + evidence.fit.sse - best.sse)


def converged_learned_form(refit: Refit, best: float = np.inf) -> Refit:
    """Follow a coarse refit, its last cause of learned form, to its optimum, with the smoothness that the data ask for.

    Args:
        refit: a coarse one.
        best: least sum of squares of all refits; a refit far behind it is followed less accurately.
    """
    problem, least = refit.problem, min(best, refit.fit.sse)
    problem, found = smoothed(problem, converge(problem, refit.fit.x, refit.fit.sse, least))
    return _resolved(refit.moved(found, problem), least)


def _taken_on(evidence: Evidence, refit: Refit) -> Refit:
    """Return a refit under the noise of the evidence, as many evaluations later as a coarse refit has.

    From where it ended, or from next to nothing of the cause where that is better under this noise.
    """
    problem = having_noise_of(refit.problem, evidence.problem)
    idle = {p.name: p.low for p in problem.declared.values()}
    nothing = problem.start({**idle, **evidence.fit.values})
    start = min((refit.fit.x, nothing), key=lambda x: float(np.sum(problem.residual(x) ** 2)))
    evaluations = COARSE[not refit.effects[-1].smooth]
    here = fit_or_raise(problem, start, tolerance=TOLERANCE, evaluations=evaluations)
    return replace(refit, problem=problem, fit=here, gain=evidence.fit.sse - here.sse)


def converged_formula(refit: Refit, best: float) -> Refit:
    """Follow a refit to its optimum.

    Args:
        refit: a coarse one.
        best: least sum of squares of all refits; a refit far behind it is followed less accurately.
    """
    result = refit.fit
    if result.status != "converged":
        result = converge(refit.problem, result.x, result.sse, best)
    return _resolved(refit.moved(result), best)


def converged_refit(refit: Refit, best: float) -> Refit:
    """Follow a coarse refit to its optimum; where the form of the cause added last is learned, with its smoothness."""
    return converged_learned_form(refit, best) if refit.effects[-1].learned else converged_formula(refit, best)


def converged_in_reach(
    refits: Sequence[Refit], gained: float, reach: Callable[[Refit], float] = attrgetter("reach")
) -> list[Refit]:
    """Follow the refit that may gain most to its optimum, then the others that may come near the best.

    Args:
        refits: coarse ones.
        gained: the largest gain that is known.
        reach: returns the gain that no other refit may exceed if one is to be followed.
    """
    made: list[Refit] = []
    ranked = sorted(refits, key=reach, reverse=True)
    whole = max((refit.gain + refit.fit.sse for refit in refits), default=0.0)  # the same of all
    for some in (ranked[:1], ranked[1:]):
        best = max([gained, *(refit.gain for refit in (*refits, *made))])
        running = [refit for refit in some if reach(refit) >= best]
        made += followed(functools.partial(converged_refit, best=whole - best), running)
    return made


def lowest(refit: Refit) -> Refit:
    """Look for a lower minimum of a refit, by fits to ever longer stretches from the start of every run.

    The longer a run is simulated, the more minima has its sum of squares ([Ribeiro2020]): a short stretch leads out of
    a wrong one.

    [Ribeiro2020] A. Ribeiro, K. Tiels, J. Umenberger, T. Schoen and L. Aguirre, On the smoothness of nonlinear system
    identification, Automatica 121.
    """
    problem, x = refit.problem, refit.fit.x
    for share in _STRETCHES:
        windows = tuple((t.time[0], t.time[0] + share * np.ptp(t.time)) for t in problem.trials)
        x = fit(replace(problem, windows=windows), x, tolerance=_ROUGH, evaluations=_MOST).x
    found = fit(problem, x, tolerance=TOLERANCE, evaluations=_MOST)
    if found.lost or found.objective > (1.0 - _BEHIND) * refit.fit.objective:  # the same minimum
        return refit
    return refit.moved(found)


def _resolved(refit: Refit, best: float) -> Refit:
    """Shorten the integration step where its error would show with the cause in the model, and follow it once more."""
    x, sse = refit.fit.x, refit.fit.sse
    problem = finer(refit.problem, x, _tolerance(sse, best))
    if problem is refit.problem:
        return refit
    result = converge(problem, x, sse, best)
    return refit.moved(result, problem)


def _tolerance(sse: float, best: float) -> float:
    return max(TOLERANCE, _BEHIND * (sse - best) / sse)


def converge(problem: Problem, x: FloatArray, sse: float, best: float) -> Fit:
    """Fit from x, ever finer as long as the result comes near the best.

    Args:
        problem: what is fitted.
        x: (p,) where to start.
        sse: sum of squares there.
        best: the least sum of squares that is known; a fit that stays far above it need not be accurate.
    """
    while True:
        tolerance = _tolerance(sse, best)
        result = fit_or_raise(problem, x, tolerance=tolerance, evaluations=_MOST)
        behind = _BEHIND * (result.sse - best)
        if tolerance == TOLERANCE or result.status != "converged" or behind > 0.5 * tolerance * result.sse:
            return result
        x, sse = result.x, result.sse


#: Sizes of the one-step estimate, and of an amplitude's scale, that a refit starts from.
_MULTIPLES = (0.3, 1.0, 3.0)
#: And of the scale of a cause that is not smooth at its null: an optimum in another minimum is out of a fit's reach.
_GRID = (0.1, 0.2, 0.6, 1.25, 1.5, 1.75, 2.0, 2.5)
#: Change of the sum of squares from which on a size is felt, and how closely the least such is found.
_FELT, _HALVINGS = 0.5, 8
#: Sizes that are tried beside the declared coefficients, in units of an amplitude's scale.
_FAR_SIZES = (1.0, 3.0, 10.0, 30.0)
#: How many of the most promising starts are looked at once more, with the coefficients moved.
_TRIED = 3
#: How often these move on, as long as this share or less is left each time.
_ONWARD, _FALLING = 6, 0.9
#: An amplitude that cannot be negative may come nearer to zero than its effect says (`Effect.least`): to this share of
#: the smallest size that would show.
_OFF_VISIBLE = 0.05


def best_start(
    evidence: Evidence, problem: Problem, effect: Effect, formulas: Sequence[Refit] = ()
) -> tuple[FloatArray, float]:
    """Return the best start (p,) for the fit of a model that is extended by an effect, and its sum of squares.

    Tried are multiples of the one-step estimate and of the declared scale, with the coefficients unchanged, because a
    large effect may lie outside the range of the linearisation; the estimate with the coefficients refitted to first
    order, both at the shapes of the largest score; and almost no effect, so that no refit is worse than none. Where an
    effect has a threshold, sizes above it are tried as well: its minimum may be narrow.

    Args:
        evidence: of the model that is extended.
        problem: of the extended one.
        effect: the cause that it is extended by.
        formulas: see `refit_with`.
    """
    shapes: dict[str, float] = {}
    if effect.smooth and not effect.learned and any(p.shape for p in effect.parameters):
        evidence, shapes = at_best_shapes(evidence, effect)
    values, one_step = {**shapes, **evidence.fit.values}, evidence.first_guess(effect.name)
    tried = _Tried(evidence.fit, problem.rough)
    for guess in guesses(effect, one_step):
        tried.add(problem.start({**values, **guess}))
    tried.add(problem.start({**shapes, **evidence.refitted(effect.name, one_step), **_inside(effect, one_step)}))
    tried.add(problem.start(values))
    for like in _like(effect, formulas):
        tried.add(np.clip(problem.start(like), *bounds(problem.parameters)))
        if not effect.learned and any(like[p.name] == p.default for p in effect.amplitudes()):
            for guess in guesses(effect, one_step):  # at the limit this amplitude is null, and has no gradient
                tried.add(problem.start({**like, **guess}))
    amplitudes = evidence.amplitudes_of(effect.name)
    if not effect.smooth and len(amplitudes) == 1:
        find_threshold(tried, [p.name for p in problem.parameters].index(amplitudes[0].name))
    return tried.best()


def _like(effect: Effect, formulas: Iterable[Refit]) -> Iterator[dict[str, float]]:
    """Yield the values at which a learned form is like each refit with a formula of its mechanism."""
    for formula in formulas:
        of_formula = formula.effects[-1]
        if own := effect.like(of_formula.name, of_formula.short_values(formula.fit.values)):
            yield {**formula.fit.values, **{f"{effect.name}.{k}": v for k, v in own.items()}}


class _Tried:
    """Starts, the free parameters of a fit moved to where they belong at each.

    They move by (J'J)^-1 J' e, and what is left of e beyond the span of J is what a start is judged by: variable
    projection [GolubPereyra1973] with J at that fit.

    [GolubPereyra1973] G. Golub and V. Pereyra, SIAM Journal on Numerical Analysis 10.
    """

    def __init__(self, found: Fit, problem: Problem) -> None:
        self.problem = problem
        names = [p.name for p in problem.parameters]
        self._columns = np.array(
            [names.index(found.parameters[i].name) for i in np.flatnonzero(~found.at_bound)], dtype=np.int64
        )
        self._jacobian = found.jacobian.chosen(~found.at_bound)
        self.starts: list[FloatArray] = []
        self.moved: list[FloatArray] = []
        self.squares: list[float] = []
        self.promised: list[float] = []

    def add(self, start: FloatArray) -> float:
        """Try a start (p,); return the sum of squares that is promised there."""
        residual = self.problem.residual(start)
        step = self._jacobian.solve(residual, 1e-8)
        self.starts.append(start)
        self.moved.append(self._moved(start, step))
        self.squares.append(float(residual @ residual))
        self.promised.append(float(np.sum((residual - self._jacobian @ step) ** 2)))
        return self.promised[-1]

    def best(self) -> tuple[FloatArray, float]:
        """Return the start of the least sum of squares, and that; the most promising are simulated where they moved.

        They move on from there, without what rests on a bound, as long as less and less is left.
        """
        starts, left = [*self.starts], [*self.squares]
        low, high = bounds(self.problem.parameters)
        for x in [self.moved[i] for i in np.argsort(self.promised)[:_TRIED]]:
            before = np.inf
            for _ in range(_ONWARD):
                residual = self.problem.residual(x)
                starts.append(x)
                left.append(float(residual @ residual))
                if left[-1] > _FALLING * before:
                    break
                before, inside = left[-1], ((x > low) & (x < high))[self._columns]
                step = np.zeros(len(inside))
                step[inside] = self._jacobian.chosen(inside).solve(residual, 1e-8)
                x = self._moved(x, step)
        return np.asarray(starts[int(np.argmin(left))]), float(min(left))

    def _moved(self, x: FloatArray, step: FloatArray) -> FloatArray:
        moved = x.copy()
        moved[self._columns] += step
        return np.clip(moved, *bounds(self.problem.parameters))


def find_threshold(tried: _Tried, column: int) -> None:
    """Bisect where the amplitude of a column begins to change the fit, and where it leaves more than an idle one.

    In between it explains something; near the upper end is the minimum of an amplitude that is hardly met most of the
    time. The fit is compared with that of an almost zero effect, not of none: an idle effect passes the motion through
    another computation, and precise data may show its rounding errors.
    """
    sizes, promised = np.array([start[column] for start in tried.starts]), np.array(tried.promised)
    least = int(np.argmin(np.where(sizes > sizes.min(), sizes, np.inf)))
    idle = float(promised[least])
    responds = np.abs(promised - idle) > _FELT
    if responds.all() or not np.any(responds & (sizes > sizes[~responds].max())):
        return
    start = tried.starts[int(np.argmax(np.where(responds, -np.inf, sizes)))]

    def at(size: float) -> float:
        return tried.add(np.where(np.arange(len(start)) == column, size, start)) - idle

    def least_of(low: float, high: float, beyond: Callable[[float], bool]) -> float:
        """Return the least size that is beyond, where `low` is not and `high` is."""
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            low, high = (low, middle) if beyond(at(middle)) else (middle, high)
        return high

    if abs(at(0.5 * float(sizes[least]))) > _FELT:
        return  # every size changes the fit: there is no threshold
    above = responds & (sizes > start[column])
    threshold = least_of(float(start[column]), float(sizes[above].min()), lambda more: abs(more) > _FELT)
    worse = sizes[above & (promised > idle)]
    if len(worse):
        least_of(threshold, float(worse.min()), lambda more: more > 0.0)


def guesses(effect: Effect, one_step: Mapping[str, float]) -> list[dict[str, float]]:
    """Return amplitudes that a fit may start from: multiples of the one-step estimate and of the declared scale."""
    amplitudes = effect.amplitudes()
    found = [
        {p.name: p.default + multiple * (one_step[p.name] - p.default) for p in amplitudes} for multiple in _MULTIPLES
    ]
    found += _multiples_of_scale(effect, one_step, _MULTIPLES if effect.smooth else (*_GRID, *_MULTIPLES[1:]))
    if not effect.smooth and len(amplitudes) > 1:  # one joint may be worn alone
        null = {p.name: p.default for p in amplitudes}
        found += [{**null, p.name: p.default + by * p.scale} for p in amplitudes for by in _MULTIPLES]
    if effect.starts_off_null():
        found += [{p.name: p.default + share * (p.start - p.default) for p in amplitudes} for share in (1.0, 2.0)]
    return [_inside(effect, guess) for guess in found]


def _other_starts(evidence: Evidence, problem: Problem, effect: Effect, formulas: Sequence[Refit]) -> list[FloatArray]:
    """Return starts (p,) of further fits, for a model that leaves more than noise after the first one.

    A learned form that is not smooth at its null has several minima: it begins at each formula. A formula begins at the
    declared coefficients where the model that it extends is far off: the fit of that one bends the coefficients, and
    beside bent ones no size of the true cause explains anything. Its size is the one that leaves least there; if none
    leaves less than the null, there is no such start.

    Args:
        evidence, problem, effect, formulas: as of `best_start`.
    """
    if effect.learned:
        return [] if effect.smooth else [problem.start(values) for values in _like(effect, formulas)]
    if not far_off(evidence.fit):
        return []
    causes = {p.name for cause in evidence.problem.causes for p in cause.parameters}
    kept = {name: value for name, value in evidence.fit.values.items() if name in causes}
    sizes = _multiples_of_scale(effect, evidence.first_guess(effect.name), _FAR_SIZES)
    starts = [problem.start(kept), *(problem.start({**kept, **_inside(effect, size)}) for size in sizes)]
    least = int(np.argmin([np.sum(left**2) for left in map(problem.rough.residual, starts)]))
    return [starts[least]] if least else []


def _multiples_of_scale(
    effect: Effect, one_step: Mapping[str, float], multiples: Sequence[float]
) -> list[dict[str, float]]:
    """Return amplitudes that are multiples of their scales off the null, to the side of the one-step estimate."""
    sides = {p: -1.0 if one_step[p.name] < p.default else 1.0 for p in effect.amplitudes()}
    return [{p.name: p.default + by * side * p.scale for p, side in sides.items()} for by in multiples]


def _inside(effect: Effect, guess: Mapping[str, float]) -> dict[str, float]:
    return {p.name: float(np.clip(guess[p.name], p.low, p.high)) for p in effect.amplitudes()}


def off_null(effect: Effect, visible: Mapping[str, float] | None = None) -> dict[str, Parameter]:
    """Return non-negative amplitudes with a lower bound slightly above zero, where two-sided derivatives exist.

    Args:
        effect: whose amplitudes.
        visible: the minimum detectable sizes, where they are known: the bound stays well below them.
    """
    lifted = {}
    for p in effect.parameters:
        if not p.shape and p.default == p.low:
            off = min(effect.least * p.scale, _OFF_VISIBLE * (visible or {}).get(p.name, np.inf))
            lifted[p.name] = p.rebound(low=p.low + off, start=max(p.start, p.low + off))
    return lifted
