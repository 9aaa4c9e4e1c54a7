"""The method in one place: inspect, screen, refit, select, combine, decide, and measure the gain on held-out trials."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from mjfish.data import Dataset, Trial, load_dataset
from mjfish.data.looking import SMOOTHED, for_looking
from mjfish.data.validation import check_comparable
from mjfish.diagnosis.begun import Begun, culprits, failed_candidates, failed_remarks, unfinished_diagnosis
from mjfish.diagnosis.combinations import MEMBER, find_combinations, find_small_addition, to_optimum
from mjfish.diagnosis.description import describe
from mjfish.diagnosis.domain import explaining_domain
from mjfish.diagnosis.evidence import Evidence, p_value_of
from mjfish.diagnosis.failures import (
    NOMINAL,
    CandidatesFailedError,
    PartFailedError,
    Parts,
    blamed,
    candidates_limited,
    unfinished,
)
from mjfish.diagnosis.fan_out import followed
from mjfish.diagnosis.fingerprint import fingerprint
from mjfish.diagnosis.forms import NamedMechanism, named_mechanisms, refit_learned_forms, staying
from mjfish.diagnosis.held_out import HeldOut, gain, pooled_error
from mjfish.diagnosis.implausible_noise import bursts, too_large
from mjfish.diagnosis.isolability import Isolability, isolability
from mjfish.diagnosis.lone_run import lone_run
from mjfish.diagnosis.missing_force import MissingForce, missing_force, with_velocities
from mjfish.diagnosis.progress import Progress, part, silent
from mjfish.diagnosis.provenance import identity, provenance
from mjfish.diagnosis.refit_result import Refit
from mjfish.diagnosis.result import (
    Candidate,
    Cause,
    Diagnosis,
    Estimate,
    FittedModel,
    KnownNumber,
    Overlay,
    SensorOverlay,
)
from mjfish.diagnosis.screening import screen
from mjfish.diagnosis.select import Goodness, standings
from mjfish.diagnosis.verdict import ALARM, Comparison, Decision, decide, message_of, withheld
from mjfish.diagnosis.where import locate
from mjfish.effects import Effect, catalogue, of_fish
from mjfish.effects.mechanism import Domain
from mjfish.errors import NUMERIC, InputError, MjfishError, reason_of
from mjfish.estimation import Fit, Noise, Problem
from mjfish.estimation.clocks import aligned
from mjfish.estimation.fit import Z95
from mjfish.estimation.identification import check_enough, first_sigma, identified_fish
from mjfish.estimation.nominal import nominal_problem
from mjfish.estimation.posterior import posterior
from mjfish.estimation.residual import Score, SensorResidual, channel_errors, of_sensors
from mjfish.estimation.scatter import scatter
from mjfish.estimation.time_limit import PastLimitError
from mjfish.inspection import Finding, Inspection, inspect, inspect_fit
from mjfish.inspection.known_numbers import contradicted
from mjfish.kept import Kept
from mjfish.model import Model
from mjfish.model.posterior import Posterior

#: Said of a refit that was too far behind the best to be followed.
_ROUGH = "Its refit was not followed to its optimum: what it explains is a lower bound, its size is rough."


#: Said of a cause that is a part of the nominal model.
_PART = "It is a part of the nominal model: the dataset says what is known of it."
#: How often a diagnosis begins: each time fewer candidates are left.
_MOST_ATTEMPTS = 5
#: The part that fails where no other one is to blame.
_WHOLE = "the comparison"


def diagnose(
    dataset: Dataset | str | Path,
    *,
    effects: Mapping[str, Effect] | None = None,
    seed: int = 0,
    jobs: int | None = None,
    executor: Executor | None = None,
    resume: str | Path | None = None,
    limit: float | None = None,
    progress: Progress = silent,
) -> Diagnosis:
    """Find out what is wrong with the simulation of a dataset, name the cause, and measure the gain.

    The nominal model is fitted to the fit trials, and its residual is tested for anything systematic. If there is some,
    every candidate is fitted together with the coefficients; a likelihood ratio with simulated null distributions
    ([Cox1961]) says which of them the data support. Velocities are in m/s and rad/s, sizes in the units of the effects.

    Args:
        dataset: the trials, split into fit and held out (see `Dataset.split`), or the folder of ``dataset.toml``.
        effects: candidates by name; None: the shipped catalogue.
        seed: of the simulated null distributions and the bootstrap; the same seed gives the same answer.
        jobs: threads; None: one per processor. The answer does not depend on it.
        executor: `concurrent.futures.Executor` that takes the refits in place of the threads, such as one of Dask. The
            answer does not depend on it.
        resume: folder for finished refits; made where it is not there. A diagnosis that was stopped finds them there,
            and gives the same answer. None: they are kept nowhere.
        limit: seconds that one try of a candidate may take; the clock is looked at before every simulation, so that
            code that never returns is not ended. None: however long. A limit that is not reached changes no answer.
        progress: called with what is being done and the share that is done.

    A candidate that fails, because its effect raises, its refit diverges or the limit is reached, is left out, and the
    diagnosis begins anew without it; other parts that fail are left out, too. `Diagnosis.failures` has the reasons, and
    nothing is claimed: the verdict is then ``cannot_tell`` or ``unexplained``.

    Returns:
        The verdict (``named``, ``nothing_wrong``, ``cannot_tell`` or ``unexplained``) with causes, sizes, the gain on
        held-out trials, rivals, findings about the data, and both models.

    Raises:
        InputError: the dataset cannot be read, has too few numbers, or no effect applies to it; the folder of `resume`
            cannot be written.
        WorkerError: a worker of the executor ended without an answer.

    Example:
        >>> import mjfish
        >>> truth = {"servo_lag.time_constant": 0.03}
        >>> pool = mjfish.generate("pike", ["v1", "v5-v1", "v3"], values=truth, noise=(0.006, 0.006, 0.04))
        >>> mjfish.diagnose(pool).verdict
        'named'
    """
    if not isinstance(dataset, Dataset):
        dataset = load_dataset(dataset)
    if limit is not None and not limit > 0.0:
        raise InputError(f"limit: found {limit:g} s, expected more than 0; give seconds, or none")
    with threadpool_limits(1, "blas"), candidates_limited(limit):  # small matrices: more threads wait for each other
        begun = _begun(dataset, catalogue() if effects is None else effects, jobs)
        kept = None if resume is None else Kept(Path(resume), identity(begun.measured, begun.candidates, seed))
        problem = replace(begun.problem, executor=executor, kept=kept)
        return _repeated(replace(begun, problem=problem), seed, progress)


def _begun(dataset: Dataset, effects: Mapping[str, Effect], jobs: int | None) -> Begun:
    """Return what a diagnosis starts with, however often it begins anew."""
    check_comparable(dataset, "a diagnosis")
    measured, dataset = dataset, aligned(dataset)
    fitted, _ = dataset.split()
    stated = None if dataset.noise is None else np.asarray(dataset.noise)
    problem = nominal_problem(
        dataset, fitted, Noise.white(first_sigma(fitted) if stated is None else stated), jobs=jobs
    )
    candidates: list[Effect] = []
    reasons: dict[str, str] = {}
    failures: dict[str, str] = {}
    for effect in effects.values():
        own = effect
        try:
            with blamed(effect.name):
                own = of_fish({effect.name: effect}, dataset.fish)[effect.name]
                reasons[own.name] = _PART if own.name in problem.nominal else own.not_applicable(dataset)
        except CandidatesFailedError as error:
            failures |= error.reasons
        candidates.append(own)
    if not failures and all(reasons[effect.name] or effect.learned for effect in candidates):
        raise InputError(f"{dataset.name}: none of the {len(candidates)} effects applies to this dataset; add one")
    check_enough(problem, dataset.name)
    return Begun(measured, dataset, tuple(candidates), reasons, failures, stated, problem)


def _repeated(begun: Begun, seed: int, progress: Progress) -> Diagnosis:
    """Diagnose; where candidates fail, without them, and where nothing can be gone on with, say so."""
    failures = dict(begun.failures)
    for _ in range(_MOST_ATTEMPTS):
        try:
            return _diagnosed(begun, failures, seed, progress)
        except PartFailedError as error:
            return unfinished_diagnosis(begun, {**failures, error.part: error.reason}, seed)
        except Exception as error:
            found = culprits(error, begun, failures)
            if not found and (isinstance(error, MjfishError) or not isinstance(error, (*NUMERIC, PastLimitError))):
                raise
            failures |= found or {_WHOLE: reason_of(error)}
            if not found:
                break
    return unfinished_diagnosis(begun, failures, seed)


def _diagnosed(begun: Begun, left_out: Mapping[str, str], seed: int, progress: Progress) -> Diagnosis:
    """Diagnose without the candidates that failed."""
    rng, parts = np.random.default_rng(seed), Parts(dict(left_out))
    dataset, stated, problem = begun.dataset, begun.stated, begun.problem
    if problem.kept is not None:
        problem = replace(problem, kept=problem.kept.without(sorted(left_out)))
    candidates = tuple(effect for effect in begun.candidates if effect.name not in left_out)
    known = {effect.name: effect for effect in candidates}
    progress("testing the data", 0.0)
    checks = parts.run("the tests of the data", lambda: inspect(begun.measured, known), Inspection())
    fitted, held = dataset.split()
    formulas = tuple(effect for effect in candidates if not effect.learned)
    applicable = tuple(effect for effect in formulas if not begun.reasons[effect.name])
    learnable = tuple(effect for effect in candidates if effect.learned and not begun.reasons[effect.name])
    if not applicable:
        raise PartFailedError(_WHOLE, "no candidate is left that could be tried")
    screening, noise_remark = screen(problem, applicable, stated, rng, progress)
    evidence, refits = screening.evidence, screening.refits
    if evidence.fit.status == "stopped":
        parts.failures[NOMINAL] = f"it stopped after {evidence.fit.evaluations} evaluations: {evidence.fit.message}"
    seen = parts.run(
        "the tests of the fit", lambda: inspect_fit(evidence.problem, evidence.fit, known, held), Inspection()
    )
    checks = checks.joined(seen)
    wrong, moving = screening.p_wrong < ALARM, bool(evidence.problem.samples)
    if not wrong and moving:
        repeats = checks.repeats
        implausible: tuple[Finding | None, ...] = parts.run(
            "the test of the noise",
            lambda: (too_large(evidence.problem, evidence.fit, repeats), bursts(evidence, rng)),
            (),
        )
        checks = checks.joined(Inspection.of((finding for finding in implausible if finding is not None), known))

    progress("comparing the candidates", 0.75)
    held_out, goodness = HeldOut(evidence, held), Goodness(applicable, held)
    single = _compared(refits, goodness, held_out, rng)
    combined, others = None, None
    learned: dict[str, Refit] = {}
    if refits:
        clear = {refits[name].mechanisms[0] for (name,) in single.retained(clean=True)}
        learned = refit_learned_forms(evidence, learnable, clear, refits)
        if learned:
            refits = {**refits, **learned}
            single = _compared(refits, goodness, held_out, rng)
    odd: int | None = None
    if refits and not single.retained(clean=True):
        odd = parts.run("the search for a single run", lambda: lone_run(evidence), None)
        if odd is None:
            every, beside = (*applicable, *learnable), part(progress, 0.8, 0.15)
            combined = parts.run(
                "the combinations", lambda: _combined(single, refits, every, held_out, rng, beside), None
            )
        if failed := single.failed():
            rest = {name: refit for name, refit in refits.items() if (name,) not in failed}
            others = _compared(rest, goodness, held_out, rng)
    decision = decide(screening.p_wrong, single, combined, checks.blocks, others)
    if odd is not None and decision.verdict == "unexplained":
        message = (
            f"Something was wrong in run {fitted[odd].name} alone, and no known cause explains it; repeat that run."
        )
        decision = replace(decision, message=message)
    best = _best(decision, single, combined)
    mechanisms: tuple[NamedMechanism, ...] = ()
    if decision.verdict == "named" and best is not None:
        own = (refit for refit in learned.values() if refit.mechanisms == best.mechanisms)
        form = next(own, None) if len(best.effects) == 1 else None
        sets = {**single.refits, **({} if combined is None else combined.refits)}
        retained = staying([sets[s] for s in decision.sets if s in sets and not sets[s].learned], form)
        if not retained:
            retained = (best if form is None else form,)
        best = retained[0]
        clean = best.names in (single if len(best.effects) == 1 or combined is None else combined).cleanly()
        shown, kept = best, retained
        mechanisms = parts.run("the form", lambda: named_mechanisms(shown, kept, form, evidence.fit, clean=clean), ())
        message = message_of(retained, claimed=all(one.level == "form" for one in mechanisms)) + decision.left
        decision = replace(decision, sets=tuple(refit.names for refit in retained), message=message)

    domain = _domain(decision, known)
    if decision.verdict == "unexplained":
        domain = parts.run("the domain", lambda: explaining_domain(evidence, learnable), None)
    progress("looking at what is wrong", 0.96)
    unexplained = decision.verdict == "unexplained"
    if unexplained and best is not None and held and (why := _misleading(best, held_out)):
        best, decision = None, replace(decision, message=decision.message + why)
    scores = (held_out.score(None), held_out.score(best)) if held else None
    final = evidence.fit if best is None else best.fit
    extended = evidence.problem if best is None else best.problem
    checks = checks.joined(Inspection.of(contradicted(extended, final), known))
    parts.failures |= _unfinished(refits, best)
    errors = {name: pooled_error(held_out.score(refit).channels) for name, refit in refits.items() if held}
    table = _candidates(candidates, begun.reasons, evidence, refits, single.joined(others), errors)
    converged = {"the nominal model": evidence.fit.status, "the extended model": final.status}
    none = Isolability((), (), (), ())
    told = parts.run("what can be told apart", lambda: isolability(evidence, learnable), none)
    where = parts.run("where it is", lambda: locate(evidence, screening.directed), None) if wrong else None
    force: tuple[MissingForce, ...] = ()
    if wrong and (looked := with_velocities(evidence.problem, evidence.fit.values)) is not None:
        force = parts.run("the missing force", partial(missing_force, looked, evidence.fit.values), force)
    print_ = None
    if best is not None and (looked := with_velocities(extended, final.values)) is not None:
        print_ = parts.run("the fingerprint", partial(fingerprint, looked, best.effects, final.values), None)
    description = (
        parts.run("the description", lambda: describe(evidence.problem, evidence.fit, rng), None)
        if unexplained
        else None
    )
    gained = (
        parts.run("the gain", lambda: gain(*scores, held, rng), None)
        if scores is not None and (best is not None or unexplained)
        else None
    )
    drawn = parts.run("the posterior", lambda: _posterior(extended, final), None)
    domain_told = _in_domain(decision, domain)
    decision = withheld(decision, parts.failures)
    result = Diagnosis(
        dataset=dataset,
        verdict=decision.verdict,
        message=decision.message + domain_told,
        status=_status(converged.values(), parts.failures),
        remarks=(
            *failed_remarks(parts.failures),
            *remarks(noise_remark, evidence.fit, converged, held),
            *_of_sensors(dataset),
            *([] if moving else [SMOOTHED]),
        ),
        checks=checks,
        causes=_causes(best) if best is not None and decision.verdict == "named" else (),
        mechanisms=mechanisms if decision.verdict == "named" else (),
        domain=domain,
        rivals=decision.rivals,
        alternatives=decision.sets,
        certain=decision.certain,
        candidates=(*table, *failed_candidates(begun, left_out)),
        failures=parts.failures,
        undetectable=_undetectable(table, evidence),
        isolability=told,
        best=() if best is None else best.names,
        closest=next(iter(decision.closest), ""),
        where=where,
        force=force,
        fingerprint=print_,
        description=description,
        p_wrong=screening.p_wrong,
        gain=gained,
        nominal=estimates(evidence.fit, evidence.problem.model),
        extended=estimates(final, extended.model),
        nominal_model=evidence.problem.model,
        extended_model=extended.model,
        posterior=drawn,
        overlays=_overlays(evidence, extended, final, held, scores),
        problem=evidence.problem,
        fits=(
            _fitted_model((), evidence.problem, evidence.fit),
            *(_fitted_model(refit.names, refit.problem, refit.fit) for refit in refits.values()),
        ),
        effects={effect.name: effect for effect in begun.candidates},
        provenance=provenance(dataset, begun.candidates, seed),
    )
    progress("done", 1.0)
    return result


def _unfinished(refits: Mapping[str, Refit], shown: Refit | None) -> dict[str, str]:
    """Return the refits that were stopped where they might catch up with the best, and do so or do not end.

    One that ends where it is followed, and is behind the best all the same, was rightly left.
    """
    found: dict[str, str] = {}
    best = max((refit.adjusted for refit in refits.values()), default=0.0)
    several = {} if shown is None or len(shown.names) == 1 else {" with ".join(shown.names): shown}
    for name, refit in {**refits, **several}.items():
        if reason := unfinished(refit.fit, best - refit.adjusted):
            (there,) = followed(partial(to_optimum, least=refit.fit.sse), [refit])
            if unfinished(there.fit, best - there.adjusted) or (
                refit.adjusted < best - MEMBER < there.adjusted  # a rival that was not compared as one
            ):
                found[name] = reason
    return found


def _status(ended: Iterable[str], failures: Mapping[str, str]) -> str:
    """Return the status of a diagnosis: how the fits of both models ended, and whether a part failed."""
    if failures:
        return "failed"
    return "ok" if set(ended) <= {"converged"} else "fit_not_converged"


def _of_sensors(dataset: Dataset) -> Iterator[str]:
    """Yield what was left out of sensors."""
    for trial in dataset.trials:
        yield from (f"{trial.name}: {remark}" for sensor in trial.sensors for remark in sensor.remarks)


def _compared(
    refits: Mapping[str, Refit], goodness: Goodness, held_out: HeldOut, rng: np.random.Generator
) -> Comparison:
    """Compare single causes with each other, and on the held-out trials."""
    found = standings(refits, goodness, held_out, rng) if refits else {}
    return Comparison(
        {(name,): refit for name, refit in refits.items()},
        {(name,): standing for name, standing in found.items()},
        {(name,): held_out.confirmed(refits[name], None) for name, standing in found.items() if standing.in_set},
    )


def _combined(
    single: Comparison,
    refits: Mapping[str, Refit],
    candidates: Sequence[Effect],
    held_out: HeldOut,
    rng: np.random.Generator,
    progress: Progress,
) -> Comparison | None:
    """Compare combinations of causes; None where no second cause is seen.

    Where all that stay have a learned form and fail on the held-out trials, those of formulas alone are compared.
    """
    if single.exhausted():
        found = find_small_addition(refits, candidates, held_out, rng)
    else:
        found = find_combinations(refits, candidates, held_out, rng, progress)
    if found is None:
        return None
    staying_sets = [names for names, standing in found.standings.items() if standing.in_set]
    confirmed = {names: held_out.confirmed(found.refits[names], found.parts[names]) for names in staying_sets}
    result = Comparison(found.refits, found.standings, confirmed)
    formulas = {name: refit for name, refit in refits.items() if not refit.learned}
    flexible = all(found.refits[names].learned for names in staying_sets)
    if flexible and result.falsified() and len(formulas) < len(refits):
        plain = [effect for effect in candidates if not effect.learned]
        return _combined(single, formulas, plain, held_out, rng, progress) or result
    return result


def _best(decision: Decision, single: Comparison, combined: Comparison | None) -> Refit | None:
    """Return the refit that is shown: of the first set of the decision, else of the single cause that comes closest."""
    for comparison in (single, combined):
        if comparison is not None and decision.sets and decision.sets[0] in comparison.refits:
            return comparison.refits[decision.sets[0]]
    return single.refits.get(single.closest())


def _misleading(closest: Refit, held_out: HeldOut) -> str:
    """Say why the nominal model is shown, where the closest errs more on the held-out runs; else nothing.

    By both measures of the table, which may disagree where noise is slow.
    """
    scores = [held_out.score(model) for model in (None, closest)]
    nominal, extended = (pooled_error(score.channels) for score in scores)
    if extended <= nominal:
        return ""
    before, after = (float(np.sum(np.concatenate(score.whitened) ** 2)) for score in scores)
    although = f", although its log-likelihood is {0.5 * (before - after):.3g} lower" if after < before else ""
    return (
        f" The nominal model is kept: its nRMSE on the held-out trials is smaller, {100.0 * nominal:.3g} % against "
        f"{100.0 * extended:.3g} %{although}."
    )


def _domain(decision: Decision, known: Mapping[str, Effect]) -> Domain | None:
    """Return the domain of sets that the data cannot tell apart, where they all have one."""
    domains = {known[name].domain for names in decision.sets for name in names}
    alike = decision.verdict == "cannot_tell" and len(decision.sets) > 1 and len(domains) == 1
    return domains.pop() if alike else None


def _in_domain(decision: Decision, domain: Domain | None) -> str:
    """Return what is known of the domain, in a sentence; nothing where nothing is."""
    if domain is None:
        return ""
    if decision.verdict == "unexplained":
        return f" The causes of the domain '{domain}' together explain it, those of no other domain do."
    return f" All of these causes are of the domain '{domain}'."


def _causes(best: Refit) -> tuple[Cause, ...]:
    """Return the causes of a refit with the estimates of their parameters."""
    return tuple(Cause(effect.name, effect.summary, _parameters(best, effect)) for effect in best.effects)


def estimates(found: Fit, model: Model) -> dict[str, Estimate]:
    """Return the model's estimates by name, without parameters of single trials.

    A refit keeps an amplitude that cannot be negative slightly above zero; an interval that reaches this bound reaches
    zero. A shape parameter to which these data are insensitive has its default.
    """
    result = {}
    declared = {p.name: p for p in model.parameters}
    for p, at_bound, length in zip(found.parameters, found.at_bound, found.lengths, strict=True):
        if ":" not in p.name:
            low, high = found.interval(p.name, Z95)
            low = declared.get(p.name, p).low if low <= p.low else low
            value = p.default if p.shape and length == 0.0 else found.values[p.name]
            result[p.name] = Estimate(value, low, high, p.unit, bool(at_bound), KnownNumber.of(p, value))
    return result


def _posterior(problem: Problem, found: Fit) -> Posterior | None:
    """Return the posterior of the extended model; its residuals are white under the noise of the problem."""
    if found.lost:
        return None
    fish = identified_fish(problem.model.fish, found, problem.fixed)
    return posterior(problem, found, fish, scatter(problem, found), correlated=False)


def _fitted_model(causes: tuple[str, ...], problem: Problem, fit: Fit) -> FittedModel:
    at_bound = tuple(p.name for p, held in zip(fit.parameters, fit.at_bound, strict=True) if held)
    return FittedModel(causes, fit.values, at_bound, fit.sse, problem.model.step, fit.status == "converged")


def _parameters(refit: Refit, effect: Effect) -> dict[str, Estimate]:
    found = estimates(refit.fit, refit.problem.model)
    return {p.short: found[p.name] for p in effect.parameters}


def _candidates(
    effects: Sequence[Effect],
    reasons: Mapping[str, str],
    evidence: Evidence,
    refits: Mapping[str, Refit],
    single: Comparison,
    held_out_errors: Mapping[str, float],
) -> tuple[Candidate, ...]:
    """Return how every candidate fared, best first."""
    result = []
    for effect in effects:
        name = effect.name
        if effect.learned and name not in refits:
            continue
        if reasons[name]:
            result.append(Candidate(name, False, remark=reasons[name]))
            continue
        scored = Candidate(name, True) if effect.learned else _scored(effect, evidence)
        if (refit := refits.get(name)) is not None:
            scored = replace(
                scored,
                statistic=max(refit.gain, 0.0),  # a formula may not have the nominal model in it
                degrees_of_freedom=refit.degrees_of_freedom,
                error=pooled_error(
                    [channel_errors(refit.problem, refit.fit.x, index) for index in range(len(refit.problem.trials))]
                ),
                held_out_error=held_out_errors.get(name),
                parameters=_parameters(refit, effect),
                remark=_remark_of(refit.fit),
            )
        if (standing := single.standings.get((name,))) is not None:
            fit_p = standing.fit_p if standing.in_set else None
            scored = replace(scored, rival_p=standing.rival_p, fit_p=fit_p)
        if (confirmation := single.held_out.get((name,))) is not None:
            scored = replace(scored, held_out_gain=confirmation.gained)
        result.append(replace(scored, p_value=p_value_of(scored.statistic, scored.degrees_of_freedom)))
    return tuple(sorted(result, key=lambda candidate: -candidate.statistic))


def _remark_of(found: Fit) -> str:
    """Return what a reader should know of the fit of a candidate."""
    return _ROUGH if found.status != "converged" else ""


def _scored(effect: Effect, evidence: Evidence) -> Candidate:
    """Return a candidate with its score at the fit of the nominal model."""
    name = effect.name
    unidentifiable = evidence.unidentifiable(name)
    score = 0.0 if unidentifiable else evidence.statistic(name)
    return Candidate(
        name=name,
        applicable=True,
        score=score,
        statistic=score,
        degrees_of_freedom=len(effect.amplitudes()),
        confounded=evidence.confounded(name),
        minimum_detectable=evidence.minimum_detectable(name) if effect.smooth and not unidentifiable else None,
    )


def remarks(noise: str, nominal: Fit, converged: Mapping[str, str], held: Sequence[Trial]) -> Iterator[str]:
    """Yield what a reader should know of noise, fits, bounds and held-out trials.

    Args:
        noise: in words.
        nominal: the fit of the nominal model.
        converged: status of a model's fit, by the model in words.
        held: the held-out trials.
    """
    if noise:
        yield noise
    for model, status in converged.items():
        if status != "converged":
            yield (
                f"fit-not-converged: the fit of {model} ended as {status}: its estimates are not at the optimum, and "
                "the verdict depends on them; give [start] values nearer to the truth, or look at the findings"
            )
    for p, at_bound in zip(nominal.parameters, nominal.at_bound, strict=True):
        if at_bound:
            yield f"{p.name} of the nominal model is at its bound, {nominal.values[p.name]:.4g} {p.unit}".rstrip(" -")
    if not held:
        yield "no held-out trial: the gain cannot be measured; record or set aside one more trial"


def _overlays(
    evidence: Evidence, extended: Problem, final: Fit, held: Sequence[Trial], scores: tuple[Score, Score] | None
) -> tuple[Overlay, ...]:
    """Return every trial as both models predict it; `scores` of the nominal and of the extended model."""
    nominal, after = evidence.problem.predictions(evidence.fit.x), extended.predictions(final.x)
    read = [
        _paired(of_sensors(evidence.problem, evidence.fit.x, i), of_sensors(extended, final.x, i))
        for i in range(len(nominal))
    ]
    rows = zip(evidence.problem.trials, nominal, after, read, strict=True)
    shown = [Overlay(for_looking(trial), False, a, b, own) for trial, a, b, own in rows]
    if scores is not None:
        read = [_paired(*own) for own in zip(scores[0].sensors, scores[1].sensors, strict=True)]
        pairs = zip(held, scores[0].predictions, scores[1].predictions, read, strict=True)
        shown += [Overlay(for_looking(trial), True, a, b, own) for trial, a, b, own in pairs]
    return tuple(shown)


def _paired(nominal: Sequence[SensorResidual], extended: Sequence[SensorResidual]) -> tuple[SensorOverlay, ...]:
    return tuple(SensorOverlay(a.sensor, a.predicted, b.predicted) for a, b in zip(nominal, extended, strict=True))


def _undetectable(candidates: Sequence[Candidate], evidence: Evidence) -> dict[str, str]:
    """Return the causes that these data cannot show, whatever their size, and why."""
    reasons = {candidate.name: candidate.remark for candidate in candidates if not candidate.applicable}
    for effect in evidence.candidates:
        if evidence.unidentifiable(effect.name):
            reasons[effect.name] = "the free coefficients hide all of it; fix one that was measured apart"
    return reasons
