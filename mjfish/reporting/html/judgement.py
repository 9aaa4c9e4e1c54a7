"""What is said of a candidate: why it is the cause, or is not, and what to mind about its numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from mjfish.diagnosis import Candidate, Diagnosis
from mjfish.diagnosis.select import GOODNESS, KEEP
from mjfish.effects import Effect
from mjfish.reporting.html.words import number, percent, unit

#: A refit that hides more of a signature than this leaves little to see.
_HIDDEN = 0.9


def visible(one: Candidate, effects: Mapping[str, Effect]) -> tuple[str, ...]:
    """Return, per amplitude, the size that would have shown, with its unit."""
    units = {p.name: p.unit for p in effects[one.name].parameters} if one.name in effects else {}
    return tuple(
        f"{name.rpartition('.')[2]} {number(size, 2)} {unit(units.get(name, '-'))}".strip()
        for name, size in (one.smallest_visible or {}).items()
    )


def judgement(one: Candidate, diagnosis: Diagnosis, shown: Sequence[str]) -> str:
    """Say in a sentence why the candidate is, or is not, the cause.

    Args:
        one: the candidate.
        diagnosis: that it is of.
        shown: the sizes of it that would have shown.
    """
    if not one.applicable:
        return f"Not tried: {one.remark}."
    if one.name in diagnosis.certain:
        return _at_work(one, diagnosis)
    if any(one.name in group for group in diagnosis.rivals):
        left = f", and with it {_left(one)}" if (one.name,) in diagnosis.alternatives else ""
        return f"Possible: the data cannot tell it from its rivals{left}."
    if one.parameters is None:
        return _not_refitted(one, diagnosis, shown)
    if diagnosis.verdict == "cannot_tell" and (one.name,) in diagnosis.alternatives:
        if _clean(one):
            return "Possible: it explains no more than chance might, and with it nothing systematic is left."
        return f"Possible, and the closest: with it {_left(one)}."
    if one.rival_p is not None and one.fit_p is None:
        return _ruled_out(diagnosis)
    if not _clean(one):
        return f"Close, but with it in the model {_left(one)}."
    if one.held_out_gain is not None and one.held_out_gain <= 0.0:
        return "Fits, but makes the held-out trials no better."
    return ""


def cautions(one: Candidate, diagnosis: Diagnosis) -> list[str]:
    """Return what to mind about the numbers of a candidate."""
    found = []
    if one.applicable and one.absorbed > _HIDDEN and one.name not in diagnosis.blind:
        found.append(
            f"A refit of the coefficients hides {percent(one.absorbed, 2)} of what it does: these trials say little."
        )
    stuck = [name for name, value in (one.parameters or {}).items() if value.at_bound]
    if stuck:
        found.append(f"On its bound: {', '.join(stuck)}.")
    if one.applicable and one.remark:
        found.append(one.remark)
    return found


def _at_work(one: Candidate, diagnosis: Diagnosis) -> str:
    if diagnosis.verdict != "named":
        return "At work, whichever of the others is."
    others = [cause.name for cause in diagnosis.causes if cause.name != one.name]
    if others:
        return f"One of the causes, beside {' and '.join(others)}."
    return f"The cause: with it in the model {_left(one)}."


def _not_refitted(one: Candidate, diagnosis: Diagnosis, shown: Sequence[str]) -> str:
    if one.name in diagnosis.blind:
        return f"Could not be seen: {diagnosis.blind[one.name]}."
    if one.p_value < KEEP and any(other.parameters is not None for other in diagnosis.candidates):
        return "Not refitted: others have better scores."
    if not shown:
        return "No sign of it."
    return f"No sign of it. It would have shown from {' and '.join(shown)} on."


def _ruled_out(diagnosis: Diagnosis) -> str:
    """Say by whom: single causes stand against the best single one, whether or not it needs company."""
    leader = max(diagnosis.candidates, key=lambda other: other.rival_p or 0.0).name
    alone = " as the only cause" if any(len(names) > 1 for names in diagnosis.alternatives) else ""
    return f"Ruled out{alone}: {leader} explains the misfit better by more than chance allows."


def _clean(one: Candidate) -> bool:
    return one.fit_p is None or one.fit_p >= GOODNESS


def _left(one: Candidate) -> str:
    return f"{'nothing' if _clean(one) else 'something'} systematic is left"
