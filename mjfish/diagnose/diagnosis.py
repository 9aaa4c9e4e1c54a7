"""The whole way from a dataset to a verdict and the gain it brings."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence

import numpy as np

from mjfish.diagnose import heldout, provenance
from mjfish.diagnose.evidence import Evidence
from mjfish.diagnose.locate import Where, locate
from mjfish.diagnose.progress import Progress, silent
from mjfish.diagnose.refit import Refit
from mjfish.diagnose.result import Candidate, Cause, Diagnosis, Estimate, Overlay
from mjfish.diagnose.search import Findings, search
from mjfish.diagnose.select import Standing, chance, standings
from mjfish.diagnose.several import several
from mjfish.diagnose.verdict import Hearing, Ruling, rule
from mjfish.effects import Effect, catalogue
from mjfish.errors import InputError
from mjfish.identify import Fit, Noise, Problem
from mjfish.identify.fit import Z95
from mjfish.identify.report import first_sigma
from mjfish.identify.score import Score, predict_held_out
from mjfish.model import Model
from mjfish.trial import Dataset, Trial


def diagnose(
    dataset: Dataset,
    *,
    effects: Mapping[str, Effect] | None = None,
    seed: int = 0,
    jobs: int | None = None,
    progress: Progress = silent,
) -> Diagnosis:
    """Find out what is wrong with the simulation of a dataset, name the cause, and measure the gain.

    The nominal model is fitted to the fit trials; its residual is tested for anything systematic. Where there is
    some, every candidate is fitted together with the coefficients, and `mjfish.diagnose.verdict.rule` decides.

    Args:
        dataset: with its trials split into fit and held out (see `Dataset.split`).
        effects: candidates by name; None: the shipped catalogue.
        seed: of the simulated null distributions and the bootstrap; the same seed gives the same answer.
        jobs: threads; None: one a processor. The answer does not depend on it.
        progress: told what is being done.
    """
    rng = np.random.default_rng(seed)
    candidates = tuple((catalogue() if effects is None else dict(effects)).values())
    reasons = {effect.name: effect.not_applicable(dataset) for effect in candidates}
    applicable = tuple(effect for effect in candidates if not reasons[effect.name])
    fitted, held = dataset.split()
    if not applicable:
        raise InputError(f"{dataset.name}: none of the {len(candidates)} effects applies to this dataset; add one")
    stated = None if dataset.noise is None else np.asarray(dataset.noise)
    problem = Problem(
        Model(dataset.fish),
        fitted,
        Noise.white(stated if stated is not None else first_sigma(fitted)),
        free_clock=dataset.clock == "free",
        jobs=jobs or os.cpu_count() or 1,
    )
    findings, noise_remark = search(problem, applicable, stated, rng, progress)
    evidence, refitted = findings.evidence, findings.refits

    progress("comparing the candidates", 0.75)
    scores = _Scores(evidence, held)
    standing = standings(refitted, applicable, rng) if refitted else {}
    single = Hearing(
        {(name,): one for name, one in refitted.items()},
        {(name,): one for name, one in standing.items()},
        {(name,): scores.gained(refitted[name], None) for name, one in standing.items() if one.in_set},
    )
    several_ = None
    if refitted and not single.staying(clean=True):
        several_ = _several(refitted, applicable, scores, rng, progress)
    ruling = rule(findings.p_wrong, single, several_)
    best = _best(ruling, single, several_)
    gain = heldout.gain(scores.of(None), scores.of(best), held, rng) if best is not None and held else None
    progress("done", 1.0)

    final = evidence.fit if best is None else best.fit
    extended_problem = evidence.problem if best is None else best.problem
    return Diagnosis(
        dataset=dataset,
        verdict=ruling.verdict,
        message=ruling.message,
        status="ok" if {evidence.fit.status, final.status} == {"converged"} else "fit_not_converged",
        remarks=_remarks(noise_remark, evidence, held),
        causes=_causes(best) if ruling.verdict == "named" else (),
        rivals=_rivals(ruling),
        alternatives=ruling.sets,
        candidates=_candidates(candidates, reasons, evidence, refitted, standing, single),
        best=None if best is None else " with ".join(best.names),
        where=_where(findings),
        p_wrong=findings.p_wrong,
        gain=gain,
        nominal=_estimates(evidence.fit, evidence.problem.model),
        extended=_estimates(final, extended_problem.model),
        nominal_model=evidence.problem.model,
        extended_model=extended_problem.model,
        overlays=_overlays(evidence, extended_problem, final, held, scores, best),
        provenance=provenance.provenance(dataset, seed),
    )


class _Scores:
    """Held-out scores of models, each made once."""

    def __init__(self, evidence: Evidence, held: tuple[Trial, ...]) -> None:
        self.evidence, self.held = evidence, held
        self.known: dict[tuple[str, ...], Score] = {}

    def of(self, one: Refit | None) -> Score:
        """Return the score of a refit, None: of the nominal model."""
        names = () if one is None else one.names
        if names not in self.known:
            problem, fitted = (self.evidence.problem, self.evidence.fit) if one is None else (one.problem, one.fit)
            self.known[names] = predict_held_out(problem, fitted.values, self.held)
        return self.known[names]

    def gained(self, one: Refit, against: Refit | None) -> float | None:
        """Return the log-likelihood that a refit gains on the held-out trials; None where there are none."""
        if not self.held:
            return None
        return 0.5 * (sum(self.of(against).whitened_sse) - sum(self.of(one).whitened_sse))


def _several(
    singles: Mapping[str, Refit],
    candidates: Sequence[Effect],
    scores: _Scores,
    rng: np.random.Generator,
    progress: Progress,
) -> Hearing | None:
    def shown(what: str, done: float) -> None:
        progress(what, 0.8 + 0.15 * done)

    sets = several(singles, candidates, rng, shown)
    if sets is None:
        return None
    staying = [names for names, one in sets.standings.items() if one.in_set]
    held_out = {names: scores.gained(sets.refits[names], sets.parts[names]) for names in staying}
    return Hearing(sets.refits, sets.standings, held_out)


def _best(ruling: Ruling, single: Hearing, several_: Hearing | None) -> Refit | None:
    """Return whose extended model is shown: the named one's, else that of the largest gain among single causes."""
    for hearing in (single, several_):
        if hearing is not None and ruling.sets and ruling.sets[0] in hearing.refits:
            return hearing.refits[ruling.sets[0]]
    return max(single.refits.values(), key=lambda one: one.gain) if single.refits else None


