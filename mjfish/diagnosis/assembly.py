"""A diagnosis put together from its steps, and one that could not be finished, with the reasons."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from mjfish.arrays import FloatArray
from mjfish.data import Dataset, Trial
from mjfish.data.looking import SMOOTHED, for_looking
from mjfish.diagnosis.begun import Begun
from mjfish.diagnosis.candidate_table import candidate_table, failed_candidates, undetectable
from mjfish.diagnosis.compared import Compared
from mjfish.diagnosis.conclusion import Conclusion
from mjfish.diagnosis.description import describe
from mjfish.diagnosis.estimate import Estimate, estimates
from mjfish.diagnosis.evidence import Evidence
from mjfish.diagnosis.held_out import HeldOut, gain
from mjfish.diagnosis.isolability import Isolability, isolability
from mjfish.diagnosis.lone_run import odd_run
from mjfish.diagnosis.missing_force import MissingForce, missing_force, with_velocities
from mjfish.diagnosis.provenance import provenance
from mjfish.diagnosis.refit_result import Refit
from mjfish.diagnosis.result import Cause, Diagnosis, FittedModel, Overlay, SensorOverlay
from mjfish.diagnosis.screening import Screening
from mjfish.diagnosis.thresholds import THRESHOLDS
from mjfish.diagnosis.verdict import Decision, withheld
from mjfish.diagnosis.where import locate
from mjfish.estimation import Fit, Problem
from mjfish.estimation.identification import identified_fish
from mjfish.estimation.posterior import posterior
from mjfish.estimation.residual import SensorResidual, of_sensors
from mjfish.estimation.scatter import scatter
from mjfish.estimation.sensor_noise import joints_in_words
from mjfish.inspection import Inspection
from mjfish.inspection.known_numbers import contradicted
from mjfish.model.posterior import Posterior


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
    odd = [] if compared.odd is None else [odd_run(evidence.problem.trials, compared.odd)]
    checks = checks.joined(Inspection.of([*contradicted(shown.problem, shown.fit), *odd], begun.known))
    candidates = candidate_table(begun, evidence, compared)
    converged = {"the nominal model": evidence.fit.status, "the extended model": shown.fit.status}
    views, gained = _views(begun, screening, concluded), None
    if held_out.trials:
        scores = held_out.score(None), held_out.score(best)
        gained = parts.run("the gain", lambda: gain(*scores, held_out.trials, np.random.default_rng(begun.seed)), None)
    joints: tuple[str, ...] = parts.run("errors of joints", lambda: (*joints_in_words(evidence.problem),), ())
    drawn = parts.run("the posterior", lambda: _posterior(shown.problem, shown.fit), None)
    decision = withheld(concluded.decision, parts.failures)
    named = decision.verdict == "named"
    return Diagnosis(
        dataset=dataset,
        verdict=decision.verdict,
        message=decision.message + _in_domain(concluded),
        status="failed" if parts.failures else "ok" if {*converged.values()} == {"converged"} else "fit_not_converged",
        remarks=(
            *failed_remarks(parts.failures),
            *remarks(screening.remark, evidence.fit, converged, held_out.trials),
            *joints,
            *_of_sensors(dataset),
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
        effects={effect.name: effect for effect in begun.candidates},
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


def _of_sensors(dataset: Dataset) -> Iterator[str]:
    """Yield what is to be said of the sensors of every run."""
    for trial in dataset.trials:
        yield from (f"{trial.name}: {own}" for sensor in trial.sensors for own in sensor.remarks)


def _fits(evidence: Evidence, compared: Compared) -> Iterator[FittedModel]:
    """Yield the nominal model at its fit, then those with single causes."""
    yield FittedModel.of((), evidence.problem, evidence.fit)
    for refit in compared.refits.values():
        if len(refit.names) == 1:
            yield FittedModel.of(refit.names, refit.problem, refit.fit)


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
    return Diagnosis(
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
        overlays=tuple(_unpredicted(trial, held_out=trial in held) for trial in dataset.trials),
        problem=problem,
        fits=(FittedModel((), problem.named(problem.start()), (), math.nan, problem.model.step, converged=False),),
        effects={effect.name: effect for effect in begun.candidates},
        provenance=provenance(dataset, begun.candidates, begun.seed),
    )


def failed_remarks(failures: Mapping[str, str]) -> Iterator[str]:
    """Yield what failed, in words."""
    yield from (f"failed: {part}: {reason}" for part, reason in failures.items())


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
    models = [(one.problem, one.fit.x) for one in (evidence, best or evidence)]
    predictions = zip(*(problem.predictions(x) for problem, x in models), strict=True)
    for index, (trial, (nominal, extended)) in enumerate(zip(evidence.problem.trials, predictions, strict=True)):
        read = [of_sensors(problem, x, index) for problem, x in models]
        yield Overlay(for_looking(trial), False, nominal, extended, _paired(*read))
    if held_out.trials:
        scores = [held_out.score(model) for model in (None, best)]
        predictions = zip(*(score.predictions for score in scores), strict=True)
        sensors = zip(*(score.sensors for score in scores), strict=True)
        for trial, (nominal, extended), own in zip(held_out.trials, predictions, sensors, strict=True):
            yield Overlay(for_looking(trial), True, nominal, extended, _paired(*own))


def _unpredicted(trial: Trial, *, held_out: bool) -> Overlay:
    """Return a trial that no model predicts: predictions end where they begin."""
    velocity: FloatArray = np.full((len(trial.time), 3), np.nan)
    velocity[0] = trial.velocity[0]
    return Overlay(trial, held_out, velocity, velocity)


def _paired(nominal: Sequence[SensorResidual], extended: Sequence[SensorResidual]) -> tuple[SensorOverlay, ...]:
    return tuple(SensorOverlay(a.sensor, a.predicted, b.predicted) for a, b in zip(nominal, extended, strict=True))


def _posterior(problem: Problem, found: Fit) -> Posterior | None:
    """Return the posterior of the extended model; its residuals are white under the noise of the problem."""
    if found.lost:
        return None
    fish = identified_fish(problem.model.fish, found, problem.fixed)
    return posterior(problem, found, fish, scatter(problem, found), correlated=False)
