"""The sets of causes that the data cannot tell apart, side by side."""

from __future__ import annotations

from dataclasses import dataclass

from mjfish.diagnosis import DiagnosisData
from mjfish.diagnosis.table import Row
from mjfish.reporting.titles import cause_title


@dataclass(frozen=True)
class Rival:
    """One set of causes that may be the truth.

    Attributes:
        names: of the causes.
        titles: what they do, in words.
        drawn: whether it is the extended model of the figures.
        row: how it stands in the table of evidence.
    """

    names: tuple[str, ...]
    titles: tuple[str, ...]
    drawn: bool
    row: Row | None


def rivals(diagnosis: DiagnosisData) -> tuple[Rival, ...]:
    """Return the sets that stay, where there are several and none is named; the one that is drawn first."""
    if diagnosis.verdict != "cannot_tell" or len(diagnosis.alternatives) < 2:
        return ()
    rows = {frozenset(row.names): row for row in diagnosis.table.rows}
    every = (
        Rival(
            names=names,
            titles=tuple(cause_title(name, diagnosis.setup.causes) for name in names),
            drawn=frozenset(names) == frozenset(diagnosis.best),
            row=rows.get(frozenset(names)),
        )
        for names in diagnosis.alternatives
    )
    return tuple(sorted(every, key=lambda rival: not rival.drawn))