def _causes(best: Refit | None) -> tuple[Cause, ...]:
    if best is None:
        return ()
    return tuple(Cause(effect.name, effect.summary, _own(best, effect)) for effect in best.effects)


def _rivals(ruling: Ruling) -> tuple[tuple[str, ...], ...]:
    """Return the names in which the sets that stay differ."""
    if ruling.verdict != "cannot_tell":
        return ()
    shared = set.intersection(*map(set, ruling.sets))
    ordered = dict.fromkeys(name for names in ruling.sets for name in names if name not in shared)
    return (tuple(ordered),)


def _where(findings: Findings) -> Where | None:
    return locate(findings.evidence, findings.directed) if findings.refits else None


def _estimates(one: Fit, model: Model) -> dict[str, Estimate]:
    """Return the model's estimates by name, without what belongs to single trials.

    A refit keeps a little off the null where an amplitude cannot be negative; an interval that reaches there reaches 0.
    """
    result = {}
    declared = {p.name: p for p in model.parameters}
    for p, at_bound in zip(one.parameters, one.at_bound, strict=True):
        if p.name in declared:
            low, high = one.interval(p.name, Z95)
            low = declared[p.name].low if low <= p.low else low
            result[p.name] = Estimate(one.values[p.name], low, high, p.unit, bool(at_bound))
    return result


def _own(one: Refit, effect: Effect) -> dict[str, Estimate]:
    estimates = _estimates(one.fit, one.problem.model)
    return {p.short: estimates[p.name] for p in effect.parameters}


def _candidates(
    effects: Sequence[Effect],
    reasons: Mapping[str, str],
    evidence: Evidence,
    refitted: Mapping[str, Refit],
    standing: Mapping[str, Standing],
    single: Hearing,
) -> tuple[Candidate, ...]:
    result = []
    for effect in effects:
        name = effect.name
        if reasons[name]:
            result.append(Candidate(name, False, remark=reasons[name]))
            continue
        one, place = refitted.get(name), standing.get(name)
        statistic = one.gain if one else evidence.statistic(name)
        freedom = one.freedom if one else sum(not p.shape for p in effect.parameters)
        result.append(
            Candidate(
                name=name,
                applicable=True,
                score=evidence.statistic(name),
                statistic=statistic,
                freedom=freedom,
                p_value=chance(statistic, freedom),
                rival_p=place.rival_p if place else None,
                fit_p=min(place.saturated_p, place.omnibus_p) if place and place.in_set else None,
                held_out_gain=single.held_out.get((name,)),
                absorbed=evidence.absorbed(name),
                smallest_visible=evidence.smallest_visible(name),
                parameters=_own(one, effect) if one else None,
            )
        )
    return tuple(sorted(result, key=lambda candidate: -candidate.statistic))


def _remarks(noise: str, evidence: Evidence, held: Sequence[Trial]) -> tuple[str, ...]:
    remarks = [noise] if noise else []
    for p, at_bound in zip(evidence.fit.parameters, evidence.fit.at_bound, strict=True):
        if at_bound:
            remarks.append(f"{p.name} of the nominal model rests on its bound {evidence.fit.values[p.name]:g}")
    if not held:
        remarks.append("no held-out trial: the gain cannot be measured; record or set aside one more trial")
    return tuple(remarks)


def _overlays(
    evidence: Evidence, extended: Problem, final: Fit, held: Sequence[Trial], scores: _Scores, best: Refit | None
) -> tuple[Overlay, ...]:
    nominal, after = evidence.problem.predictions(evidence.fit.x), extended.predictions(final.x)
    overlays = [Overlay(t, False, a, b) for t, a, b in zip(evidence.problem.trials, nominal, after, strict=True)]
    if held:
        pairs = zip(held, scores.of(None).predictions, scores.of(best).predictions, strict=True)
        overlays += [Overlay(t, True, a, b) for t, a, b in pairs]
    return tuple(overlays)
