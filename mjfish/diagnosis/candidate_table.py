"""The table of the candidates: how each of them fared, those too that failed or that the dataset cannot show."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from mjfish.diagnosis.begun import Begun
from mjfish.diagnosis.compared import Compared
from mjfish.diagnosis.evidence import Evidence, p_value_of
from mjfish.diagnosis.held_out import HeldOut, pooled_error
from mjfish.diagnosis.refit_result import Refit
from mjfish.diagnosis.result import Candidate, Cause
from mjfish.diagnosis.table import Row
from mjfish.effects import Effect
from mjfish.estimation.residual import channel_errors

#: Said of a refit that was too far behind the best to be followed.
_ROUGH = "Its refit was not followed to its optimum: what it explains is a lower bound, its size is rough."


def candidate_table(begun: Begun, evidence: Evidence, compared: Compared, held_out: HeldOut) -> tuple[Candidate, ...]:
    """Return how every candidate fared, best first, then those that failed."""
    single, rows = compared.table.single.joined(compared.table.others), []
    for effect in begun.known.values():
        if reason := begun.reasons[effect.name]:
            if not effect.learned:
                rows.append(Candidate(effect.name, False, remark=reason))
        elif not effect.learned or (effect.name,) in compared.refits:
            own = (effect.name,)
            rows.append(_row(effect, evidence, single.rows.get(own), compared.refits.get(own), held_out))
    return (*sorted(rows, key=lambda candidate: -candidate.statistic), *failed_candidates(begun))


def _row(effect: Effect, evidence: Evidence, judged: Row | None, refit: Refit | None, held_out: HeldOut) -> Candidate:
    row = Candidate(effect.name, True) if effect.learned else _scored(effect, evidence)
    if refit is not None:
        row = replace(
            row,
            statistic=max(refit.gain, 0.0),  # a formula may not have the nominal model in it
            degrees_of_freedom=refit.degrees_of_freedom,
            error=pooled_error(channel_errors(refit.problem, refit.fit.x)),
            held_out_error=pooled_error(held_out.score(refit).channels) if held_out.trials else None,
            parameters=Cause.of(effect, refit.fit, refit.problem.model).parameters,
            remark=_ROUGH if refit.fit.status != "converged" else "",
        )
    if judged is not None:
        row = replace(
            row,
            rival_p=judged.rival_p,
            fit_p=judged.fit_p if judged.tests else None,
            held_out_gain=None if judged.held_out is None else judged.held_out.gained,
        )
    return replace(row, p_value=p_value_of(row.statistic, row.degrees_of_freedom))


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
