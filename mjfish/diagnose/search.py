"""The search: fit the nominal model, test its residual, refit it with every candidate, under a noise that holds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from mjfish.arrays import FloatArray
from mjfish.diagnose.evidence import Evidence, gather
from mjfish.diagnose.noise import noise_of
from mjfish.diagnose.progress import Progress
from mjfish.diagnose.refit import Refit, refits
from mjfish.diagnose.verdict import ALARM
from mjfish.effects import Effect
from mjfish.identify import Fit, Noise, Problem, fit

#: How often the noise is estimated again after the best cause is in the model.
_ROUNDS = 1
#: A change of sigma by less than this share leaves the weights as they are.
_SAME = 0.05
#: Integration steps that are tried [s], and what their error may add to a sum of squares in units of the noise.
_STEPS = (0.01, 0.005, 0.0025, 0.00125)
_UNSEEN = 0.1


@dataclass(frozen=True, eq=False)
class Findings:
    """What the search found.

    Attributes:
        evidence: at the fit of the nominal model.
        refits: every candidate fitted together with the coefficients, by name; none where nothing is wrong.
        p_wrong: p value of the nominal model.
        directed: whether the candidates' own signatures show in the residual, and not the omnibus basis alone.
    """

    evidence: Evidence
    refits: Mapping[str, Refit]
    p_wrong: float
    directed: bool


def search(
    problem: Problem,
    candidates: tuple[Effect, ...],
    stated: FloatArray | None,
    rng: np.random.Generator,
    progress: Progress,
) -> tuple[Findings, str]:
    """Fit, test and refit; again with better noise, where the first noise does not hold once the best cause is in."""
    remark = ""
    progress("fitting the nominal model", 0.02)
    problem, start = _resolved(problem)
    refitted: Mapping[str, Refit] = {}
    for round_ in range(_ROUNDS + 1):
        progress("fitting the nominal model", 0.02)
        baseline = fit(problem, start, tolerance=1e-6)
        evidence = gather(problem, baseline, candidates)
        progress("testing the residual", 0.15)
        directed, omnibus = evidence.directed_p(rng), evidence.omnibus_p()
        p_wrong = min(1.0, 2.0 * min(directed, omnibus))
        wrong = p_wrong < ALARM

        def shown(what: str, done: float) -> None:
            progress(what, 0.2 + 0.7 * done)

        refitted = refits(evidence, candidates, shown, refitted) if wrong else {}
        findings = Findings(evidence, refitted, p_wrong, directed < ALARM)
        if round_ == _ROUNDS:
            break
        reference = max(refitted.values(), key=lambda one: one.gain) if refitted else None
        noise, remark = noise_of(
            replace(reference.problem if reference else problem, noise=_white(problem.noise)),
            _reweighted(reference.problem if reference else problem, reference.fit if reference else baseline),
            tuple(e for e in candidates if reference is None or e.name != reference.effect.name),
            stated,
        )
        if _same(noise, problem.noise):
            break
        problem = replace(problem, noise=noise)
        start = baseline.x
    return findings, remark


def _resolved(problem: Problem) -> tuple[Problem, FloatArray]:
    """Return the problem with the longest step whose error the data cannot see, and the fit there as a start.

    The error is the change of the whitened prediction on halving the step; its sum of squares is what the step adds to
    any statistic.
    """
    problem = replace(problem, model=replace(problem.model, step=_STEPS[0]))
    x = problem.start()
    for finer in _STEPS[1:]:
        x = fit(problem, x, tolerance=1e-4).x
        halved = replace(problem, model=replace(problem.model, step=finer))
        if float(np.sum((problem.residual(x) - halved.residual(x)) ** 2)) < _UNSEEN:
            break
        problem = halved
    return problem, x


def _white(noise: Noise) -> Noise:
    return Noise.white(noise.sigma)


def _reweighted(problem: Problem, one: Fit) -> Fit:
    """Return the fit with residual and Jacobian in the white metric of its problem's sigma."""
    if problem.noise.order == 0:
        return one
    white = replace(problem, noise=_white(problem.noise))
    return replace(one, residual=white.residual(one.x), jacobian=white.jacobian(one.x))


def _same(new: Noise, old: Noise) -> bool:
    return new.order == old.order == 0 and bool(np.all(np.abs(new.sigma / old.sigma - 1.0) < _SAME))
