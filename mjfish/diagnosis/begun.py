"""What a diagnosis starts with; and one that could not be finished, with the reasons."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from mjfish.arrays import FloatArray
from mjfish.data import Dataset, Trial
from mjfish.diagnosis.evidence import signatures
from mjfish.diagnosis.failures import CandidatesFailedError, blamed, raised_in
from mjfish.diagnosis.isolability import Isolability
from mjfish.diagnosis.provenance import provenance
from mjfish.diagnosis.result import Candidate, Diagnosis, Estimate, FittedModel, Overlay
from mjfish.diagnosis.verdict import Decision, withheld
from mjfish.effects import Effect
from mjfish.errors import reason_of
from mjfish.estimation import Problem
from mjfish.inspection import Inspection


@dataclass(frozen=True, eq=False)
class Begun:
    """What a diagnosis starts with.

    Attributes:
        measured: the dataset as it was given.
        dataset: the same with aligned clocks of waves.
        candidates: effects, as the fish has them.
        reasons: why the dataset cannot show a candidate, by name; empty where it can.
        failures: candidates that failed before anything was fitted, and why.
        stated: (3,) standard deviations of the noise that the dataset states; None: none.
        problem: of the nominal model.
    """

    measured: Dataset
    dataset: Dataset
    candidates: tuple[Effect, ...]
    reasons: Mapping[str, str]
    failures: Mapping[str, str]
    stated: FloatArray | None
    problem: Problem


def culprits(error: Exception, begun: Begun, failed: Mapping[str, str]) -> dict[str, str]:
    """Return the candidates that are to blame for an error, and why; none where it is not theirs.

    Where the error does not say, each is tried alone: at its null, and one scale off it.
    """
    left = [e for e in begun.candidates if e.name not in failed and not begun.reasons[e.name]]
    told = error.reasons if isinstance(error, CandidatesFailedError) else {raised_in(error): reason_of(error)}
    if found := {effect.name: told[effect.name] for effect in left if effect.name in told}:
        return found
    for effect in left:
        try:
            with blamed(effect.name):
                _alone(begun.problem, effect)
        except CandidatesFailedError as own:
            found[effect.name] = next(iter(own.reasons.values()))
    return found if len(found) < max(len(left), 2) else {}


def _alone(problem: Problem, effect: Effect) -> None:
    """Simulate with one candidate alone; whatever it raises is its own fault."""
    signatures(problem, {}, [effect])
    wide = replace(problem, model=problem.model.extended(effect))
    _ = wide.prior_root
    wide.residual(wide.start({p.name: p.default + p.scale for p in effect.amplitudes()}))


def failed_candidates(begun: Begun, failures: Mapping[str, str]) -> Iterator[Candidate]:
    """Yield the candidates that failed."""
    for effect in begun.candidates:
        if effect.name in failures:
            yield Candidate(effect.name, True, failure=failures[effect.name])


def failed_remarks(failures: Mapping[str, str]) -> Iterator[str]:
    """Yield what failed, in words."""
    yield from (f"failed: {part}: {reason}" for part, reason in failures.items())


def _unknown(trial: Trial) -> FloatArray:
    """Return velocities (n, 3) of a prediction that ends where it begins."""
    velocity = np.full((len(trial.time), 3), np.nan)
    velocity[0] = trial.velocity[0]
    return velocity


def unfinished_diagnosis(begun: Begun, failures: Mapping[str, str], seed: int) -> Diagnosis:
    """Return a diagnosis without a comparison: what failed, and the nominal model as it was declared, not fitted."""
    problem, nothing = begun.problem, Decision("cannot_tell", (), "Nothing was compared.")
    decision = withheld(nothing, failures)
    declared = {p.name: Estimate(p.start, p.low, p.high, p.unit) for p in problem.model.parameters}
    held = begun.dataset.split()[1]
    return Diagnosis(
        dataset=begun.dataset,
        verdict=decision.verdict,
        message=decision.message,
        status="failed",
        remarks=tuple(failed_remarks(failures)),
        checks=Inspection(),
        causes=(),
        mechanisms=(),
        domain=None,
        rivals=(),
        alternatives=(),
        certain=(),
        candidates=tuple(failed_candidates(begun, failures)),
        failures=dict(failures),
        undetectable={},
        isolability=Isolability((), (), (), ()),
        best=(),
        closest="",
        where=None,
        force=(),
        fingerprint=None,
        description=None,
        p_wrong=math.nan,
        gain=None,
        nominal=declared,
        extended=declared,
        nominal_model=problem.model,
        extended_model=problem.model,
        posterior=None,
        overlays=tuple(
            Overlay(trial, trial in held, _unknown(trial), _unknown(trial)) for trial in begun.dataset.trials
        ),
        problem=problem,
        fits=(FittedModel((), problem.named(problem.start()), (), math.nan, problem.model.step, converged=False),),
        effects={effect.name: effect for effect in begun.candidates},
        provenance=provenance(begun.dataset, begun.candidates, seed),
    )
