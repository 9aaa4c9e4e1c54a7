"""The sets of causes that the data cannot tell apart, side by side."""

from __future__ import annotations

from dataclasses import dataclass

from mjfish.diagnosis import Candidate, Diagnosis
from mjfish.reporting.titles import cause_title


@dataclass(frozen=True)
class Rival:
    """One set of causes that may be the truth.

    Attributes:
        names: of the causes.
        titles: what they do, in words.
        drawn: whether it is the extended model of the figures.
        gained: fall of the sum of squares against the nominal model; None where the fit was not kept.
        candidate: how it fared, where it is one cause.
    """

    names: tuple[str, ...]
    titles: tuple[str, ...]
    drawn: bool
    gained: float | None
    candidate: Candidate | None


def rivals(diagnosis: Diagnosis) -> tuple[Rival, ...]:
    """Return the sets that stay, where there are several and none is named; the one that is drawn first."""
    if diagnosis.verdict != "cannot_tell" or len(diagnosis.alternatives) < 2:
        return ()
    left = {frozenset(fit.causes): fit.sse for fit in diagnosis.fits}
    scored = {candidate.name: candidate for candidate in diagnosis.candidates}
    nominal = left.get(frozenset())
    found = []
    for names in diagnosis.alternatives:
        sse = left.get(frozenset(names))
        found.append(
            Rival(
                names=names,
                titles=tuple(cause_title(name, diagnosis.effects) for name in names),
                drawn=frozenset(names) == frozenset(diagnosis.best),
                gained=None if sse is None or nominal is None else nominal - sse,
                candidate=scored.get(names[0]) if len(names) == 1 else None,
            )
        )
    return tuple(sorted(found, key=lambda rival: not rival.drawn))
