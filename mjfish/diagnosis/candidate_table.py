"""The candidates: how each of them fared, those too that failed or that the dataset cannot show."""

from __future__ import annotations

from collections.abc import Sequence

from mjfish.diagnosis.begun import Begun
from mjfish.diagnosis.compared import Compared
from mjfish.diagnosis.evidence import Evidence, p_value_of
from mjfish.diagnosis.result import Candidate
from mjfish.diagnosis.table import Row
from mjfish.effects import Effect

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
