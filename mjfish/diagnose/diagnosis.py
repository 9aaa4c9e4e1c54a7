"""The whole way from a dataset to a verdict and the gain it brings."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence

import numpy as np
from threadpoolctl import threadpool_limits

from mjfish import checks
from mjfish.arrays import FloatArray
from mjfish.diagnose import assemble, heldout, provenance
from mjfish.diagnose.description import describe
from mjfish.diagnose.evidence import Evidence
from mjfish.diagnose.fingerprint import fingerprint
from mjfish.diagnose.force import missing_force
from mjfish.diagnose.heldout import Confirmation, confirmation
from mjfish.diagnose.locate import locate
from mjfish.diagnose.noise.magnitude import too_large
from mjfish.diagnose.progress import Progress, part, silent
from mjfish.diagnose.refit import Refit
from mjfish.diagnose.result import Diagnosis
from mjfish.diagnose.search import search
from mjfish.diagnose.select import standings
from mjfish.diagnose.several import several
from mjfish.diagnose.verdict import ALARM, Hearing, Ruling, rule
from mjfish.effects import Effect, catalogue
from mjfish.errors import InputError
from mjfish.identify import Fit, Noise, Problem
from mjfish.identify.clocks import aligned
from mjfish.identify.report import check_enough, first_sigma
from mjfish.identify.score import Score, held_out_doubt, predict_held_out
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
    with threadpool_limits(1, "blas"):  # small matrices: more threads only wait for each other
        return _diagnosed(dataset, effects, seed, jobs, progress)


def _diagnosed(
    dataset: Dataset, effects: Mapping[str, Effect] | None, seed: int, jobs: int | None, progress: Progress
) -> Diagnosis:
    rng = np.random.default_rng(seed)
    candidates = tuple((catalogue() if effects is None else dict(effects)).values())
    reasons = {effect.name: effect.not_applicable(dataset) for effect in candidates}
    applicable = tuple(effect for effect in candidates if not reasons[effect.name])
    dataset = aligned(dataset)
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
    check_enough(problem, dataset.name)
    checked = checks.run(dataset, {effect.name: effect for effect in candidates})
    findings, noise_remark = search(problem, applicable, stated, rng, progress)
    evidence, refitted = findings.evidence, findings.refits
    checked = checked.joined(checks.after(evidence.problem, evidence.fit, held))
    if findings.p_wrong >= ALARM and (finding := too_large(evidence.problem, evidence.fit, checked.repeats)):
        checked = checked.joined(checks.Checks((finding,)))

    progress("comparing the candidates", 0.75)
    scores = _Scores(evidence, held)
    single = _heard(refitted, applicable, scores, rng)
    several_, others = None, None
    if refitted and not single.staying(clean=True):
        several_ = _several(refitted, applicable, scores, rng, progress)
        if failed := single.failed():
            rest = {name: one for name, one in refitted.items() if (name,) not in failed}
            others = _heard(rest, applicable, scores, rng)
    ruling = rule(findings.p_wrong, single, several_, checked.blocks, others)
    best = _best(ruling, single, several_)
    scored = (scores.of(None), scores.of(best)) if held else None

    progress("looking at what is wrong", 0.96)
    wrong = findings.p_wrong < ALARM
    unexplained = ruling.verdict == "unexplained"
    final = evidence.fit if best is None else best.fit
    extended = evidence.problem if best is None else best.problem
    errors = {name: heldout.pooled_error(scores.of(one).residuals, held) for name, one in refitted.items() if held}
    table = assemble.candidates(candidates, reasons, evidence, refitted, single.joined(others), errors)
    result = Diagnosis(
        dataset=dataset,
        verdict=ruling.verdict,
        message=ruling.message,
        status="ok" if {evidence.fit.status, final.status} == {"converged"} else "fit_not_converged",
        remarks=assemble.remarks(noise_remark, evidence, held),
        checks=checked,
        causes=assemble.causes(best) if ruling.verdict == "named" else (),
        rivals=assemble.rivals(ruling),
        alternatives=ruling.sets,
        certain=ruling.certain,
        candidates=table,
        blind=assemble.blind(table, evidence),
        best=() if best is None else best.names,
        where=locate(evidence, findings.directed) if wrong else None,
        force=missing_force(evidence.problem, evidence.fit) if wrong else (),
        fingerprint=None if best is None else fingerprint(best),
        description=describe(evidence.problem, evidence.fit, rng) if unexplained else None,
        p_wrong=findings.p_wrong,
        gain=heldout.gain(*scored, held, rng) if scored is not None and best is not None else None,
        nominal=assemble.estimates(evidence.fit, evidence.problem.model),
        extended=assemble.estimates(final, extended.model),
        nominal_model=evidence.problem.model,
        extended_model=extended.model,
        overlays=assemble.overlays(evidence, extended, final, held, scored),
        provenance=provenance.provenance(dataset, candidates, seed),
    )
    progress("done", 1.0)
    return result


class _Scores:
    """Held-out scores of models, each made once."""

    def __init__(self, evidence: Evidence, held: tuple[Trial, ...]) -> None:
        self.evidence, self.held = evidence, held
        self.known: dict[tuple[str, ...], Score] = {}
        self.doubts: dict[tuple[str, ...], FloatArray] = {}

    def of(self, one: Refit | None) -> Score:
        """Return the score of a refit, None: of the nominal model."""
        names, problem, found = self._which(one)
        if names not in self.known:
            self.known[names] = predict_held_out(problem, found.values, self.held)
        return self.known[names]

    def doubt(self, one: Refit | None) -> FloatArray:
        """Return the columns (n, k) of the doubt about the prediction of a refit, None: of the nominal model."""
        names, problem, found = self._which(one)
        if names not in self.doubts:
            self.doubts[names] = held_out_doubt(problem, found, self.held)
        return self.doubts[names]

    def _which(self, one: Refit | None) -> tuple[tuple[str, ...], Problem, Fit]:
        if one is None:
            return (), self.evidence.problem, self.evidence.fit
        return one.names, one.problem, one.fit

    def confirmed(self, one: Refit, against: Refit | None) -> Confirmation | None:
        """Return what a refit gains on the held-out trials; None where there are none."""
        if not self.held:
            return None
        return confirmation(self.of(against), self.of(one), (self.doubt(against), self.doubt(one)))


def _heard(
    refitted: Mapping[str, Refit], candidates: Sequence[Effect], scores: _Scores, rng: np.random.Generator
) -> Hearing:
    """Return what speaks for single causes: how they stand against each other, and on the held-out trials."""
    standing = standings(refitted, candidates, rng) if refitted else {}
    return Hearing(
        {(name,): one for name, one in refitted.items()},
        {(name,): one for name, one in standing.items()},
        {(name,): scores.confirmed(refitted[name], None) for name, one in standing.items() if one.in_set},
    )


def _several(
    singles: Mapping[str, Refit],
    candidates: Sequence[Effect],
    scores: _Scores,
    rng: np.random.Generator,
    progress: Progress,
) -> Hearing | None:
    sets = several(singles, candidates, rng, part(progress, 0.8, 0.15))
    if sets is None:
        return None
    staying = [names for names, one in sets.standings.items() if one.in_set]
    held_out = {names: scores.confirmed(sets.refits[names], sets.parts[names]) for names in staying}
    return Hearing(sets.refits, sets.standings, held_out)


def _best(ruling: Ruling, single: Hearing, several_: Hearing | None) -> Refit | None:
    """Return whose extended model is shown: the named one's, else that of the single cause that explains most."""
    for hearing in (single, several_):
        if hearing is not None and ruling.sets and ruling.sets[0] in hearing.refits:
            return hearing.refits[ruling.sets[0]]
    return max(single.refits.values(), key=lambda one: one.adjusted) if single.refits else None
