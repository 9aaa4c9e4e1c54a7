"""Screening: fit the nominal model, estimate the noise, test the residual, and refit with every candidate.

[Rosenthal1983] R. Rosenthal and D. Rubin, Psychological Bulletin 94: Bonferroni's bound with unequal shares.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from mjfish.data.trial import Filter
from mjfish.diagnosis.evidence import Evidence, gather, signatures, tail, under
from mjfish.diagnosis.failures import NOMINAL, finite, sound
from mjfish.diagnosis.refit import (
    converge,
    converged_contenders,
    converged_formula,
    far_off,
    leader,
    other_refits,
    refit_nonsmooth,
    refits,
    resolved,
)
from mjfish.diagnosis.refit_result import Refit, followed
from mjfish.diagnosis.thresholds import THRESHOLDS
from mjfish.effects import Effect
from mjfish.estimation import Fit, Noise, Problem, fit
from mjfish.estimation.marginal_likelihood import CLEAR, log_likelihood_gained, of_every_run, with_size
from mjfish.estimation.noise_of_fit import noise_of, smoothing_of, walk_of
from mjfish.estimation.problem import Slopes
from mjfish.estimation.sensor_noise import having_noise_of, with_sensor_noise
from mjfish.execution import execution
from mjfish.noise import DifferentiationNoise, GaussMarkov
from mjfish.numerics.arrays import FloatArray
from mjfish.numerics.sized_cache import Recomputable

#: Residuals that another noise changes by a smaller share than this are weighed alike.
_SAME = 0.1
#: Shares of the false-alarm rate that the tests use [Rosenthal1983]: the candidates' scores, the omnibus basis, and the
#: refits of non-smooth effects. The first has most power; what the others find is seldom close.
_DIRECTED, _OMNIBUS, _NONSMOOTH = 0.625, 0.125, 0.25
#: P value below which uncertainty of the noise is no explanation.
_BEYOND = 1e-12
#: Rounds of estimating the noise of sensors before the nominal fit, and beside a walk; most evaluations of the former.
_ROUNDS, _ROUGH = 2, 15
#: Mean square under a known noise below which a refit tells the noise, where the nominal model is far off.
_FITTED = 1.5


@dataclass(frozen=True, eq=False)
class Screening:
    """What the screening found.

    Attributes:
        evidence: at the fit of the nominal model.
        refits: every candidate fitted together with the coefficients, by name; none where nothing is wrong.
        p_wrong: p value of the nominal model.
        directed: whether the candidates' own signatures show in the residual, and not the omnibus basis alone.
        remark: on the noise of velocities.
    """

    evidence: Evidence
    refits: Mapping[str, Refit]
    p_wrong: float
    directed: bool
    remark: str = ""


def screen(
    problem: Problem,
    candidates: tuple[Effect, ...],
    stated: FloatArray | None,
    *,
    walks: bool,
) -> Screening:
    """Fit the nominal model, estimate the noise, test the residual, and refit with every candidate.

    The noise is estimated again with the best cause in the model; where it differs, test and refits are repeated. Where
    the residual shows that the recording was smoothed, predictions are smoothed alike, and all is repeated. Where
    velocities are differentiated positions, half a window is left out at the ends of runs.

    Args:
        problem: of the nominal model.
        candidates: effects that apply to the dataset.
        stated: (3,) standard deviations of the noise that the dataset states; None: it states none.
        walks: whether it is asked if the clock of the drive wanders.
    """
    execution().meter.stage("fitting the nominal model", 0.06)
    problem, start = resolved(problem)
    for _ in range(_ROUNDS if problem.sensors else 0):
        problem = with_sensor_noise(problem, start)
        start = sound(NOMINAL, fit(problem, start, tolerance=1e-3, evaluations=_ROUGH)).x
    problem = with_sensor_noise(problem, start)
    baseline, slopes = _fitted(problem, start, candidates)
    execution().meter.stage("testing and refitting the candidates", 0.45)
    if not problem.samples:
        return _screened_sensors(problem, baseline, slopes, candidates)
    noise, _ = noise_of(problem, baseline, slopes().velocity, stated, patterns=False)
    if isinstance(noise, DifferentiationNoise):  # at the ends a filter has less to go on, and its errors are larger
        problem = replace(problem, ends=noise.window // 2)
        baseline, slopes = _fitted(problem, baseline.x, candidates)
    results: dict[Filter | None, Screening] = {}
    smoothing, known = problem.smoothing, problem.smoothing is not None
    while smoothing not in results:
        if smoothing != problem.smoothing:
            problem = replace(problem, smoothing=smoothing)
            baseline, slopes = _fitted(problem, baseline.x, candidates)
        results[problem.smoothing], smoothing = _screened(problem, baseline, slopes, candidates, stated, walks=walks)
        if known:  # the dataset says through which filter its velocities went
            smoothing = problem.smoothing
    screening = results[smoothing]
    if smoothing is not None and not known:
        remark = f"{screening.remark}; the motion was smoothed with it, and predictions are, too: {smoothing.words}"
        return replace(screening, remark=remark)
    return screening


def _screened_sensors(
    problem: Problem,
    baseline: Fit,
    slopes: Recomputable[Slopes],
    candidates: tuple[Effect, ...],
) -> Screening:
    """Screen where sensors alone were measured, whose noise is white and known from their third differences."""
    seen = _NominalTest(candidates, slopes).run(problem, baseline, problem.noise)
    if seen.p_wrong >= THRESHOLDS.alarm:
        return Screening(seen.evidence, {}, seen.p_wrong, directed=False)
    refitted = _begun(seen.evidence, candidates, seen.refits)
    best = leader(refitted) if refitted else None
    # along the rollouts of the best model, for those of a wrong one are not where the fish was
    if best and not _alike(best.problem, known := with_sensor_noise(best.problem, best.fit.x), best.fit):
        problem = having_noise_of(problem, known)
        begun = float(np.sum(problem.residual(baseline.x) ** 2))
        baseline = sound(NOMINAL, converge(problem, baseline.x, begun, best.fit.sse))
        slopes = _signatures(problem, baseline.values, candidates)
        seen = _NominalTest(candidates, slopes).run(problem, baseline, problem.noise)
        refitted = refits(seen.evidence, candidates, refitted, seen.refits)
    if refitted:
        refitted = converged_contenders(refitted)
    return Screening(seen.evidence, refitted, seen.p_wrong, seen.directed < THRESHOLDS.alarm)


def _screened(
    problem: Problem,
    baseline: Fit,
    slopes: Recomputable[Slopes],
    candidates: tuple[Effect, ...],
    stated: FloatArray | None,
    *,
    walks: bool,
) -> tuple[Screening, Filter | None]:
    """Screen with the smoothing of the problem; return the screening, and the suggested smoothing."""
    noise, remark = noise_of(problem, baseline, slopes().velocity, stated, patterns=False)
    if walks and (size := walk_of(problem, baseline, slopes().velocity, noise)):
        problem, baseline, slopes = _walking(problem, baseline, slopes, size, candidates, stated)
        noise, remark = noise_of(problem, baseline, slopes().velocity, stated, patterns=False)
    known_noise = stated is not None and not problem.walk
    begun = (
        _begun(gather(problem, baseline, candidates, slopes), candidates) if known_noise and far_off(baseline) else {}
    )
    refitted = begun if begun and _fits(leader(begun)) else {}
    if refitted:  # what no linearised model explains of a large misfit would be taken for noise
        best = leader(refitted)
        noise, remark = noise_of(best.problem, best.fit, _beside(best, candidates)[1]().velocity, stated)
    test = _NominalTest(candidates, slopes)
    seen = test.run(problem, baseline, noise)
    if seen.p_wrong >= THRESHOLDS.alarm:  # patterns common to all runs may be taken for noise
        noise, remark = noise_of(problem, baseline, slopes().velocity, stated)
        seen = test.repeat(seen, noise)
    if seen.p_wrong < THRESHOLDS.alarm:
        earlier, known = refitted, seen.refits
        if seen.evidence.problem is problem:  # under the same noise, they are refits of this evidence already
            earlier, known = {}, {**seen.refits, **refitted}
        refitted = refits(seen.evidence, candidates, earlier, known)
    else:
        refitted = {}
    if not refitted:
        smoothing = smoothing_of(problem, baseline, noise, candidates, slopes().velocity)
    else:
        best = _led(refitted)
        others, beside = _beside(best, candidates)
        noise, remark = noise_of(best.problem, best.fit, beside().velocity, stated)
        smoothing = smoothing_of(best.problem, best.fit, noise, others, beside().velocity)
        before, seen = seen, test.repeat(seen, noise)
        if seen.p_wrong >= THRESHOLDS.alarm:
            refitted = {}
        elif seen is not before:
            refitted = refits(seen.evidence, candidates, refitted)
    if refitted:
        refitted = converged_contenders(refitted)
    return Screening(seen.evidence, refitted, seen.p_wrong, seen.directed < THRESHOLDS.alarm, remark), smoothing


def _walking(
    problem: Problem,
    baseline: Fit,
    slopes: Recomputable[Slopes],
    size: float,
    candidates: tuple[Effect, ...],
    stated: FloatArray | None,
) -> tuple[Problem, Fit, Recomputable[Slopes]]:
    """Return the problem with a walk of the drive's clock, its fit, and the signatures there.

    Size and noise depend on each other. A walk that gains little, or less than a candidate does, is left out again.
    """
    walking, found, along = before = problem, baseline, slopes
    for _ in range(_ROUNDS):
        noise, _ = noise_of(walking, found, along().velocity, stated, patterns=False)
        walking, found = with_size(replace(problem, noise=noise), found, size)
        if not walking.walk:
            return before
        size, along = walking.walk, _signatures(walking, found.values, candidates)
    if log_likelihood_gained(walking, found) < CLEAR or not of_every_run(walking, found):
        return before
    # what no linearised model explains of a large misfit may look like a walk
    rivals = refits(gather(problem, baseline, candidates, slopes), candidates)
    left = float(np.sum(replace(walking, noise=problem.noise).residual(found.x) ** 2))
    return before if rivals and leader(rivals).fit.sse < left else (walking, found, along)


def _begun(
    evidence: Evidence, candidates: tuple[Effect, ...], coarse: Mapping[str, Refit] | None = None
) -> dict[str, Refit]:
    """Return the first refits of the nominal model, the best one followed to its optimum.

    Where that model is far off, the score of the true cause may be small: if the best does not fit, every formula is
    refitted.
    """
    found = refits(evidence, candidates, None, coarse)
    if found and not _fits(_led(found)) and far_off(evidence.fit):
        found |= other_refits(evidence, [e for e in candidates if e.name not in found])
        _led(found)
    return found


def _fits(refit: Refit) -> bool:
    """Return whether a refit leaves little more than the noise of its problem."""
    return refit.fit.sse < _FITTED * refit.fit.count


def _led(found: dict[str, Refit]) -> Refit:
    """Follow the refit that explains most to its optimum, put it in the place of the coarse one, and return it."""
    best = leader(found)
    found.update({refit.names[-1]: refit for refit in followed(partial(converged_formula, best=best.fit.sse), [best])})
    return found[best.names[-1]]


def _beside(best: Refit, candidates: tuple[Effect, ...]) -> tuple[tuple[Effect, ...], Recomputable[Slopes]]:
    """Return the candidates that a refit lacks, and their signatures there."""
    others = tuple(effect for effect in candidates if effect.name not in best.names)
    return others, _signatures(best.problem, best.fit.values, others)


def _fitted(problem: Problem, start: FloatArray, candidates: tuple[Effect, ...]) -> tuple[Fit, Recomputable[Slopes]]:
    """Return the fit of the nominal model, and the signatures of candidates there."""
    baseline = sound(NOMINAL, fit(problem, start, tolerance=1e-6))
    return baseline, _signatures(problem, baseline.values, candidates)


def _signatures(problem: Problem, values: Mapping[str, float], candidates: tuple[Effect, ...]) -> Recomputable[Slopes]:
    """Return the signatures of candidates, made: those that fail are noted here."""
    make = partial(signatures, problem, values, candidates)
    return Recomputable(make, make())


@dataclass(frozen=True, eq=False)
class _Tested:
    """A test of the nominal model under a noise: evidence, p values of the directed and of all tests, coarse refits."""

    evidence: Evidence
    directed: float
    p_wrong: float
    refits: Mapping[str, Refit]


@dataclass(frozen=True, eq=False)
class _NominalTest:
    """Fits the nominal model under a noise and tests its residual."""

    candidates: tuple[Effect, ...]
    slopes: Recomputable[Slopes]

    def run(self, problem: Problem, baseline: Fit, noise: Noise) -> _Tested:
        """Return the test under a noise; the baseline is the fit under that of the problem."""
        slopes = self.slopes
        if noise is not problem.noise and not _alike(problem, replace(problem, noise=noise), baseline):
            problem = replace(problem, noise=noise)
            # taken at another fit, an unidentifiable effect would seem to show
            baseline, slopes = _fitted(problem, baseline.x, self.candidates)
        evidence = gather(problem, baseline, self.candidates, slopes)
        directed, p_wrong = self._p_values(evidence)
        found: dict[str, Refit] = {}
        if p_wrong >= THRESHOLDS.alarm:
            p_nonsmooth, found = refit_nonsmooth(evidence, self.candidates)
            p_wrong = min(p_wrong, p_nonsmooth / _NONSMOOTH)
        elif isinstance(noise, GaussMarkov) and p_wrong > _BEYOND:
            p_wrong = max(
                p_wrong, float(np.mean([self._p_values(likely)[1] for likely in under(evidence, noise.likely, slopes)]))
            )
        return _Tested(evidence, directed, p_wrong, found)

    def _p_values(self, evidence: Evidence) -> tuple[float, float]:
        """Return the p values of the directed test, and of it and the omnibus basis together."""
        directed, omnibus = evidence.directed_p(), tail(*evidence.omnibus)
        finite("the test of the residual", directed=directed, omnibus=omnibus)
        return directed, min(1.0, directed / _DIRECTED, omnibus / _OMNIBUS)

    def repeat(self, seen: _Tested, noise: Noise) -> _Tested:
        """Return the test under another noise; the same test where the two noises are nearly equal."""
        problem, baseline = seen.evidence.problem, seen.evidence.fit
        return seen if _alike(problem, replace(problem, noise=noise), baseline) else self.run(problem, baseline, noise)


def _alike(one: Problem, other: Problem, fitted: Fit) -> bool:
    """Return whether two noises of a problem weigh nearly alike what a fit leaves: of velocities, else of sensors."""
    here, there = (problem.residual(fitted.x)[: one.samples or None] for problem in (one, other))
    return bool(np.linalg.norm(here - there) <= _SAME * np.linalg.norm(here))
