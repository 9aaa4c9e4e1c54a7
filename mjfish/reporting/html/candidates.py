"""What is said of every candidate in words, which of them are out of the race, and which sets are rivals."""

from __future__ import annotations

from mjfish.diagnosis import Candidate, DiagnosisData
from mjfish.diagnosis.table import Row
from mjfish.diagnosis.thresholds import THRESHOLDS
from mjfish.numerics.formats import number, percent, unit

#: With a larger confounded share a signature says little.
_CONFOUNDED = 0.9


def detectable(candidate: Candidate, diagnosis: DiagnosisData) -> tuple[str, ...]:
    """Return the minimum detectable effect of each amplitude, with its unit."""
    units = diagnosis.setup.causes[candidate.name].units if candidate.name in diagnosis.setup.causes else {}
    return tuple(
        f"{name.rpartition('.')[2]} {number(size, 2)} {unit(units.get(name, '-'))}".strip()
        for name, size in (candidate.minimum_detectable or {}).items()
    )


def remark(candidate: Candidate, diagnosis: DiagnosisData) -> str:
    """Return all that is said of a candidate: the judgement, then what to mind about its numbers."""
    return " ".join(filter(None, [judgement(candidate, diagnosis), *cautions(candidate, diagnosis)]))


def judgement(candidate: Candidate, diagnosis: DiagnosisData) -> str:
    """Say in a sentence why the candidate is, or is not, the cause."""
    if candidate.failure:
        return f"Failed: {candidate.failure}."
    if not candidate.applicable:
        return f"Not tried: {candidate.remark}."
    if candidate.name in diagnosis.certain:
        return _at_work(candidate, diagnosis)
    if any(candidate.name in group for group in diagnosis.rivals):
        left = f", and with it {_remainder_text(candidate.row)}" if (candidate.name,) in diagnosis.alternatives else ""
        return f"Possible: the data cannot tell it from its rivals{left}."
    if (row := candidate.row) is None:
        return _not_refitted(candidate, diagnosis)
    if diagnosis.verdict == "cannot_tell" and (candidate.name,) in diagnosis.alternatives:
        if _clean(row):
            return "Possible: it explains no more than chance might, and with it nothing systematic is left."
        return f"Possible, and the closest: with it {_remainder_text(row)}."
    if not row.tests:  # single causes stand against the best single one, whether or not it needs company
        leader = max(diagnosis.candidates, key=lambda other: other.row.rival_p if other.row else 0.0).name
        alone = " as the only cause" if any(len(names) > 1 for names in diagnosis.alternatives) else ""
        return f"Ruled out{alone}: {leader} explains the misfit better by more than chance allows."
    if not _clean(row):
        return f"Close, but with it in the model {_remainder_text(row)}."
    if row.held_out is not None and row.held_out.gained <= 0.0:
        return "Fits, but makes the held-out trials no better."
    return ""


def cautions(candidate: Candidate, diagnosis: DiagnosisData) -> list[str]:
    """Return what to mind about the numbers of a candidate."""
    found = []
    if candidate.applicable and candidate.confounded > _CONFOUNDED and candidate.name not in diagnosis.undetectable:
        found.append(
            f"A refit of the coefficients removes {percent(candidate.confounded, 2)} of its signature: these trials "
            "say little about it."
        )
    sizes = {} if candidate.row is None else candidate.row.sizes
    if stuck := [name.rpartition(".")[2] for name, value in sizes.items() if value.at_bound]:
        found.append(f"On its bound: {', '.join(stuck)}.")
    if candidate.applicable and candidate.remark:
        found.append(candidate.remark)
    return found


def _at_work(candidate: Candidate, diagnosis: DiagnosisData) -> str:
    if diagnosis.verdict != "named":
        return "At work, whichever rival is the other cause."
    if others := [cause.name for cause in diagnosis.causes if cause.name != candidate.name]:
        return f"One of the causes, beside {' and '.join(others)}."
    return f"The cause: with it in the model {_remainder_text(candidate.row)}."


def _not_refitted(candidate: Candidate, diagnosis: DiagnosisData) -> str:
    if candidate.name in diagnosis.undetectable:
        return f"Undetectable: {diagnosis.undetectable[candidate.name]}."
    if candidate.score_p < THRESHOLDS.keep and any(other.row is not None for other in diagnosis.candidates):
        return "Not refitted: others have better scores."
    sizes = " and ".join(detectable(candidate, diagnosis))
    return f"No sign of it; the minimum detectable effect is {sizes}." if sizes else "No sign of it."


def _clean(row: Row | None) -> bool:
    return row is None or not row.tests or row.clean()


def _remainder_text(row: Row | None) -> str:
    if row is None or _clean(row):
        return "nothing systematic is left"
    return f"something systematic is left, {percent(row.remaining)} of the misfit"


def possible(diagnosis: DiagnosisData) -> set[str]:
    """Return the names of all causes that may be at work: certain ones, rivals, and else the closest."""
    found = {*diagnosis.certain, *(name for group in diagnosis.rivals for name in group)}
    return found or {*diagnosis.best, *(name for names in diagnosis.alternatives for name in names)}


def grouped(diagnosis: DiagnosisData) -> tuple[list[Candidate], list[Candidate], list[Candidate]]:
    """Return the candidates that may be at work, those that are ruled out or left no sign, and those not tried.

    One that failed is among those not tried.
    """
    kept, order = possible(diagnosis), diagnosis.candidates
    tried = [candidate for candidate in order if candidate.applicable and not candidate.failure]
    return (
        [candidate for candidate in tried if candidate.name in kept],
        [candidate for candidate in tried if candidate.name not in kept],
        [candidate for candidate in order if candidate not in tried],
    )


def rivals(diagnosis: DiagnosisData) -> list[tuple[tuple[str, ...], Row | None]]:
    """Return the sets that stay with their rows of evidence, where there are several and none is named.

    The one that is the extended model of the figures comes first.
    """
    if diagnosis.verdict != "cannot_tell" or len(diagnosis.alternatives) < 2:
        return []
    rows = {frozenset(row.names): row for row in diagnosis.table.rows}
    order = sorted(diagnosis.alternatives, key=lambda names: {*names} != {*diagnosis.best})
    return [(names, rows.get(frozenset(names))) for names in order]
