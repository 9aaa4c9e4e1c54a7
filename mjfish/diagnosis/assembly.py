"""A diagnosis put together from its steps, and one that could not be finished, with the reasons.

It has all candidates: how each of them fared, those too that failed or that the dataset cannot show.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from mjfish.data import Dataset, Trial
from mjfish.data.trial import SMOOTHED, for_looking
from mjfish.diagnosis.begun import Begun
from mjfish.diagnosis.compared import Compared, outlying_run_finding
from mjfish.diagnosis.conclusion import Conclusion
from mjfish.diagnosis.description import describe
from mjfish.diagnosis.evidence import Evidence, p_value_of
from mjfish.diagnosis.failures import folded
from mjfish.diagnosis.held_out import HeldOut, gain
from mjfish.diagnosis.isolability import Isolability, isolability
from mjfish.diagnosis.missing_force import MissingForce, missing_force, with_velocities
from mjfish.diagnosis.provenance import provenance
from mjfish.diagnosis.refit_result import Refit
from mjfish.diagnosis.result import Candidate, Cause, Diagnosis, FittedModel, Overlay, SensorOverlay
from mjfish.diagnosis.screening import Screening
from mjfish.diagnosis.setup import Setup
from mjfish.diagnosis.table import Estimate, Row, estimates
from mjfish.diagnosis.thresholds import THRESHOLDS
from mjfish.diagnosis.verdict import Decision, withheld
from mjfish.diagnosis.where import locate
from mjfish.effects import Effect
from mjfish.estimation import Fit, Problem
from mjfish.estimation.identification import identified_fish
from mjfish.estimation.intervals import posterior
from mjfish.estimation.residual import SensorResidual, of_sensors
from mjfish.estimation.sensor_noise import joints_in_words
from mjfish.estimation.stability import scatter
from mjfish.inspection import Inspection
from mjfish.inspection.after_fit import contradicted
from mjfish.model import Model
from mjfish.model.posterior import Posterior
from mjfish.numerics.arrays import FloatArray


def assemble(
    begun: Begun,
    screening: Screening,
    checks: Inspection,
    compared: Compared,
    concluded: Conclusion,
    held_out: HeldOut,
) -> Diagnosis:
    """Return the diagnosis with all that readers look at; a claim is taken back where a part failed."""
    parts, evidence, best = begun.parts, screening.evidence, concluded.best
    dataset, shown = begun.dataset, best or evidence
    odd = [] if compared.odd is None else [outlying_run_finding(evidence.problem.trials, compared.odd)]
    checks = checks.joined(Inspection.of([*contradicted(shown.problem, shown.fit), *odd], begun.known))
    candidates = candidate_table(begun, evidence, compared)
    converged = {"the nominal model": evidence.fit.status, "the extended model": shown.fit.status}
    views, gained = _views(begun, screening, concluded), None
    if held_out.trials:
        scores = held_out.score(None), held_out.score(best)
        gained = parts.run("the gain", lambda: gain(*scores, held_out.trials, np.random.default_rng(begun.seed)), None)
    joints: tuple[str, ...] = parts.run("errors of joints", lambda: (*joints_in_words(evidence.problem),), ())
    drawn = parts.run("the posterior", lambda: _posterior(shown.problem, shown.fit, dataset), None)
    effects = {effect.name: effect for effect in begun.candidates}
    models = (evidence.problem.model, shown.problem.model)
    setup = Setup.of(dataset, evidence.problem, models, begun.candidates)
    decision = withheld(concluded.decision, parts.failures)
    named = decision.verdict == "named"
    return Diagnosis(
        setup=setup,
        dataset=dataset,
        verdict=decision.verdict,
        message=decision.message + _in_domain(concluded),
        status="failed" if parts.failures else "ok" if {*converged.values()} == {"converged"} else "fit_not_converged",
        remarks=(
            *failed_remarks(parts.failures),
            *remarks(screening.remark, evidence.fit, converged, held_out.trials),
            *joints,
            *(f"{trial.name}: {own}" for trial in dataset.trials for sensor in trial.sensors for own in sensor.remarks),
            *([] if evidence.problem.samples else [SMOOTHED]),
        ),
        checks=checks,
        causes=tuple(_causes(compared, best)) if named else (),
        mechanisms=concluded.mechanisms if named else (),
        domain=concluded.domain,
        rivals=decision.rivals,
        alternatives=decision.sets,
        certain=decision.certain,
        candidates=candidates,
        table=compared.table,
        failures=parts.failures,
        undetectable=undetectable(candidates, evidence),
        best=() if best is None else best.names,
        closest=next(iter(decision.closest), ""),
        p_wrong=min([screening.p_wrong, *(row.p_value for row in compared.table.random)]),
        gain=gained,
        nominal=estimates(evidence.fit, evidence.problem.model),
        extended=estimates(shown.fit, shown.problem.model),
        nominal_model=evidence.problem.model,
        extended_model=shown.problem.model,
        posterior=drawn,
        overlays=tuple(_overlays(evidence, best, held_out)),
        problem=evidence.problem,
        fits=tuple(_fits(evidence, compared)),
        effects=effects,
        provenance=provenance(dataset, begun.candidates, begun.seed),
        **views,
    )


def _causes(compared: Compared, best: Refit | None) -> Iterator[Cause]:
    """Yield the causes that the extended model has, then random ones."""
    if best is not None:
        yield from (Cause.of(effect, best.fit, best.problem.model) for effect in best.effects)
    for row in compared.table.random:
        (name,) = row.names
        yield Cause(name, row.causes[name], {full.partition(".")[2]: size for full, size in row.sizes.items()})


def _fits(evidence: Evidence, compared: Compared) -> tuple[FittedModel, ...]:
    """Return the nominal model at its fit, then those with single causes."""
    alone = (refit for refit in compared.refits.values() if len(refit.names) == 1)
    singles = (FittedModel.of(refit.names, refit.problem, refit.fit) for refit in alone)
    return (FittedModel.of((), evidence.problem, evidence.fit), *singles)


def _views(begun: Begun, screening: Screening, concluded: Conclusion) -> dict[str, Any]:
    """Return the views of what is wrong, by field of `Diagnosis`; one that fails is left out."""
    parts, evidence = begun.parts, screening.evidence
    told = parts.run("what can be told apart", lambda: isolability(evidence, begun.learnable), Isolability())
    found: dict[str, Any] = {"isolability": told}
    if screening.p_wrong < THRESHOLDS.alarm:
        found["where"] = parts.run("where it is", lambda: locate(evidence, screening.directed), None)
        if (looked := with_velocities(evidence.problem, evidence.fit.values)) is not None:
            found["force"] = parts.run(
                "the missing force", partial(missing_force, looked, evidence.fit.values), tuple[MissingForce, ...]()
            )
    if concluded.decision.verdict == "unexplained":
        found["description"] = parts.run("the description", partial(describe, evidence.problem, evidence.fit), None)
    return found


def unfinished_diagnosis(begun: Begun) -> Diagnosis:
    """Return a diagnosis without a comparison: what failed, and the nominal model as it was declared, not fitted."""
    problem, dataset, failures = begun.problem, begun.dataset, begun.parts.failures
    decision = withheld(Decision("cannot_tell", (), "Nothing was compared."), failures)
    declared = {p.name: Estimate(p.start, p.low, p.high, p.unit, settled=False) for p in problem.model.parameters}
    held = dataset.split()[1]
    effects = {effect.name: effect for effect in begun.candidates}
    return Diagnosis(
        setup=Setup.of(dataset, problem, (), effects.values()),
        dataset=dataset,
        verdict=decision.verdict,
        message=decision.message,
        status="failed",
        remarks=tuple(failed_remarks(failures)),
        candidates=failed_candidates(begun),
        failures=dict(failures),
        nominal=declared,
        extended=declared,
        nominal_model=problem.model,
        extended_model=problem.model,
        overlays=tuple(_unpredicted(problem.model, trial, held_out=trial in held) for trial in dataset.trials),
        problem=problem,
        fits=(FittedModel((), problem.named(problem.start()), (), math.nan, problem.model.step, converged=False),),
        effects=effects,
        provenance=provenance(dataset, begun.candidates, begun.seed),
    )


def failed_remarks(failures: Mapping[str, str]) -> Iterator[str]:
    """Yield what failed, in words."""
    yield from (f"failed: {parts}: {reason}" for parts, reason in folded(failures))


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
        if at_bound and ":start." not in p.name:  # those of starts are findings
            yield f"{p.name} of the nominal model is at its bound, {nominal.values[p.name]:.4g} {p.unit}".rstrip(" -")
    if not held:
        yield "no held-out trial: the gain cannot be measured; record or set aside one more trial"


def _in_domain(concluded: Conclusion) -> str:
    """Return what is known of the domain, in a sentence; nothing where nothing is."""
    if concluded.domain is None:
        return ""
    if concluded.decision.verdict == "unexplained":
        return f" The causes of the domain '{concluded.domain}' together explain it, those of no other domain do."
    return f" All of these causes are of the domain '{concluded.domain}'."


def _overlays(evidence: Evidence, best: Refit | None, held_out: HeldOut) -> Iterator[Overlay]:
    """Yield every trial as the nominal model and a refit predict it, None: the nominal model again."""
    models, nominal = [(one.problem, one.fit.x) for one in (evidence, best or evidence)], evidence.problem.model
    predictions = zip(*(problem.predictions(x) for problem, x in models), strict=True)
    for index, (trial, predicted) in enumerate(zip(evidence.problem.trials, predictions, strict=True)):
        read = [of_sensors(problem, x, index) for problem, x in models]
        yield Overlay.of(nominal, for_looking(trial), predicted, _paired(*read), held_out=False)
    if held_out.trials:
        scores = [held_out.score(model) for model in (None, best)]
        predictions = zip(*(score.predictions for score in scores), strict=True)
        sensors = zip(*(score.sensors for score in scores), strict=True)
        for trial, predicted, own in zip(held_out.trials, predictions, sensors, strict=True):
            yield Overlay.of(nominal, for_looking(trial), predicted, _paired(*own), held_out=True)


def _unpredicted(model: Model, trial: Trial, *, held_out: bool) -> Overlay:
    """Return a trial that no model predicts: predictions end where they begin."""
    velocity: FloatArray = np.full((len(trial.time), 3), np.nan)
    velocity[0] = trial.velocity[0]
    return Overlay.of(model, trial, (velocity, velocity), held_out=held_out)


def _paired(nominal: Sequence[SensorResidual], extended: Sequence[SensorResidual]) -> tuple[SensorOverlay, ...]:
    pairs = zip(nominal, extended, strict=True)
    return tuple(SensorOverlay(a.sensor, np.round(a.predicted, 7), np.round(b.predicted, 7)) for a, b in pairs)


def _posterior(problem: Problem, found: Fit, dataset: Dataset) -> Posterior | None:
    """Return the posterior of the extended model; its residuals are white under the noise of the problem."""
    if found.lost:
        return None
    fish = identified_fish(dataset, found, problem.fixed, found.interval)
    return posterior(problem, found, fish, scatter(problem, found), correlated=False)


#: Said of a refit that was too far behind the best to be followed.
_ROUGH = "Its refit was not followed to its optimum: what it explains is a lower bound, its size is rough."


def candidate_table(begun: Begun, evidence: Evidence, compared: Compared) -> tuple[Candidate, ...]:
    """Return how every candidate fared, best first, then those that failed."""
    rows, found = {row.names: row for row in compared.table.rows}, []
    for effect in begun.known.values():
        row = rows.get((effect.name,))
        if effect.learned or (effect.random and not begun.reasons[effect.name]):
            if row is not None:
                found.append(Candidate(effect.name, True, remark=_remark(row), row=row))
        elif reason := begun.reasons[effect.name]:
            found.append(Candidate(effect.name, False, remark=reason))
        else:
            found.append(_scored(effect, evidence, row))
    return (*sorted(found, key=lambda candidate: -candidate.evidence), *failed_candidates(begun))


def _scored(effect: Effect, evidence: Evidence, row: Row | None) -> Candidate:
    """Return a candidate with its score at the fit of the nominal model."""
    name = effect.name
    unidentifiable = evidence.unidentifiable(name)
    score = 0.0 if unidentifiable else evidence.statistic(name)
    return Candidate(
        name=name,
        applicable=True,
        score=score,
        score_p=p_value_of(score, len(effect.amplitudes())),
        confounded=evidence.confounded(name),
        minimum_detectable=evidence.minimum_detectable(name) if effect.smooth and not unidentifiable else None,
        remark=_remark(row),
        row=row,
    )


def _remark(row: Row | None) -> str:
    return _ROUGH if row is not None and row.status != "converged" else ""


def failed_candidates(begun: Begun) -> tuple[Candidate, ...]:
    """Return the candidates that failed."""
    reasons = begun.parts.failures
    return tuple(Candidate(e.name, True, failure=reasons[e.name]) for e in begun.candidates if e.name in reasons)


def undetectable(candidates: Sequence[Candidate], evidence: Evidence) -> dict[str, str]:
    """Return the causes that these data cannot show, whatever their size, and why."""
    reasons = {candidate.name: candidate.remark for candidate in candidates if not candidate.applicable}
    for effect in evidence.candidates:
        if evidence.unidentifiable(effect.name):
            reasons[effect.name] = "the free coefficients hide all of it; fix one that was measured apart"
    return reasons
